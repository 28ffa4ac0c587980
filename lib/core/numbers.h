/* Values that are not finite, and systems of a few equations. Internal. */
#ifndef HADA_CORE_NUMBERS_H
#define HADA_CORE_NUMBERS_H

#include "core/base.h"

/* The number of values that are NaN or infinite; *largest: the largest magnitude of the others, 0 without any. */
size_t hada_not_finite(const float *values, size_t count, float *largest);

/* Whether distances can be those of depths: above 0 and finite, from near to far. A single one may be 0, not known;
 * NULL is none. HADA_ERROR_ARGUMENT. */
hada_status hada_distances_check(const double *distances_mm, int count, hada_error *err);

/* Normal equations and the like, by Cholesky's method. The factor of a symmetric matrix of n rows, in place, its lower
 * part; 0 where it is not positive. */
int hada_cholesky_factor(double *m, int n);
/* Solves the system of that factor: x is the right side before. */
void hada_cholesky_solve(const double *m, int n, double *x);

#endif
