/* References of the losses, by their definitions, in double precision. Each returns weight * loss and adds its gradient
 * to dx (NULL: the value alone). Internal. */
#ifndef HADA_REF_LOSS_H
#define HADA_REF_LOSS_H

#include "ref/ref_layers.h"

/* Means over `count` values of d^2, |d| and binary cross-entropy of the logits x against t. */
double hada_ref_mse(size_t count, double weight, const double *x, const double *t, double *dx);
double hada_ref_l1(size_t count, double weight, const double *x, const double *t, double *dx);
double hada_ref_logits(size_t count, double weight, const double *x, const double *t, double *dx);

/* Total variation, summed over channels and pixels, averaged over images: of absolute values or squares. */
double hada_ref_variation(const hada_ref_shape *shape, int squared, double weight, const double *x, double *dx);

#endif
