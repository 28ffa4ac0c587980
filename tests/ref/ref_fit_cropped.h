/* Reference of transfer functions with the crop in the model, in double precision, one channel of one depth at a time:
 * lib/fit/cropped.h, by the textbook with x, u and d by themselves. Internal. */
#ifndef HADA_REF_FIT_CROPPED_H
#define HADA_REF_FIT_CROPPED_H

#include "ref/ref_filter.h"

typedef struct hada_ref_fit_cropped {
    const hada_ref_grid *grid;
    const double *const *x; /* scenes' spectra of each pair, in rows: rows x (cols/2 + 1) complex numbers */
    const float *const *b;  /* frames, raw_rows x raw_cols */
    const float *weights;   /* of each frame's values: 1, 0 (not known) or below 0 (may be more); NULL: all 1 */
    int pairs;
    const double *sums; /* of these pairs, as in ref_fit.h */
    double mean;        /* of Sxx over frequencies */
    int iterations, steps;
    const double *length; /* of the step of each iteration but the first, which takes the sums as they are */
    double first, last;   /* weight of the constraint, a geometric series over the iterations */
    double relaxation, trust;
} hada_ref_fit_cropped;

/* The transfer function, and the sum of squares that the one before the last iteration leaves of the frames. */
hada_status hada_ref_fit_cropped_solve(const hada_ref_fit_cropped *fit, double *otf, double *left, hada_error *err);

#endif
