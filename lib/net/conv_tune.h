/* The tuner of convolutions, for its tests. Internal. */
#ifndef HADA_NET_CONV_TUNE_H
#define HADA_NET_CONV_TUNE_H

#include <hadalens/tune.h>

#include "net/conv.h"
#include "runtime/slot.h"

/* A row as a description: forward, one image, bias and ReLU. */
hada_conv_desc hada_tune_conv_desc(const hada_tune_conv_row *row);

/* Called with what a variant computed, before that is compared; may change it. */
typedef void (*hada_conv_tune_probe)(void *user, const char *variant, float *values, size_t count);

/* As hada_tune_conv(). */
hada_status hada_conv_tune(hada_slot *slot, hada_tune_conv_row *row, double seconds, hada_conv_tune_probe probe,
                           void *user, hada_error *err);

#endif
