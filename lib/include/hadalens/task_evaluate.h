/* Hadalens: results against the truth, files or folders of them, as the command 'evaluate' compares them.
 *
 * Threads: a run uses the calling thread; several may run at once. Source: hadalens/metrics.h, hadalens/lpips.h. */
#ifndef HADALENS_TASK_EVALUATE_H
#define HADALENS_TASK_EVALUATE_H

#include <hadalens/lpips.h>
#include <hadalens/metrics.h>
#include <hadalens/monitor.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What a file name says: NAME_stack.tif is a stack of planes, NAME_depth.tif a distance map in millimetres, and
 * everything else images. */
typedef enum hada_evaluated {
    HADA_EVALUATED_IMAGES = 0,
    HADA_EVALUATED_STACK = 1,
    HADA_EVALUATED_MAP = 2,
    HADA_EVALUATED_EMITTERS = 3 /* two files that end in .csv: tables of emitters (hadalens/emitters.h) */
} hada_evaluated;

typedef struct hada_evaluate_task {
    size_t size;      /* sizeof(hada_evaluate_task) */
    double peak;      /* value that counts as full scale; 1 by default */
    double tolerance; /* of distances, in depth steps (millimetres where these are not known); 0.5 by default */
    const double *distances_mm; /* of the camera, near to far, which say what a depth step is */
    int distances;              /* 0 (default): read from NAME_stack.tif beside NAME_depth.tif, where there is one */
    int match_gain;    /* 1: each result is multiplied by the factor from 0 on that brings it nearest to the truth */
    int authors;       /* 1: also PSNR and SSIM as the code of the 2022 paper has them */
    hada_lpips *lpips; /* NULL: none */

    /* Where: a window, at the centre where its top left is HADA_AUTO, and pixels of a mask that are not 0 in some
     * channel. Nothing outside the window is looked at; SSIM and sharpness see the neighbours of a mask's pixels. */
    int window_rows, window_cols; /* 0 (default): the whole image */
    int window_row, window_col;   /* HADA_AUTO by default */
    const char *mask;             /* a TIFF file of the images' size, its first page; NULL: all pixels count */
    const hada_monitor *monitor;

    /* How values stand for light (hadalens/response.h). Results say it themselves (reconstruct writes it); a truth that
     * does not is taken as the scenes that the result's camera was learned from, and the result is brought to it. */
    double truth_encoding; /* HADA_AUTO (default): so */
    double encoding;       /* in which both are compared; HADA_AUTO (default): the truth's */

    double gate_pixels, gate_depths; /* an emitter is found at most so far from the true one, across and along depths,
                                        in the units of x, y and z of the tables; 2 and 2.5 by default */
} hada_evaluate_task;
HADA_INIT(hada_evaluate_task, HADA_STRUCT_EVALUATE_TASK)

/* A result and its truth. Owned by the report. */
typedef struct hada_evaluation {
    size_t size; /* as the library has it */
    const char *name, *result, *truth;
    hada_evaluated what;
    int pages, occupied; /* compared; those with anything in the truth */
    int missing;         /* occupied slices of the truth that the result lacks */
    double gain;         /* the result was multiplied by this */
    /* Means over occupied pages; psnr_all is of the mean squared error over all pages. SSIM is NaN where the images are
     * too small for it. */
    double psnr, psnr_all, ssim, mae, sharpness, sharpness_truth;
    double lpips, authors_psnr, authors_ssim; /* NaN where not asked for */
    hada_depth_score depth;                   /* of maps */
    int steps_known;                          /* 1: `depth` is in depth steps */

    /* At jumps of the true distances and away from them (hada_metric_depth_parts), where the steps are known: of maps,
     * and of NAME_aif.tif with a NAME_depth.tif beside the truth. NaN where there is no such place. */
    double psnr_jumps, psnr_away, ssim_jumps, ssim_away;
    double steps_jumps, steps_away, within_jumps, within_away, coverage_jumps, coverage_away;
    /* Of maps. `depth` and what stands above leave out the pixels outside the list's range. */
    double outside; /* share of the pixels with a true distance that are outside; NaN where steps are not known */
    double outside_unknown;      /* share of these that the map says not to know; NaN without any */
    double confident_half, risk; /* hada_confidence_score, of NAME_confidence.tif beside the result; NaN without one */

    /* Of images, as hadalens/response.h has it, 0 where it is not known: how the result was written, and in which
     * encoding the two were compared, to which it was brought. */
    double result_encoding, encoding;
    int downsample; /* the truth has so many times the rows and columns and was binned: a frame had been for the result
                     */

    /* Of tables of emitters: within the gate, as many as possible of the found and the true ones of a frame are paired,
     * at the least sum of squared distances in units of the gate. With p pairs, f found and t true ones: recall p / t,
     * precision p / f, F1 2 p / (f + t), Jaccard p / (f + t - p). Errors are roots of mean squares over pairs:
     * distances across, in pixels, and along depths, in depths. NaN where there is nothing to divide by. */
    int emitters, emitters_truth;
    double recall, precision, f1, jaccard, lateral_rmse, axial_rmse;

    /* Of tables that both have a column `track`: tracks, and how often a true one that is found is in another of the
     * found ones than when it was last found; 0 and NaN of others. */
    int tracks, tracks_truth;
    double switches;
} hada_evaluation;

typedef struct hada_evaluate_report hada_evaluate_report;

/* Compares two files, or in two folders every file of the truth that has a partner: NAME.tif goes with NAME.tif or
 * NAME_aif.tif; files without one are told as a note. A NAME_depth2.tif of the truth says where a second surface is
 * seen through the first: at a pixel, the nearer of the two to the result counts. In stacks, planes that are dark in
 * the truth are left out of the means: they say how clean a stack is, not how good a picture. *report is the caller's;
 * `task` may be NULL. */
HADA_API hada_status hada_evaluate_run(hada_evaluate_report **report, const char *result, const char *truth,
                                       const hada_evaluate_task *task, hada_error *err);
HADA_API int hada_evaluate_report_count(const hada_evaluate_report *report);
/* NULL beyond the last. */
HADA_API const hada_evaluation *hada_evaluate_report_get(const hada_evaluate_report *report, int index);
HADA_API void hada_evaluate_report_destroy(hada_evaluate_report **report);

#ifdef __cplusplus
}
#endif
#endif
