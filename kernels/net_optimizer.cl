/* Optimisers: one step on an array of parameters (lib/net/optimizer.h). Dimension 1 counts runs of HADA_OPTIMIZER_RUN
 * values, dimension 0 the work-items that share a run. */

#include "inc_vectors.h"
#include "shared_net.h"

/* Values that a work-item takes at once: a vector on CPUs, or one, so that neighbouring work-items access neighbouring
 * values; arrays begin anywhere. */
#ifndef OPTIMIZER_WIDTH
#define OPTIMIZER_WIDTH 8
#endif

#define OPTIMIZER_INLINE static inline __attribute__((always_inline))

#if OPTIMIZER_WIDTH == 8
typedef float8 optimizer_v;

/* Values of the array as a vector; beyond its end nothing is read or written. */
OPTIMIZER_INLINE optimizer_v optimizer_get(__global const float *p, uint first, uint count)
{
    if (first + 8 <= count)
        return vload8(0, p + first);
    float lane[8];
    for (uint i = 0; i < 8; i++)
        lane[i] = first + i < count ? p[first + i] : 0.0f;
    return vload8(0, lane);
}

OPTIMIZER_INLINE void optimizer_put(optimizer_v v, __global float *p, uint first, uint count)
{
    if (first + 8 <= count) {
        VECTORS_STORE8(__global, v, p + first);
        return;
    }
    float lane[8];
    vstore8(v, 0, lane);
    for (uint i = 0; first + i < count; i++)
        p[first + i] = lane[i];
}

OPTIMIZER_INLINE float optimizer_sum(optimizer_v v)
{
    const float4 a = v.lo + v.hi;
    return (a.x + a.z) + (a.y + a.w);
}
#else
typedef float optimizer_v;

OPTIMIZER_INLINE optimizer_v optimizer_get(__global const float *p, uint first, uint count)
{
    return p[first];
}

OPTIMIZER_INLINE void optimizer_put(optimizer_v v, __global float *p, uint first, uint count)
{
    p[first] = v;
}

OPTIMIZER_INLINE float optimizer_sum(optimizer_v v)
{
    return v;
}
#endif

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
        const optimizer_v g = scale * optimizer_get(grad, i, count), p = optimizer_get(values, i, count);
        const optimizer_v v = fma((optimizer_v)decay, optimizer_get(squares, i, count), rest * g * g);
        optimizer_put(v, squares, i, count);
        optimizer_put(p - rate * g / sqrt(v + eps), values, i, count);
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
        const optimizer_v g = scale * optimizer_get(grad, i, count), p = optimizer_get(values, i, count);
        const optimizer_v m = fma((optimizer_v)beta1, optimizer_get(means, i, count), rest1 * g);
        const optimizer_v v = fma((optimizer_v)beta2, optimizer_get(squares, i, count), rest2 * g * g);
        optimizer_put(m, means, i, count);
        optimizer_put(v, squares, i, count);
        optimizer_put(fma((optimizer_v)-rate1, m / fma(sqrt(v), (optimizer_v)root2, (optimizer_v)eps), p), values, i,
                      count);
    }
}

/* Sums of squares, one per work-item. */
__kernel void net_optimizer_squares(__global const float *values, ulong offset, uint count, __global float *sums,
                                    ulong sums_offset)
{
    optimizer_v sum = 0.0f;
    OPTIMIZER_EACH (i, count) {
        const optimizer_v v = optimizer_get(values + offset, i, count);
        sum = fma(v, v, sum);
    }
    sums[sums_offset + get_global_id(1) * get_global_size(0) + get_global_id(0)] = optimizer_sum(sum);
}
