/* Reference: frames by point spread functions that vary over the field, b = crop sum_k h_k * (w_k x), and the
 * transpose, in double precision, pixel by pixel. Yanny et al., Optica 7, 1012 (2020), Eq. 2. Internal. */
#ifndef HADA_REF_VARYING_H
#define HADA_REF_VARYING_H

#include <stddef.h>

typedef struct hada_ref_varying {
    int rows, cols;               /* of the frame, and of each h_k, whose axis is at (rows / 2, cols / 2) */
    int window_rows, window_cols; /* of x, in the middle of the frame, rounded down */
    int components;
    const double *psf;     /* h [component][rows][cols] */
    const double *weights; /* w [component][window_rows][window_cols] */
} hada_ref_varying;

void hada_ref_varying_forward(const hada_ref_varying *camera, const double *x, double *frame);
void hada_ref_varying_transpose(const hada_ref_varying *camera, const double *frame, double *x);

#endif
