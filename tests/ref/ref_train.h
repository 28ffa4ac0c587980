/* Reference of training filters in double precision: a plane by a filter, and the gradients that flow back. Internal.
 *
 * docs/explanation/nets.md derives them; tests hold them against differences and against PyTorch's autograd. */
#ifndef HADA_REF_TRAIN_H
#define HADA_REF_TRAIN_H

#include "ref/ref_filter.h"

/* window = crop(inverse(spectrum * filter)), as hada_ref_hadamard(), with a filter in double precision. */
hada_status hada_ref_train_plane(const hada_ref_grid *grid, const double *spectrum, const double *filter, int split,
                                 double *window, hada_error *err);

/* Adds to `gradient` (a row-major half spectrum) the derivative of a loss by the filter's real and imaginary parts,
 * given that by the window's pixels. */
hada_status hada_ref_train_filter(const hada_ref_grid *grid, const double *spectrum, const double *window_gradient,
                                  int split, double *gradient, hada_error *err);

#endif
