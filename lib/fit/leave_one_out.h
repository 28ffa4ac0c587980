/* The second pass: leave-one-out errors of pairs over settings of alpha and lambda, and the choice. Internal. */
#ifndef HADA_FIT_LEAVE_ONE_OUT_H
#define HADA_FIT_LEAVE_ONE_OUT_H

#include "fit/fit_sums.h"

/* The setting where no pair was scored and the caller gives none (docs/explanation/learning-a-camera.md). */
#define HADA_FIT_ALPHA  0.0
#define HADA_FIT_LAMBDA 1e-4

/* Settings that are compared, at most. */
enum { HADA_FIT_SETTINGS = 10 };

/* Of the pairs of a depth that were scored: PSNR summed over them, per setting. */
typedef struct hada_fit_score {
    int64_t scored;
    double constant;          /* of a constant image in each channel, the best one */
    double *single, *twofold; /* with this depth alone occupied, and with the light of another */
} hada_fit_score;

typedef struct hada_leave_one_out {
    const hada_fit_grid *grid;
    hada_fit_setting *settings;
    int setting_count; /* a multiple of HADA_FIT_TRIALS: the last one may be repeated */
    int distinct;      /* settings that differ */
    hada_fit_setting fallback;
    hada_fit_score *depth;
    long taken; /* pairs in all, which ranks share */
    /* made at the first score */
    hada_fft *inverse;
    hada_buffer errors, planes; /* of HADA_FIT_TRIALS settings: spectra; in the window */
    hada_buffer partial;        /* sums */
    uint64_t bytes;             /* of device memory */
} hada_leave_one_out;

/* options: alpha and lambda where they are given. */
hada_status hada_leave_one_out_create(hada_leave_one_out *scores, const hada_fit_grid *grid,
                                      const hada_fit_options *options, hada_error *err);
void hada_leave_one_out_destroy(hada_leave_one_out *scores);

/* Clears the scores. */
void hada_leave_one_out_forget(hada_leave_one_out *scores);

/* Scores a pair, taken and transformed, that is among the sums of its depth, which are on the device; pools are up to
 * date. Among ranks, one of them does. */
hada_status hada_leave_one_out_add(hada_leave_one_out *scores, const hada_fit_sums *sums, const hada_fit_pair *pair,
                                   int depth, hada_error *err);

/* Among ranks: the scores of all of them, once all pairs are scored. */
hada_status hada_leave_one_out_share(hada_leave_one_out *scores, hada_error *err);

/* The setting with the best score; without scores, what the caller gave or the defaults. A score is the PSNR of a depth
 * alone plus the PSNR with another depth's light, means over scored depths: in decibels, as the mean squared error with
 * other light alone would choose filters that are bad for single depths. */
hada_fit_setting hada_leave_one_out_best(const hada_leave_one_out *scores);

/* By how many decibels the best filters make single depths of held-out pairs better than constant images, the best
 * ones, are; NaN where nothing was scored. */
double hada_leave_one_out_gain(const hada_leave_one_out *scores);

/* The table: a row for each setting, none where nothing was scored. */
int hada_leave_one_out_row_count(const hada_leave_one_out *scores);
void hada_leave_one_out_rows(const hada_leave_one_out *scores, hada_fit_filter_score *rows);

/* Pairs that stay in memory for the trial of refinement. */
enum { HADA_FIT_KEPT = 4 };

typedef struct hada_fit_kept_pair {
    int depth, number;  /* which pair of the data set it is */
    float *raw, *scene; /* pixels, dark level off */
    float *weights;     /* of the frame's values, as hada_fit_pair has them; NULL: all alike */
    float *transfers;   /* its depth's, learned without it, as the device has them; NULL: from the sums without it */
} hada_fit_kept_pair;

typedef struct hada_fit_kept {
    hada_fit_kept_pair pair[HADA_FIT_KEPT];
    int count;
} hada_fit_kept;

/* Keeps the pair that was taken, if the trial needs one of its depth: the first ones of depths spread over all. */
hada_status hada_fit_keep(hada_fit_kept *kept, const hada_fit_pair *pair, int depth, int number, hada_error *err);
void hada_fit_kept_free(hada_fit_kept *kept);

#endif
