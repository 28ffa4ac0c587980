/* A depth's filters judged in the window alone, or with a weight for what they make outside. Internal.
 *
 * Per channel the filter W that minimises, over the pairs of a depth,
 *     sum |crop F^-1(B W) - scene|^2 + mu sum |rest of F^-1(B W)|^2 + (the terms of alpha and lambda of the exact fit)
 * With P and D as in kernels/fit_window.cl, W0 = P^-1 Sxb the exact fit's filter and sigma = mu / (1 - mu) that is
 *     W(mu) = (T + sigma)^-1 W0 / (1 - mu),        T = P^-1 (N + D)
 * T is symmetric and positive where <u, v> = sum of u P v, so conjugate gradients find W(mu), and for several mu at
 * once from the same products with T: B. Jegerlehner, "Krylov space solvers for shifted linear systems",
 * hep-lat/9612014. A product takes one look at every pair. Results are the same bits at every run. */
#ifndef HADA_FIT_WINDOW_H
#define HADA_FIT_WINDOW_H

#include "fit/fitter.h"

/* Rounds at most, and the size of what is left, relative to where it began, at which rounds end. */
enum { HADA_FIT_ROUNDS = 12, HADA_FIT_WEIGHTS = 5 };
#define HADA_FIT_SETTLED 2e-3

typedef struct hada_fit_window hada_fit_window;

/* For at most `most` (<= HADA_FIT_WEIGHTS) weights at once. */
hada_status hada_fit_window_create(hada_fit_window **out, hada_fitter *fitter, int most, hada_error *err);
void hada_fit_window_destroy(hada_fit_window **window);

/* Begins with the sums on the device, which are of depth z (or of some of its pairs). outside: ascending, > 0, < 1. */
hada_status hada_fit_window_begin(hada_fit_window *window, int z, double alpha, double lambda, const double *outside,
                                  int count, hada_error *err);

/* A pair of this round, whose frame's spectra stand in fitter->b; fitter->x and fitter->scene are overwritten. */
hada_status hada_fit_window_pair(hada_fit_window *window, hada_error *err);

/* Ends a round, in which every pair of the sums was shown. *settled: further rounds would hardly change a filter. */
hada_status hada_fit_window_round(hada_fit_window *window, int *settled, hada_error *err);

/* The filters of a weight, [channel][layout.count]; -1: before the first round, those of the exact fit. */
const hada_buffer *hada_fit_window_filters(const hada_fit_window *window, int weight);

/* Mean squared error in the window of these filters on the pair in fitter->b and fitter->scene_pixels. */
hada_status hada_fit_window_error(hada_fit_window *window, int weight, double *error, hada_error *err);

#endif
