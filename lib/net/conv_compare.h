/* A convolution held against the plain one, on random values. Internal. */
#ifndef HADA_NET_CONV_COMPARE_H
#define HADA_NET_CONV_COMPARE_H

#include "net/conv_internal.h"

/* Relative rms from the plain convolution: what docs/explanation/speed-and-accuracy.md states against double precision,
 * and as much for the plain one itself. */
#define HADA_CONV_COMPARE_MOST 2e-6

typedef struct hada_conv_compare {
    hada_slot *slot;
    hada_conv_desc desc;
    hada_buffer x, y, weights, bias;
    hada_tensor in, out;
    float *expected, *got; /* out.image_stride values: of the plain one, and of another */
} hada_conv_compare;

/* An image, weights of a scale that keeps values near 1, and what the plain convolution makes of them. Whatever it
 * returns, hada_conv_compare_end() frees what there is. */
hada_status hada_conv_compare_begin(hada_conv_compare *compare, hada_slot *slot, const hada_conv_desc *desc,
                                    hada_error *err);
void hada_conv_compare_end(hada_conv_compare *compare);

/* What a convolution gives, with zeros where it writes nothing; run: computes it again and waits. */
hada_status hada_conv_compare_values(hada_conv_compare *compare, hada_conv *conv, float *values, hada_error *err);
hada_status hada_conv_compare_run(hada_conv_compare *compare, hada_conv *conv, hada_error *err);

/* Relative rms of `got` from `expected`. */
double hada_conv_compare_apart(const hada_conv_compare *compare);

#endif
