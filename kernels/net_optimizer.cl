/* Optimisers: one step on an array of parameters (lib/net/optimizer.h). Dimension 1 counts runs of HADA_OPTIMIZER_RUN
 * values, dimension 0 the work-items that share a run. */
/* Values that a work-item takes at once. */
#ifndef OPTIMIZER_WIDTH
#define OPTIMIZER_WIDTH 8
#endif

#define WIDE_WIDTH OPTIMIZER_WIDTH
#include "inc_wide.h"
#include "shared_net.h"

#define OPTIMIZER_EACH(i, count)                                                                                       \
    for (uint i = get_global_id(1) * HADA_OPTIMIZER_RUN + OPTIMIZER_WIDTH * get_global_id(0);                          \
         i < min((uint)(get_global_id(1) + 1) * HADA_OPTIMIZER_RUN, count); i += OPTIMIZER_WIDTH * get_global_size(0))

/* State: v. */
__kernel void net_optimizer_rmsprop(__global const float *gradient, __global float *parameters, __global float *state,
                                    hada_update_layout at, hada_rmsprop rule)
{
    const uint count = at.count;
    const float scale = at.scale, rate = rule.rate, decay = rule.decay, rest = rule.rest, eps = rule.eps;
    __global const float *grad = gradient + at.gradient;
    __global float *values = parameters + at.parameters, *squares = state + at.state;
    OPTIMIZER_EACH (i, count) {
        const wide_real g = scale * wide_get_some(grad + i, count - i), p = wide_get_some(values + i, count - i);
        const wide_real v = fma((wide_real)decay, wide_get_some(squares + i, count - i), rest * g * g);
        wide_put_some(v, squares + i, count - i);
        wide_put_some(p - rate * g / sqrt(v + eps), values + i, count - i);
    }
}

/* State: m, v. */
__kernel void net_optimizer_adam(__global const float *gradient, __global float *parameters, __global float *state,
                                 hada_update_layout at, hada_adam rule)
{
    const uint count = at.count;
    const float scale = at.scale, rate1 = rule.rate, root2 = rule.inverse_root, beta1 = rule.beta1;
    const float rest1 = rule.rest1, beta2 = rule.beta2, rest2 = rule.rest2, eps = rule.eps;
    __global const float *grad = gradient + at.gradient;
    __global float *values = parameters + at.parameters, *means = state + at.state, *squares = means + count;
    OPTIMIZER_EACH (i, count) {
        const wide_real g = scale * wide_get_some(grad + i, count - i), p = wide_get_some(values + i, count - i);
        const wide_real m = fma((wide_real)beta1, wide_get_some(means + i, count - i), rest1 * g);
        const wide_real v = fma((wide_real)beta2, wide_get_some(squares + i, count - i), rest2 * g * g);
        wide_put_some(m, means + i, count - i);
        wide_put_some(v, squares + i, count - i);
        wide_put_some(fma((wide_real)-rate1, m / fma(sqrt(v), (wide_real)root2, (wide_real)eps), p), values + i,
                      count - i);
    }
}

/* Sums of squares, one per work-item. */
__kernel void net_optimizer_squares(__global const float *values, ulong offset, uint count, __global float *sums,
                                    ulong sums_offset)
{
    wide_real sum = 0.0f;
    OPTIMIZER_EACH (i, count) {
        const wide_real v = wide_get_some(values + offset + i, count - i);
        sum = fma(v, v, sum);
    }
    sums[sums_offset + get_global_id(1) * get_global_size(0) + get_global_id(0)] = wide_sum(sum);
}
