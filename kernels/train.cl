/* Training besides transforms and nets (docs/explanation/nets.md): gradients of Hadamard filters, the squared error of
 * planes. */
#include "inc_wide.h"
#include "shared_train.h"

/* Adds the gradient of filters: scale m conj(B) G (form complex), or scale m (Re(B) Re(G), Im(B) Im(G)) (split), for
 * spectra B of a frame and G of the gradient of a plane. m, from `weights`, is how often a value of the half spectrum
 * occurs in the whole one; where it is 0 (padding, which may hold anything) nothing is added. */
static inline float16 train_add(float16 b, float16 g, float8 m, int split, float16 sum)
{
    const int8 there = m > 0.0f;
    const float8 re = split ? b.even * g.even : fma(b.even, g.even, b.odd * g.odd);
    const float8 im = split ? b.odd * g.odd : fma(b.even, g.odd, -(b.odd * g.even));
    sum.even = select(sum.even, fma(m, re, sum.even), there);
    sum.odd = select(sum.odd, fma(m, im, sum.odd), there);
    return sum;
}

/* Dimension 0: groups of eight of the `count` frequencies, dimension 1: channels. `offset`: complex numbers before
 * B. */
__kernel void train_filter(__global const float *b, ulong offset, __global const float *g,
                           __global const float *weights, __global float *gradient, ulong count, float scale, int split)
{
    const size_t first = 8 * get_global_id(0), at = get_global_id(1) * count + first;
    if (first >= count)
        return;
    __global const float *raw = b + 2 * (offset + at), *plane = g + 2 * at;
    __global float *to = gradient + 2 * at;
    if (first + 8 <= count) {
        const float8 m = scale * vload8(0, weights + first);
        VECTORS_STORE16(__global, train_add(vload16(0, raw), vload16(0, plane), m, split, vload16(0, to)), to);
        return;
    }
    /* the last frequencies may not fill a group, and the next channel follows */
    float lanes[4][16] = {{0.0f}};
    const size_t left = count - first;
    for (size_t i = 0; i < 2 * left; i++) {
        lanes[0][i] = raw[i];
        lanes[1][i] = plane[i];
        lanes[2][i] = to[i];
        lanes[3][i / 2] = scale * weights[first + i / 2];
    }
    vstore16(train_add(vload16(0, lanes[0]), vload16(0, lanes[1]), vload8(0, lanes[3]), split, vload16(0, lanes[2])), 0,
             lanes[2]);
    for (size_t i = 0; i < 2 * left; i++)
        to[i] = lanes[2][i];
}

/* A work-item's values: HADA_TRAIN_RUN of them, the last one what is left of `count`. */
#define TRAIN_EACH(i, count)                                                                                           \
    for (size_t i = get_global_id(0) * HADA_TRAIN_RUN, train_end = min(i + HADA_TRAIN_RUN, (size_t)(count));           \
         i < train_end; i += 8)

/* x becomes scale (x - target); sums[work-item] = the sum of (x - target)^2 over its values. */
__kernel void train_error(__global float *x, __global const float *target, ulong count, float scale,
                          __global float *sums)
{
    float8 sum = 0.0f;
    if (get_global_id(0) * HADA_TRAIN_RUN >= count)
        return;
    TRAIN_EACH (i, count) {
        const float8 d = wide_get_some(x + i, count - i) - wide_get_some(target + i, count - i);
        sum = fma(d, d, sum);
        wide_put_some(scale * d, x + i, count - i);
    }
    sums[get_global_id(0)] = wide_sum(sum);
}
