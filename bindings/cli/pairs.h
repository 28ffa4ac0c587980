/* The pairs of a data set, read one at a time. */
#ifndef HADA_CLI_PAIRS_H
#define HADA_CLI_PAIRS_H

#include "dataset.h"

#include <hadalens/fit.h>
#include <hadalens/image.h>

typedef enum hada_cli_dark_kind {
    HADA_CLI_DARK_NONE,
    HADA_CLI_DARK_AUTO,
    HADA_CLI_DARK_LEVEL,
    HADA_CLI_DARK_FILE
} hada_cli_dark_kind;

/* "none", "auto", a level or a file. */
typedef struct hada_cli_dark {
    hada_cli_dark_kind kind;
    double level;     /* of the level, or the mean of the file */
    hada_image frame; /* mean of the file's pages */
} hada_cli_dark;
hada_status hada_cli_dark_read(hada_cli_dark *dark, const char *text, hada_error *err);
void hada_cli_dark_free(hada_cli_dark *dark);

/* Loads both images of a pair; errors name the file. */
hada_status hada_cli_pair_load(const hada_cli_pair *pair, hada_image *raw, hada_image *scene, hada_error *err);

/* First pass: all pairs into the sums. */
hada_status hada_cli_pairs_add(hada_cli *cli, hada_fitter *fitter, const hada_cli_dataset *set, hada_error *err);

/* Second pass: as many pairs as the fitter looks at, evenly spread over the lists. */
hada_status hada_cli_pairs_score(hada_cli *cli, hada_fitter *fitter, const hada_cli_dataset *set, hada_error *err);

/* Further passes: filters judged in the window, which may choose the weight outside it by leaving pairs out. */
hada_status hada_cli_pairs_judge(hada_cli *cli, hada_fitter *fitter, const hada_cli_dataset *set, hada_error *err);

#endif
