/* Reference of filters judged in the window, in double precision, one channel of one depth at a time. Internal.
 *
 * The filter W that minimises, over pairs of frames' spectra b and scenes' spectra x,
 *     sum |window of F^-1(B W) - scene|^2 + outside sum |rest of F^-1(B W)|^2 + sum over frequencies of D |W|^2 /
 * points with D = alpha * other + ridge (split: by parts, as in ref_fit.h), by conjugate gradients on its normal
 * equations, M. Hestenes and E. Stiefel, J. Res. Nat. Bur. Stand. 49(6), 409 (1952), with their diagonal as
 * preconditioner. */
#ifndef HADA_REF_FIT_WINDOW_H
#define HADA_REF_FIT_WINDOW_H

#include <stddef.h>

#include "ref/ref_filter.h"

typedef struct hada_ref_fit_window {
    const hada_ref_grid *grid;
    const double *const *b; /* of each pair: rows x (cols/2 + 1) complex numbers */
    int pairs, split;
    const double *sums, *other; /* as in ref_fit.h, of these pairs */
    double alpha, ridge, outside;
} hada_ref_fit_window;

/* The left side of the normal equations at W: outside Sbb W + D W + (1 - outside) N W. */
hada_status hada_ref_fit_window_apply(const hada_ref_fit_window *fit, const double *w, double *out, hada_error *err);

/* Until the residual is 1e-10 of the right side. */
hada_status hada_ref_fit_window_solve(const hada_ref_fit_window *fit, double *w, hada_error *err);

#endif
