/* A depth's transfer functions on a coarse grid, from which cropped.h begins. Internal.
 *
 * Where the sensor crops, the smooth part of a wide point spread function comes slowly: what lies mostly beyond the
 * sensor is hardly seen, and a bright smooth part there is exchanged for one within. Passes over whole frames take
 * hundreds for it; but it is smooth, so cells of several pixels are enough for it. Of frames and scenes averaged over
 * cells, per channel, the coarse h that minimises
 *     sum |b - crop(h * x)|^2 + q m |h|^2,      m the mean of Sxx over frequencies,
 * is found by conjugate gradients with 1 / (Sxx + q m) as the preconditioner (J. Nocedal and S. Wright, Numerical
 * Optimization, 2006, algorithm 5.3). Cells count where the sensor has all of their pixels and one of them is known.
 * Results are the same bits at every run. docs/explanation/learning-a-camera.md has the figures. */
#ifndef HADA_FIT_COARSE_H
#define HADA_FIT_COARSE_H

#include "fit/fit_grid.h"

typedef struct hada_fit_coarse hada_fit_coarse;

/* For pairs of such a grid. *out stays NULL where no cells divide it. monitor: may be NULL. */
hada_status hada_fit_coarse_create(hada_fit_coarse **out, const hada_fit_grid *fine, const hada_monitor *monitor,
                                   hada_error *err);
void hada_fit_coarse_destroy(hada_fit_coarse **coarse);

/* Forgets all pairs; so many are added next. */
hada_status hada_fit_coarse_begin(hada_fit_coarse *coarse, int64_t pairs, hada_error *err);

/* Takes the pair that was read into `pair`, of the fine grid. */
hada_status hada_fit_coarse_add(hada_fit_coarse *coarse, const hada_fit_pair *pair, hada_error *err);

/* The transfer functions of the fine grid, 0 at frequencies that cells do not have: [channel][plane] complex, in rows.
 * left_out: of each pair, not 0 where it has no part. */
hada_status hada_fit_coarse_solve(hada_fit_coarse *coarse, const unsigned char *left_out, float *otf, hada_error *err);

#endif
