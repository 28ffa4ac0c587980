/* Sums of random pairs, as the checks of what follows them need them. */
#ifndef HADA_CHECK_FIT_H
#define HADA_CHECK_FIT_H

#include "check.h"
#include "fit/fit_grid.h"
#include "kernels/shared_fit.h"
#include "ref/ref_fit.h"

typedef struct check_fit {
    size_t count, vectors, stride; /* frequencies; groups of eight; floats between arrays */
    int split, kept;               /* arrays of sums: 4 or 6 */
    float *x, *b;                  /* the last pair's spectra, padded with zeros */
    double *sums;                  /* HADA_REF_FIT_SUMS x count, of all pairs */
    double *other;                 /* 2 x count: |B|^2 and Re(B)^2 of another depth */
    float *device_sums;            /* as the device keeps them */
    float *device_pool;            /* sums of this and the other depth; see kernels/fit_sums.cl */
} check_fit;

/* `pairs` pairs of this depth and as many of the other one. */
void check_fit_make(check_fit *fit, check_state *state, size_t count, int pairs, int split);

/* The n-th image of `count` frequencies, as kernels take it. */
hada_fit_image check_fit_image(const check_fit *fit, size_t n);

#endif
