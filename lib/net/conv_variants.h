/* What a tuner may try for a convolution. Internal. */
#ifndef HADA_NET_CONV_VARIANTS_H
#define HADA_NET_CONV_VARIANTS_H

#include "net/conv_internal.h"

enum { HADA_CONV_VARIANTS = 64 };

/* The choices that could serve the forward pass of a plan, the likely ones first; returns how many. Kernels are those
 * of the manifest alone, so that a tuning file holds for offline devices too. */
int hada_conv_variants(const hada_context *context, const hada_conv_plan *plan,
                       hada_conv_choice choices[HADA_CONV_VARIANTS]);

#endif
