/* Transforms by work-groups: `width` transforms side by side in scratch memory, point i of transform w at
 * scratch[i * width + w] as (re, im); the work-items share out the butterflies of each stage and meet at a barrier.
 * Stages work in place; one without a butterfly of its own writes to a second scratch of the same size. */
#ifndef INC_FFT_GROUPS_H
#define INC_FFT_GROUPS_H

#define FFT_V float
#include "inc_fft_radix.h"
#include "shared_fft_table.h"

/* FFT_SCRATCH_GLOBAL: scratch lies in global memory, for transforms too long for local memory. */
#ifndef FFT_SCRATCH_GLOBAL
#define FFT_SCRATCH_GLOBAL 0
#endif
#if FFT_SCRATCH_GLOBAL
#define FFT_MEM    __global
#define FFT_WAIT() barrier(CLK_GLOBAL_MEM_FENCE)
#else
#define FFT_MEM    __local
#define FFT_WAIT() barrier(CLK_LOCAL_MEM_FENCE)
#endif

/* The group's scratch, for `width` transforms of a table. */
FFT_INLINE FFT_MEM float2 *fft_own_scratch(FFT_MEM float2 *scratches, __global const int *table, int width)
{
#if FFT_SCRATCH_GLOBAL
    return scratches + get_group_id(0) * (size_t)(table[FFT_POINTS] * width * (table[FFT_ODD] ? 2 : 1));
#else
    return scratches;
#endif
}

/* i = 0..total-1 shared out among the work-items. Every item makes the same number of rounds: where loops with a test
 * of their own stand on both sides of a barrier, PoCL threads the tests together and the barrier into their branches.
 */
#define FFT_SHARE(i, total)                                                                                            \
    for (int i##_round = 0, i = get_local_id(0); i##_round < (total);                                                  \
         i##_round += get_local_size(0), i += get_local_size(0))                                                       \
        if (i < (total))

/* The work-items of a group over `width` transforms side by side, a power of two: an item stays with one of them. */
typedef struct fft_side {
    int width, w;    /* transforms, that of the item */
    int first, step; /* the item's share of what a transform has: first, first + step, ... */
} fft_side;

FFT_INLINE fft_side fft_side_of(int width)
{
    fft_side side;
    const int shift = 31 - clz(width), item = get_local_id(0);
    side.width = width;
    side.w = item & (width - 1);
    side.first = item >> shift;
    side.step = (int)get_local_size(0) >> shift;
    return side;
}

/* i = 0..total-1 of each transform shared out among its work-items; rounds as above. */
#define FFT_SHARE_SIDE(i, total, side)                                                                                 \
    for (int i##_round = 0, i = (side).first; i##_round < (total); i##_round += (side).step, i += (side).step)         \
        if (i < (total))

/* b / span by the stage's factor. */
FFT_INLINE int fft_quotient(int b, int span, int magic)
{
    return magic ? (int)mul_hi((uint)b, (uint)magic) : span > 1 ? b / span : b;
}

FFT_INLINE float2 fft_twiddled(float2 x, float c, float d)
{
    return (float2)(fma(x.x, c, -(x.y * d)), fma(x.x, d, x.y * c));
}

#define FFT_FETCH(k)                                                                                                   \
    {                                                                                                                  \
        const float2 v = q[k * step];                                                                                  \
        re[k] = v.x;                                                                                                   \
        im[k] = v.y;                                                                                                   \
    }
#define FFT_LEAVE(k)         q[k * step] = (float2)(re[k], im[k]);
#define FFT_TIMES_TWIDDLE(k) fft_times_twiddle(&re[k], &im[k], w[k - 1].x, w[k - 1].y);

/* A stage of radix R, in place; `back`: decimation in frequency, from natural to digit-reversed order. */
#define FFT_STAGE(R)                                                                                                   \
    FFT_INLINE void fft_stage##R(FFT_MEM float2 *scratch, int points, fft_side side, int span, int magic,              \
                                 __global const float2 *twiddles, int back)                                            \
    {                                                                                                                  \
        const int step = span * side.width;                                                                            \
        FFT_SHARE_SIDE(b, points / R, side)                                                                            \
        {                                                                                                              \
            const int block = fft_quotient(b, span, magic), j = b - block * span;                                      \
            FFT_MEM float2 *q = scratch + (block * R * span + j) * side.width + side.w;                                \
            __global const float2 *w = twiddles + (R - 1) * j;                                                         \
            float re[R], im[R];                                                                                        \
            FFT_EACH(R, FFT_FETCH)                                                                                     \
            if (!back) {                                                                                               \
                FFT_AFTER_FIRST_##R(FFT_TIMES_TWIDDLE);                                                                \
            }                                                                                                          \
            fft_radix##R(re, im);                                                                                      \
            if (back) {                                                                                                \
                FFT_AFTER_FIRST_##R(FFT_TIMES_TWIDDLE);                                                                \
            }                                                                                                          \
            FFT_EACH(R, FFT_LEAVE)                                                                                     \
        }                                                                                                              \
    }

FFT_EACH_RADIX(FFT_STAGE)

FFT_INLINE void fft_stage(FFT_MEM float2 *scratch, int points, fft_side side, __global const int *stage,
                          __global const float *floats, int back)
{
    const int span = stage[FFT_SPAN], magic = stage[FFT_MAGIC];
    __global const float2 *w = (__global const float2 *)(floats + stage[FFT_TWIDDLES]);
    switch (stage[FFT_RADIX]) {
        FFT_CASES(fft_stage, (scratch, points, side, span, magic, w, back))
    default: break;
    }
}

FFT_INLINE int fft_has_butterfly(int radix)
{
    return radix <= 5 || radix == 7 || radix == 8;
}

/* An odd radix by its definition. First, in place: x[k] and x[p-k], times their twiddle factors, become a[k] = x[k] +
 * x[p-k] and b[k] = x[k] - x[p-k]. */
FFT_INLINE void fft_odd_pairs(FFT_MEM float2 *scratch, int points, fft_side side, int radix, int span, int magic,
                              __global const float *twiddles)
{
    const int pairs = radix / 2, step = span * side.width;
    FFT_SHARE_SIDE(i, points / radix * pairs, side)
    {
        const int k = i / (points / radix) + 1, b = i % (points / radix), block = fft_quotient(b, span, magic);
        const int j = b - block * span;
        FFT_MEM float2 *q = scratch + (block * radix * span + j) * side.width + side.w;
        __global const float *w = twiddles + 2 * (radix - 1) * j;
        const float2 x = fft_twiddled(q[k * step], w[2 * k - 2], w[2 * k - 1]);
        const float2 y = fft_twiddled(q[(radix - k) * step], w[2 * (radix - k) - 2], w[2 * (radix - k) - 1]);
        q[k * step] = x + y;
        q[(radix - k) * step] = x - y;
    }
}

/* Then, into the other scratch: X[m], X[p-m] = x[0] + sum a[k] cos(2 pi m k / p)  -+  i sum b[k] sin(2 pi m k / p). */
FFT_INLINE void fft_odd_sums(FFT_MEM const float2 *scratch, FFT_MEM float2 *out, int points, fft_side side, int radix,
                             int span, int magic, __global const float *cosines)
{
    const int pairs = radix / 2, step = span * side.width;
    FFT_SHARE_SIDE(i, points / radix * (pairs + 1), side)
    {
        const int m = i / (points / radix), b = i % (points / radix), block = fft_quotient(b, span, magic);
        const size_t base = (size_t)((block * radix * span + b - block * span) * side.width + side.w);
        FFT_MEM const float2 *q = scratch + base;
        float2 p = q[0], s = (float2)0.0f;
        if (m == 0) {
            for (int k = 1; k <= pairs; ++k)
                p += q[k * step];
            out[base] = p;
        } else {
            __global const float *c =
                cosines + (size_t)((m - 1) / FFT_ODD_GROUP * pairs * 2 * FFT_ODD_GROUP) + (m - 1) % FFT_ODD_GROUP;
            for (int k = 1; k <= pairs; ++k, c += 2 * FFT_ODD_GROUP) {
                p = fma(q[k * step], (float2)c[0], p);
                s = fma(q[(radix - k) * step], (float2)c[FFT_ODD_GROUP], s);
            }
            out[base + (size_t)(m * step)] = (float2)(p.x + s.y, p.y - s.x);
            out[base + (size_t)((radix - m) * step)] = (float2)(p.x - s.y, p.y + s.x);
        }
    }
}

/* All stages; input in scratch in digit-reversed order. Returns the scratch that holds the output, in natural order, or
 * for a chirp in digit-reversed order with real and imaginary parts swapped. */
FFT_INLINE FFT_MEM float2 *fft_transform(FFT_MEM float2 *scratch, fft_side side, __global const int *table,
                                         __global const float *floats)
{
    const int width = side.width;
    const int points = table[FFT_POINTS], stages = table[FFT_STAGES], chirp = table[FFT_CHIRP] != 0;
    FFT_MEM float2 *other = scratch + (size_t)points * width;
    for (int s = 0; s < stages; ++s) {
        __global const int *stage = table + FFT_HEADER + s * FFT_STAGE_INTS;
        const int radix = stage[FFT_RADIX], span = stage[FFT_SPAN], odd = !fft_has_butterfly(radix);
        __global const float *w = floats + stage[FFT_TWIDDLES];
        FFT_WAIT();
        if (odd)
            fft_odd_pairs(scratch, points, side, radix, span, stage[FFT_MAGIC], w);
        FFT_WAIT();
        if (odd) {
            fft_odd_sums(scratch, other, points, side, radix, span, stage[FFT_MAGIC], floats + stage[FFT_COSINES]);
            FFT_MEM float2 *t = scratch;
            scratch = other;
            other = t;
        } else {
            fft_stage(scratch, points, side, stage, floats, 0);
        }
    }
    FFT_WAIT();
    /* The chirp's transform times this, swapped, so that a forward transform backwards is an inverse one. */
    FFT_SHARE_SIDE(i, (chirp ? points : 0), side)
    {
        __global const float *c = floats + table[FFT_CHIRP_SPECTRUM] + 2 * i;
        const int at = i * width + side.w;
        const float2 v = fft_twiddled(scratch[at], c[0], c[1]);
        scratch[at] = v.yx;
    }
    for (int s = (chirp ? stages : 0) - 1; s >= 0; --s) {
        __global const int *stage = table + FFT_HEADER + s * FFT_STAGE_INTS;
        FFT_WAIT();
        fft_stage(scratch, points, side, stage, floats, 1);
    }
    FFT_WAIT();
    return scratch;
}

/* Puts input number i of transform w in its place. */
FFT_INLINE void fft_put_in(FFT_MEM float2 *scratch, int width, int w, int place, int i, float2 value, int chirped,
                           __global const float *chirp)
{
    scratch[(size_t)place * width + w] = chirped ? fft_twiddled(value, chirp[2 * i], chirp[2 * i + 1]) : value;
}

/* Output number i of transform w; place: that of input i. */
FFT_INLINE float2 fft_take_out(FFT_MEM const float2 *scratch, int width, int w, int place, int i, int chirped,
                               __global const float *chirp)
{
    if (!chirped)
        return scratch[(size_t)i * width + w];
    const float2 v = scratch[(size_t)place * width + w].yx;
    return fft_twiddled(v, chirp[2 * i], chirp[2 * i + 1]);
}

#endif
