/* A depth's filters by the error in the window, and that outside with a weight mu. Internal.
 *
 * Per channel the filter W that minimises, over the pairs of a depth,
 *     sum |crop F^-1(B W) - scene|^2 + mu sum |rest of F^-1(B W)|^2 + (the terms of alpha and lambda of the exact fit)
 * With P and D as in kernels/fit_window.cl, W0 = P^-1 Sxb the exact fit's filter and sigma = mu / (1 - mu) that is
 *     W(mu) = (T + sigma)^-1 W0 / (1 - mu),        T = P^-1 (N + D)
 * T is symmetric and positive where <u, v> = sum of u P v, so conjugate gradients find W(mu), and for several mu at
 * once from the same products with T: B. Jegerlehner, "Krylov space solvers for shifted linear systems",
 * hep-lat/9612014. A product passes over every pair once. Results are the same bits at every run. */
#ifndef HADA_FIT_WINDOW_H
#define HADA_FIT_WINDOW_H

#include "fit/fit_sums.h"

/* Iterations at most, and the norm of the residual, relative to where it began, at which they end
 * (docs/explanation/learning-a-camera.md). */
enum { HADA_FIT_ITERATIONS = 12, HADA_FIT_WEIGHTS = 5 };
#define HADA_FIT_TOLERANCE 2e-3

typedef struct hada_fit_window hada_fit_window;

/* For at most `most` (<= HADA_FIT_WEIGHTS) weights at once. The pair's spectra and pixels are used as said below. */
hada_status hada_fit_window_create(hada_fit_window **out, const hada_fit_sums *sums, hada_fit_pair *pair, int most,
                                   hada_error *err);
void hada_fit_window_destroy(hada_fit_window **window);

/* Begins with the sums on the device, which are of depth z (or of some of its pairs). outside: the weights mu,
 * ascending, > 0, < 1. */
hada_status hada_fit_window_begin(hada_fit_window *window, int z, hada_fit_setting setting, const double *outside,
                                  int count, hada_error *err);

/* Adds a pair to the product of this iteration: its frame's spectra stand in pair->raw_spectrum; pair->scene_spectrum
 * and pair->scene are overwritten. */
hada_status hada_fit_window_pair(hada_fit_window *window, hada_error *err);

/* Ends an iteration, in which every pair of the sums came. *converged: further ones would hardly change a filter. */
hada_status hada_fit_window_iterate(hada_fit_window *window, int *converged, hada_error *err);

/* The filters of a weight, [channel][layout.count]; -1: before the first iteration ends, those of the exact fit. */
const hada_buffer *hada_fit_window_filters(const hada_fit_window *window, int weight);

/* Mean squared error in the window of these filters on the pair in pair->raw_spectrum and pair->scene_pixels. */
hada_status hada_fit_window_error(hada_fit_window *window, int weight, double *error, hada_error *err);

#endif
