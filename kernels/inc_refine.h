/* For the refinement's kernels over frequencies: values of REFINE_WIDTH frequencies side by side (eight in the vectors
 * of a CPU, one per work-item on a GPU), the slice of frequencies of a work-group, and sums over it in a fixed order.
 */
#ifndef INC_REFINE_H
#define INC_REFINE_H

#ifndef REFINE_WIDTH
#define REFINE_WIDTH 8
#endif
/* Work-items in a group; more than one only with REFINE_WIDTH 1. */
#ifndef REFINE_GROUP
#define REFINE_GROUP 1
#endif

#define WIDE_WIDTH REFINE_WIDTH
#include "inc_lanes.h"
#include "inc_wide.h"

#define REFINE_INLINE static inline __attribute__((always_inline))

typedef wide_real refine_real;
#define refine_sum wide_sum

#if REFINE_WIDTH == 8
REFINE_INLINE void refine_get(__global const float *p, size_t i, refine_real *re, refine_real *im)
{
    lanes_apart(vload8(0, p + 2 * i), vload8(1, p + 2 * i), re, im);
}

REFINE_INLINE void refine_put(__global float *p, size_t i, refine_real re, refine_real im)
{
    VECTORS_STORE8(__global, lanes_low(re, im), p + 2 * i);
    VECTORS_STORE8(__global, lanes_high(re, im), p + 2 * i + 8);
}

REFINE_INLINE refine_real refine_get_real(__global const float *p, size_t i)
{
    return lanes_real(vload8(0, p + i));
}

/* A frequency's energy counted as often as it occurs in the whole spectrum: interior columns of the half spectrum
 * twice, padding, which may hold anything, not at all. */
REFINE_INLINE refine_real refine_count(refine_real energy, uint i, uint rows, uint block, uint cols)
{
    const int kx = (int)(i / (rows * block) * block + i % block);
    const int8 k = LANES_ORDER + kx;
    const int8 once = (k == 0) | (2 * k == (int)cols), none = 2 * k > (int)cols;
    return select(select(2.0f * energy, energy, once), (float8)0.0f, none);
}

/* 0 at columns beyond a band: 2 kx >= band_cols. */
REFINE_INLINE refine_real refine_band(refine_real energy, uint i, uint rows, uint block, uint band_cols)
{
    const int8 k = LANES_ORDER + (int)(i / (rows * block) * block + i % block);
    return select(energy, (float8)0.0f, 2 * k >= (int)band_cols);
}
#else
REFINE_INLINE void refine_get(__global const float *p, size_t i, refine_real *re, refine_real *im)
{
    const float2 a = vload2(i, p);
    *re = a.x;
    *im = a.y;
}

REFINE_INLINE void refine_put(__global float *p, size_t i, refine_real re, refine_real im)
{
    vstore2((float2)(re, im), i, p);
}

REFINE_INLINE refine_real refine_get_real(__global const float *p, size_t i)
{
    return p[i];
}

REFINE_INLINE refine_real refine_count(refine_real energy, uint i, uint rows, uint block, uint cols)
{
    const uint k = i / (rows * block) * block + i % block;
    return k == 0 || 2 * k == cols ? energy : 2 * k > cols ? 0.0f : 2.0f * energy;
}

REFINE_INLINE refine_real refine_band(refine_real energy, uint i, uint rows, uint block, uint band_cols)
{
    return 2 * (i / (rows * block) * block + i % block) >= band_cols ? 0.0f : energy;
}
#endif

/* What a pixel of weight w keeps of the difference a - b between its light and its value b: w / (w + mu) of it. A
 * weight below zero is that of a saturated pixel, whose true value is b or more: it has the size |w|, and where a is
 * above b nothing is kept. For scalars and vectors. */
#define REFINE_LEAST_WEIGHT 1e-30f
#define REFINE_WEIGHED(difference, w, mu)                                                                              \
    (((w) < 0.0f ? min(difference, 0.0f) : (difference)) * (fabs(w) / fmax(fabs(w) + (mu), REFINE_LEAST_WEIGHT)))

/* The data step on values from ... to - 1 of a, in place, shared out to the group: e = scale (a - b), of which a pixel
 * keeps what its weight says; has_b 0: b is 0; has_weights 0: e itself. Returns the item's sum of e^2. */
REFINE_INLINE float refine_data_step(__global float *a, __global const float *b, int has_b,
                                     __global const float *weights, int has_weights, uint from, uint to, float scale,
                                     float mu)
{
    float sum = 0.0f;
#if REFINE_WIDTH == 8
    float8 lanes = (float8)0.0f;
    const uint whole = from + (to - from) / 8 * 8;
    for (uint i = from; i < whole; i += 8) {
        float8 v = vload8(0, a + i);
        if (has_b)
            v -= vload8(0, b + i);
        v *= scale;
        if (has_weights)
            v = REFINE_WEIGHED(v, vload8(0, weights + i), mu);
        VECTORS_STORE8(__global, v, a + i);
        lanes = fma(v, v, lanes);
    }
    sum = refine_sum(lanes);
    for (uint i = whole; i < to; ++i) {
#else
    for (uint i = from + get_local_id(0); i < to; i += REFINE_GROUP) {
#endif
        float v = (has_b ? a[i] - b[i] : a[i]) * scale;
        if (has_weights)
            v = REFINE_WEIGHED(v, weights[i], mu);
        a[i] = v;
        sum = fma(v, v, sum);
    }
    return sum;
}

/* The group's sum, as refine_tree[0] of its first item or as partial[group]: a tree, the same whatever the device does
 * at once. */
#if REFINE_GROUP > 1
#define REFINE_LOCAL __local float refine_tree[REFINE_GROUP];
#define REFINE_TREE(value)                                                                                             \
    {                                                                                                                  \
        const uint item = get_local_id(0);                                                                             \
        refine_tree[item] = value;                                                                                     \
        for (uint step = REFINE_GROUP / 2; step > 0; step /= 2) {                                                      \
            barrier(CLK_LOCAL_MEM_FENCE);                                                                              \
            if (item < step)                                                                                           \
                refine_tree[item] += refine_tree[item + step];                                                         \
        }                                                                                                              \
    }
#define REFINE_PARTIAL(partial, group, value)                                                                          \
    {                                                                                                                  \
        REFINE_TREE(value)                                                                                             \
        if (get_local_id(0) == 0)                                                                                      \
            (partial)[group] = refine_tree[0];                                                                         \
    }
#else
#define REFINE_LOCAL
#define REFINE_PARTIAL(partial, group, value) (partial)[group] = value;
#endif

#endif
