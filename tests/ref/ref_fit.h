/* Reference of the exact fit, in double precision, one channel at a time. Internal.
 *
 * Spectra are arrays of `count` complex numbers, re and im interleaved; sums are HADA_REF_FIT_SUMS arrays of `count`
 * values one after the other: sum X conj(B) (re, im), sum |B|^2, sum |X|^2, sum Xr Br, sum Br^2. */
#ifndef HADA_REF_FIT_H
#define HADA_REF_FIT_H

#include <stddef.h>

#include "ref/ref_filter.h"

enum { HADA_REF_FIT_SUMS = 6 };

/* Adds `sign` times a pair (-1 takes it out again). */
void hada_ref_fit_pair(const double *x, const double *b, size_t count, double sign, double *sums);

/* W = Sxb / (Sbb + alpha * other + ridge); split: the real and the imaginary part by themselves, with half the ridge.
 * `other`: sum |B|^2 and then sum Br^2 of the other depths, 2 * count values. */
void hada_ref_fit_filter(const double *sums, const double *other, size_t count, double alpha, double ridge, int split,
                         double *filter);

/* H = conj(Sxb) / max(Sxx, least). */
void hada_ref_fit_transfer(const double *sums, size_t count, double least, double *otf);

/* Transfer functions of non-negative images: lib/fit/nonnegative.h, by textbook ADMM with x, u and d by themselves.
 * `sums` of a half spectrum in rows, rows x (cols/2 + 1); `weights`: of the steps. */
hada_status hada_ref_fit_nonnegative(const double *sums, int rows, int cols, double mean, int steps,
                                     const double *weights, double relaxation, double trust, double *otf,
                                     hada_error *err);

/* By brute force: fits without the pair, and returns the sum of squared errors in the window of the grid; *leak takes
 * the sum of weight |W|^2 seen (split: part by part), `seen` as `other` but the mean over pairs and other depths.
 * Negative without memory. */
double hada_ref_fit_leave_one_out(const hada_ref_grid *grid, const double *x, const double *b, const double *sums,
                                  const double *other, const double *seen, const double *weights, double alpha,
                                  double ridge, int split, double *leak);

/* Sum of weight (Sbb - |Sxb|^2 / max(Sxx, least)). */
double hada_ref_fit_unexplained(const double *sums, const double *weights, size_t count, double least);

#endif
