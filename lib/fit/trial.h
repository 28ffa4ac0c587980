/* Does refinement pay for this camera, with how many steps and which weight of total variation? Measured on a few pairs
 * held out, alone and two depths at once. Internal. */
#ifndef HADA_FIT_TRIAL_H
#define HADA_FIT_TRIAL_H

#include "fit/fit_sums.h"
#include "fit/leave_one_out.h"
#include "fit/nonnegative.h"
#include "image/statistics.h"
#include "refine/admm.h"

/* What the trial works with. tv, colour, ridge: weights of total variation and of colour in it, strength of the
 * learned regulariser; < 0: chosen. */
typedef struct hada_fit_trial {
    hada_fit_sums *sums;
    hada_fit_pair *pair;
    hada_nonnegative *nonnegative; /* NULL: transfer functions from the pairs alone */
    const hada_fit_kept *kept;
    const hada_model *model; /* of the fit */
    double tv, colour, ridge;
} hada_fit_trial;

/* What it found. The gains are in decibels over the linear filters, one depth occupied plus two. */
enum { HADA_FIT_TRIAL_ROWS = 40 };
typedef struct hada_fit_trial_result {
    int steps;    /* 0: refinement does not pay */
    double share; /* of refined planes, the rest being the linear filters' */
    hada_refine_weights weights;
    hada_noise_share noise; /* of the frames on which they were chosen */
    double gain;
    hada_fit_refine_score rows[HADA_FIT_TRIAL_ROWS]; /* numbers of steps, 0 first, then weights that were compared */
    int row_count;
} hada_fit_trial_result;

/* Each pair is left out of the sums; afterwards these are as they were. At least one pair is kept. */
hada_status hada_fit_trial_run(const hada_fit_trial *trial, hada_fit_trial_result *result, hada_error *err);

#endif
