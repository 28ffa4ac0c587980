/* The sums of a fit: for each frequency FIT_SUMS numbers, each as a float and the rest that rounding lost (their sum
 * has about 48 bits). Sum k has its floats at sums + 2 k stride, its rests one stride further.
 *
 * 0, 1: sum X conj(B), re and im; 2: sum |B|^2; 3: sum |X|^2. FIT_SPLIT adds 4: sum Xr Br; 5: sum Br^2 (the imaginary
 * ones are the differences 0 - 4 and 2 - 5). All kernels take eight frequencies at a time. */
#ifndef INC_FIT_H
#define INC_FIT_H

#include "inc_vectors.h"
#include "shared_fit.h"

#ifndef FIT_SPLIT
#define FIT_SPLIT 0
#endif

/* Work-items of a chunk: one on CPUs or (FIT_SHARED, for work-groups) one for each vector, whose sums go through a tree
 * in local memory. */
#ifndef FIT_SHARED
#define FIT_SHARED 0
#endif

/* rounding errors are computed exactly below: a fused multiply-add would spoil them */
#pragma OPENCL FP_CONTRACT OFF

/* Eight values of an array that begins at a multiple of 128 bits, as sums, pools and weights do. */
static inline float8 fit_eight(size_t i, __global const float *p)
{
#if FIT_SHARED
    return (float8)(((__global const float4 *)p)[2 * i], ((__global const float4 *)p)[2 * i + 1]);
#else
    return vload8(i, p);
#endif
}

static inline float8 fit_high(__global const float *sums, ulong stride, int k, size_t i)
{
    return fit_eight(i, sums + (size_t)(2 * k) * stride);
}

static inline float8 fit_low(__global const float *sums, ulong stride, int k, size_t i)
{
    return fit_eight(i, sums + (size_t)(2 * k + 1) * stride);
}

/* Adds a value: D. E. Knuth's two-sum keeps what rounding loses, a second sum puts the pair back in order. */
static inline void fit_add(__global float *sums, ulong stride, int k, size_t i, float8 value)
{
    const float8 high = fit_high(sums, stride, k, i), low = fit_low(sums, stride, k, i);
    const float8 sum = high + value, back = sum - high;
    const float8 rest = ((high - (sum - back)) + (value - back)) + low;
    const float8 whole = sum + rest;
    VECTORS_STORE8(__global, whole, sums + (size_t)(2 * k) * stride + 8 * i);
    VECTORS_STORE8(__global, rest - (whole - sum), sums + (size_t)(2 * k + 1) * stride + 8 * i);
}

/* A sum without one of its values, rounded once at the end. */
static inline float8 fit_without(__global const float *sums, ulong stride, int k, size_t i, float8 value)
{
    const float8 high = fit_high(sums, stride, k, i), low = fit_low(sums, stride, k, i);
    const float8 sum = high - value, back = sum - high;
    return sum + (((high - (sum - back)) - (value + back)) + low);
}

static inline float8 fit_divide(float8 over, float8 under)
{
    return under > 0.0f ? over / under : (float8)0.0f;
}

static inline float16 fit_divide_parts(float16 over, float16 under)
{
    float16 result;
    result.even = fit_divide(over.even, under.even);
    result.odd = fit_divide(over.odd, under.odd);
    return result;
}

static inline float fit_total(float8 value)
{
    const float4 half_sum = value.lo + value.hi;
    return (half_sum.x + half_sum.y) + (half_sum.z + half_sum.w);
}

/* The last values of an image may not fill a group of eight, and the next image follows. */
static inline void fit_put(float16 value, size_t i, ulong count, __global float *image)
{
    if (8 * i + 8 <= count) {
        VECTORS_STORE16(__global, value, image + 16 * i);
    } else {
        float each[16];
        vstore16(value, 0, each);
        for (size_t k = 0; k < 2 * (count - 8 * i); k++)
            image[16 * i + k] = each[k];
    }
}

/* Work-items beyond the last chunk add nothing. */
#if FIT_SHARED
#define FIT_MEMBERS    HADA_FIT_CHUNK
#define FIT_GROUP      HADA_FIT_GROUP
#define FIT_LOCAL      __local float fit_parts[FIT_GROUP];
#define FIT_TOTAL(sum) fit_shared_total(fit_total(sum), fit_parts)
/* One of several sums that are kept at once: eight lanes of each would take all registers. */
#define FIT_KEPT            float
#define FIT_KEEP(value)     fit_total(value)
#define FIT_KEPT_TOTAL(sum) fit_shared_total(sum, fit_parts)

static inline __attribute__((always_inline)) float fit_shared_total(float own, __local float *parts)
{
    const int item = get_local_id(0), member = item % FIT_MEMBERS;
    parts[item] = own;
    for (int left = FIT_MEMBERS / 2; left > 0; left /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (member < left)
            parts[item] += parts[item + left];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    own = parts[item - member];
    barrier(CLK_LOCAL_MEM_FENCE); /* before the next sum */
    return own;
}
#else
#define FIT_MEMBERS 1
#define FIT_GROUP   1
#define FIT_LOCAL
#define FIT_TOTAL(sum)      fit_total(sum)
#define FIT_KEPT            float8
#define FIT_KEEP(value)     (value)
#define FIT_KEPT_TOTAL(sum) fit_total(sum)
#endif

/* The work-item's chunk; its vectors are those from the first one on, every FIT_MEMBERS-th, before the last. */
typedef struct fit_share {
    size_t chunk, first, last;
    int writes; /* the chunk's sum */
} fit_share;

static inline fit_share fit_share_of(hada_fit_image image)
{
    const size_t member = get_global_id(0) % FIT_MEMBERS;
    fit_share share;
    share.chunk = get_global_id(0) / FIT_MEMBERS;
    share.first = share.chunk * HADA_FIT_CHUNK + member;
    share.last = min(share.chunk * HADA_FIT_CHUNK + HADA_FIT_CHUNK, (size_t)image.vectors);
    share.writes = !member && share.chunk < image.chunks;
    return share;
}

/* The denominator of a filter, for its real (even) and imaginary (odd) part: own |B|^2 + alpha * that of the other
 * depths + ridge; split: of each part separately, with half the ridge. */
typedef struct fit_under {
    float16 own, whole;
} fit_under;

static inline fit_under fit_under_of(__global const float *sums, __global const float *pool, ulong stride,
                                     hada_fit_penalty penalty, size_t i)
{
    const float alpha = penalty.alpha, ridge = penalty.ridge;
    const float8 raw = fit_high(sums, stride, 2, i), other = max(fit_eight(i, pool) - raw, 0.0f);
    fit_under under;
#if FIT_SPLIT
    const float8 part = fit_high(sums, stride, 5, i);
    const float8 other_r = clamp(fit_eight(i, pool + 3 * stride) - part, 0.0f, other);
    under.own.even = part;
    under.own.odd = max((raw - part) + (fit_low(sums, stride, 2, i) - fit_low(sums, stride, 5, i)), 0.0f);
    under.whole.even = part + alpha * other_r + 0.5f * ridge;
    under.whole.odd = under.own.odd + alpha * (other - other_r) + 0.5f * ridge;
#else
    under.own.even = under.own.odd = raw;
    under.whole.even = under.whole.odd = raw + alpha * other + ridge;
#endif
    return under;
}

/* A pair's contribution to the sums. */
typedef struct fit_terms {
    float8 cross_re, cross_im, raw, scene, split_cross, split_raw;
} fit_terms;

static inline fit_terms fit_terms_of(float16 x, float16 b)
{
    const float8 xr = x.even, xi = x.odd, br = b.even, bi = b.odd;
    fit_terms terms;
    terms.split_cross = xr * br;
    terms.split_raw = br * br;
    terms.cross_re = terms.split_cross + xi * bi;
    terms.cross_im = xi * br - xr * bi;
    terms.raw = terms.split_raw + bi * bi;
    terms.scene = xr * xr + xi * xi;
    return terms;
}

#endif
