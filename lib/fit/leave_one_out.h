/* The second pass: leave-one-out errors of pairs over settings of alpha and lambda, and the choice. Internal. */
#ifndef HADA_FIT_LEAVE_ONE_OUT_H
#define HADA_FIT_LEAVE_ONE_OUT_H

#include "fit/fit_sums.h"

/* The setting where no pair was scored and the caller gives none (docs/explanation/learning-a-camera.md). */
#define HADA_FIT_ALPHA  0.0
#define HADA_FIT_LAMBDA 1e-4

/* Of the pairs of a depth that were scored: PSNR summed over them, per setting. */
typedef struct hada_fit_score {
    int64_t scored;
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
    int shared; /* the sums are those of all ranks */
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

/* New sums make old scores worthless. */
void hada_leave_one_out_forget(hada_leave_one_out *scores);

/* Whether a pair of a depth with so many would still change the choice. */
int hada_leave_one_out_wants(const hada_leave_one_out *scores, int depth, int64_t pairs);

/* Scores a pair, taken and transformed, that is among the sums of its depth, which stand on the device; pools are up to
 * date. Among ranks, one of them does. */
hada_status hada_leave_one_out_add(hada_leave_one_out *scores, const hada_fit_sums *sums, const hada_fit_pair *pair,
                                   int depth, hada_error *err);

/* Among ranks: the sums of all, before what follows is asked. */
hada_status hada_leave_one_out_share(hada_leave_one_out *scores, hada_error *err);

/* What the scores prefer; without any, what the caller gave or the defaults. Score: the PSNR of a depth alone plus the
 * PSNR with another depth's light, means over scored depths. In decibels, for the latter alone would ruin single
 * depths. */
hada_fit_setting hada_leave_one_out_best(const hada_leave_one_out *scores);

/* The table: a row for each setting, none where nothing was scored. */
int hada_leave_one_out_row_count(const hada_leave_one_out *scores);
void hada_leave_one_out_rows(const hada_leave_one_out *scores, hada_fit_filter_score *rows);

#endif
