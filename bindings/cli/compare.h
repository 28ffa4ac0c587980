/* Comparing a result file with its truth. */
#ifndef HADA_CLI_COMPARE_H
#define HADA_CLI_COMPARE_H

#include "region.h"

#include <hadalens/lpips.h>
#include <hadalens/metrics.h>

typedef enum hada_cli_what { HADA_CLI_IMAGES, HADA_CLI_STACKS, HADA_CLI_MAPS } hada_cli_what;

/* How to compare. */
typedef struct hada_cli_yardstick {
    double peak;      /* value that counts as full scale */
    double tolerance; /* of distances, in depth steps */
    const double *distances_mm;
    int distances; /* 0: taken from the stack beside, where there is one */
    int match_gain;
    int authors;       /* also PSNR and SSIM as the code of the 2022 paper has them */
    hada_lpips *lpips; /* NULL: none */
    hada_cli_region region;
} hada_cli_yardstick;

typedef struct hada_cli_score {
    hada_cli_what what;
    int pages, occupied; /* compared; those with anything in the truth */
    int missing;         /* occupied slices of the truth that the result lacks */
    double gain;         /* the result was multiplied by this */
    /* Means over occupied pages; psnr_all is of the mean squared error over all pages. SSIM is NaN where the images are
     * too small for it. */
    double psnr, psnr_all, ssim, mae, sharpness, sharpness_truth;
    double lpips, authors_psnr, authors_ssim; /* NaN where not asked for */
    hada_depth_score depth;
    int steps_known; /* `depth` is in depth steps */
} hada_cli_score;

/* What a file name says: NAME_stack.tif, NAME_depth.tif, or images. */
hada_cli_what hada_cli_what_is(const char *path);

hada_status hada_cli_compare(hada_cli_score *score, const char *result, const char *truth,
                             const hada_cli_yardstick *yardstick, hada_error *err);

#endif
