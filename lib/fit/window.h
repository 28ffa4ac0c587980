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

/* Adds a pair to the product of this iteration: its frame's spectra are in pair->raw_spectrum; pair->scene_spectrum
 * and pair->scene are overwritten. */
hada_status hada_fit_window_pair(hada_fit_window *window, hada_error *err);

/* Ends an iteration, in which every pair of the sums came. *converged: further ones would hardly change a filter. */
hada_status hada_fit_window_iterate(hada_fit_window *window, int *converged, hada_error *err);

/* The filters of a weight, [channel][layout.count]; -1: before the first iteration ends, those of the exact fit. */
const hada_buffer *hada_fit_window_filters(const hada_fit_window *window, int weight);

/* Mean squared error in the window of these filters on the pair in pair->raw_spectrum and pair->scene_pixels. */
hada_status hada_fit_window_error(hada_fit_window *window, int weight, double *error, hada_error *err);

/* The weight of what filters make outside the window: chosen by cross-validation, and the filters that come of it.
 * */
/* Weights that are compared; the last is 1, the exact fit. */
enum { HADA_FIT_OUTSIDES = 6 };

/* The least weight that may be given: iterations would not converge below it. */
#define HADA_FIT_LEAST_OUTSIDE 0.01

/* Filters in the place of the exact fit's, and what was compared. */
typedef struct hada_fit_outside {
    float *filters; /* as in a model; NULL: the exact fit's */
    int count;      /* weights that were compared; 0: none */
    int chosen;
    double weight[HADA_FIT_OUTSIDES], psnr[HADA_FIT_OUTSIDES];
} hada_fit_outside;

/* Solves filters of all depths with a weight, < 0: chosen by leaving pairs out. Where that is 1, or nothing can be left
 * out, *out is empty and the exact fit stays. `from` reads the pairs of the sums. Makes the pools. */
hada_status hada_fit_outside_solve(hada_fit_outside *out, hada_fit_sums *sums, hada_fit_reader *from,
                                   hada_fit_setting setting, double weight, hada_error *err);
void hada_fit_outside_free(hada_fit_outside *outside);

/* Decibels by which the chosen weight was better than the exact fit; 0 where nothing was compared. */
double hada_fit_outside_gain(const hada_fit_outside *outside);

#endif
