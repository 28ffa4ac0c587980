/* Reference of the distance of features in LPIPS, by its definition. Internal. */
#ifndef HADA_REF_REF_LPIPS_H
#define HADA_REF_REF_LPIPS_H

#include "ref/ref_layers.h"

/* out[row][col] = sum over channels of w (a / (|a| + 1e-10) - b / (|b| + 1e-10))^2, with |.| the length over the
 * channels at a pixel: R. Zhang et al., CVPR 2018, Eq. 1, with the constant of the authors' package. a and b are one
 * image each. */
void hada_ref_lpips(const hada_ref_shape *shape, const double *a, const double *b, const double *w, double *out);

#endif
