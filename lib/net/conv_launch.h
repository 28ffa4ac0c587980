/* A convolution on its device, and the launches of each implementation. Internal to lib/net. */
#ifndef HADA_NET_CONV_LAUNCH_H
#define HADA_NET_CONV_LAUNCH_H

#include "net/conv_plan.h"

struct hada_conv {
    hada_slot *slot;
    hada_conv_plan plan;
    hada_buffer weights[HADA_CONV_PASSES], scratch;
    int has_weights;
};

/* What is done with a finished sum (hada_conv_epilogue). */
typedef struct hada_conv_finish {
    hada_floats bias;
    hada_activation activation;
    float slope;
    const hada_tensor *mask, *pooled; /* NULL: none */
    int accumulate;
} hada_conv_finish;

/* States what the next launch needs at least, for profiles: the products of the definition. */
void hada_conv_cost(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine);

/* What kernels take of a pass. pools: the pooled output is written at once. */
hada_conv_problem hada_conv_problem_of(const hada_conv *conv, int pass, const hada_tensor *in, const hada_tensor *out,
                                       const hada_conv_finish *finish, int pools);

static inline cl_mem hada_conv_mask(const hada_conv_finish *finish)
{
    return finish->mask ? finish->mask->mem : NULL;
}

hada_status hada_conv_pack(hada_conv *conv, int pass, hada_floats weights, hada_error *err);

/* Launches of one implementation; pooling is done in a launch of its own where the implementation does not. */
hada_status hada_conv_direct(hada_conv *conv, int pass, const hada_tensor *in, const hada_tensor *out,
                             const hada_conv_finish *finish, hada_error *err);
hada_status hada_conv_plain(hada_conv *conv, int pass, const hada_tensor *in, const hada_tensor *out,
                            const hada_conv_finish *finish, hada_error *err);
hada_status hada_conv_winograd(hada_conv *conv, int pass, const hada_tensor *in, const hada_tensor *low,
                               const hada_tensor *out, const hada_conv_finish *finish, hada_error *err);
hada_status hada_conv_winograd_pack(hada_conv *conv, int pass, hada_floats weights, hada_error *err);

/* The gradients of weights and biases (db NULL: none), after all checks. */
hada_status hada_conv_gradients(hada_conv *conv, const hada_tensor *x, const hada_tensor *dy, hada_floats dw,
                                hada_floats db, int accumulate, hada_error *err);

#endif
