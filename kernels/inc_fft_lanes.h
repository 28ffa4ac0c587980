/* Transforms in the lanes of vectors: one work-item carries eight transforms side by side in float8, its scratch memory
 * holds point i as scratch[2 i] (re) and scratch[2 i + 1] (im). Decimation in time: the input goes to scratch in
 * digit-reversed order, every stage works in place, the last one hands its output on in natural order. */
#ifndef INC_FFT_LANES_H
#define INC_FFT_LANES_H

#define FFT_V float8
#include "inc_fft_radix.h"
#include "inc_lanes.h"
#include "shared_fft_table.h"
#include "shared_local.h"

/* FFT_SCRATCH_GLOBAL: scratch lies in global memory, for transforms too long for local memory. */
#ifndef FFT_SCRATCH_GLOBAL
#define FFT_SCRATCH_GLOBAL 0
#endif
#if FFT_SCRATCH_GLOBAL
#define FFT_MEM __global
#define FFT_STATED_SIZE
#else
#define FFT_MEM         __local
#define FFT_STATED_SIZE STATED_SIZE
#endif

/* The work-item's scratch, of so many complex numbers in lanes. */
FFT_INLINE FFT_MEM float8 *fft_own_scratch(FFT_MEM float8 *scratches, int points)
{
#if FFT_SCRATCH_GLOBAL
    return scratches + get_group_id(0) * (size_t)(2 * points);
#else
    return scratches;
#endif
}

/* Transposes 8 x 8 floats. */
FFT_INLINE void fft_transpose(float8 *m)
{
    float8 a[8], b[8];
#pragma unroll
    for (int k = 0; k < 4; ++k) {
        const float8 x = m[2 * k], y = m[2 * k + 1];
        a[2 * k] = lanes_low(x, y);
        a[2 * k + 1] = lanes_high(x, y);
    }
#pragma unroll
    for (int h = 0; h < 2; ++h) {
        const float8 p = a[4 * h], q = a[4 * h + 1], u = a[4 * h + 2], v = a[4 * h + 3];
        b[4 * h] = (float8)(p.s01, u.s01, p.s45, u.s45);
        b[4 * h + 1] = (float8)(p.s23, u.s23, p.s67, u.s67);
        b[4 * h + 2] = (float8)(q.s01, v.s01, q.s45, v.s45);
        b[4 * h + 3] = (float8)(q.s23, v.s23, q.s67, v.s67);
    }
#pragma unroll
    for (int k = 0; k < 4; ++k) {
        m[k] = (float8)(b[k].lo, b[k + 4].lo);
        m[k + 4] = (float8)(b[k].hi, b[k + 4].hi);
    }
}

#define fft_radix1(re, im)
#define FFT_FETCH(k)                                                                                                   \
    re[k] = q[2 * k * span];                                                                                           \
    im[k] = q[2 * k * span + 1];
#define FFT_LEAVE(k)                                                                                                   \
    q[2 * k * span] = re[k];                                                                                           \
    q[2 * k * span + 1] = im[k];
#define FFT_TIMES_TWIDDLE(k) fft_times_twiddle(&re[k], &im[k], w[2 * k - 2], w[2 * k - 1]);

/* A stage of radix R, in place, on the blocks from..to-1; `back`: decimation in frequency, which takes natural order
 * and leaves digit-reversed order. */
#define FFT_STAGE(R)                                                                                                   \
    FFT_INLINE void fft_stage##R(FFT_MEM float8 *scratch, int from, int to, int span, __global const float *twiddles,  \
                                 int back)                                                                             \
    {                                                                                                                  \
        for (int b = from; b < to; ++b) {                                                                              \
            FFT_MEM float8 *q = scratch + (size_t)b * (size_t)(2 * R * span);                                          \
            __global const float *w = twiddles;                                                                        \
            for (int j = 0; j < span; ++j, q += 2, w += 2 * (R - 1)) {                                                 \
                float8 re[R], im[R];                                                                                   \
                FFT_EACH(R, FFT_FETCH)                                                                                 \
                if (!back) {                                                                                           \
                    FFT_AFTER_FIRST_##R(FFT_TIMES_TWIDDLE);                                                            \
                }                                                                                                      \
                fft_radix##R(re, im);                                                                                  \
                if (back) {                                                                                            \
                    FFT_AFTER_FIRST_##R(FFT_TIMES_TWIDDLE);                                                            \
                }                                                                                                      \
                FFT_EACH(R, FFT_LEAVE)                                                                                 \
            }                                                                                                          \
        }                                                                                                              \
    }

FFT_EACH_RADIX(FFT_STAGE)

/* One odd-length butterfly, by its definition, in two halves. The first turns the inputs and keeps their sums and
 * differences; the second sums up FFT_ODD_GROUP outputs m and their mirror images p - m at a time:
 *     X[m], X[p-m] = x[0] + sum a[k] cos(2 pi m k / p)  -+  i sum b[k] sin(2 pi m k / p). */
typedef struct fft_odd {
    int from, to;                                          /* sums and differences beyond pairs from+1 .. to are 0 */
    float8 re, im;                                         /* x[0] */
    float8 sums[4 * (FFT_ODD_LARGEST / 2)];                /* for each k: a re, a im, b re, b im */
    float8 low_re[FFT_ODD_GROUP], low_im[FFT_ODD_GROUP];   /* X[m] */
    float8 high_re[FFT_ODD_GROUP], high_im[FFT_ODD_GROUP]; /* X[p-m] */
} fft_odd;

FFT_INLINE void fft_odd_pair(fft_odd *odd, int k, float8 xr, float8 xi, float8 yr, float8 yi)
{
    float8 *s = odd->sums + 4 * (k - 1);
    s[0] = xr + yr;
    s[1] = xi + yi;
    s[2] = xr - yr;
    s[3] = xi - yi;
}

/* Of input numbers k of a butterfly, points j + k span of a transform, those in first .. end-1 alone are not 0. */
FFT_INLINE void fft_odd_range(fft_odd *odd, int radix, int span, int j, int first, int end)
{
    const int half_count = radix / 2;
    const int low = first > j ? (first - j + span - 1) / span : 0, high = end > j ? (end - 1 - j) / span : -1;
    /* the pair k is of the numbers k and radix - k */
    odd->from = max(min(low > half_count ? radix : low, high > half_count ? radix - high : radix) - 1, 0);
    odd->to = low > half_count ? radix - low : min(high, half_count);
}

FFT_INLINE void fft_odd_all(fft_odd *odd, int radix)
{
    odd->from = 0;
    odd->to = radix / 2;
}

/* `w`: the twiddle factors of the inputs, or 0. */
FFT_INLINE void fft_odd_take(fft_odd *odd, int radix, FFT_MEM const float8 *q, int span, __global const float *w)
{
    odd->re = q[0];
    odd->im = q[1];
    for (int k = odd->from + 1; k <= odd->to; ++k) {
        FFT_MEM const float8 *low = q + 2 * k * span, *high = q + 2 * (radix - k) * span;
        float8 xr = low[0], xi = low[1], yr = high[0], yi = high[1];
        if (w && span > 1) {
            fft_times_twiddle(&xr, &xi, w[2 * k - 2], w[2 * k - 1]);
            fft_times_twiddle(&yr, &yi, w[2 * (radix - k) - 2], w[2 * (radix - k) - 1]);
        }
        fft_odd_pair(odd, k, xr, xi, yr, yi);
    }
}

FFT_INLINE void fft_odd_first(const fft_odd *odd, float8 *re, float8 *im)
{
    *re = odd->re;
    *im = odd->im;
    for (int k = odd->from; k < odd->to; ++k) {
        *re += odd->sums[4 * k];
        *im += odd->sums[4 * k + 1];
    }
}

/* Outputs m = 1 + 3 g .. 3 + 3 g and their mirror images. */
FFT_INLINE void fft_odd_group(fft_odd *odd, int radix, int group, __global const float *cosines)
{
    __global const float *c = cosines + (size_t)(group * (radix / 2) + odd->from) * (size_t)(2 * FFT_ODD_GROUP);
    float8 pr0 = odd->re, pr1 = pr0, pr2 = pr0, pi0 = odd->im, pi1 = pi0, pi2 = pi0;
    float8 qr0 = 0.0f, qr1 = 0.0f, qr2 = 0.0f, qi0 = 0.0f, qi1 = 0.0f, qi2 = 0.0f;
    for (int k = odd->from; k < odd->to; ++k) {
        const float8 ar = odd->sums[4 * k], ai = odd->sums[4 * k + 1];
        const float8 br = odd->sums[4 * k + 2], bi = odd->sums[4 * k + 3];
        pr0 = fma(ar, (float8)c[0], pr0);
        pi0 = fma(ai, (float8)c[0], pi0);
        pr1 = fma(ar, (float8)c[1], pr1);
        pi1 = fma(ai, (float8)c[1], pi1);
        pr2 = fma(ar, (float8)c[2], pr2);
        pi2 = fma(ai, (float8)c[2], pi2);
        qr0 = fma(br, (float8)c[3], qr0);
        qi0 = fma(bi, (float8)c[3], qi0);
        qr1 = fma(br, (float8)c[4], qr1);
        qi1 = fma(bi, (float8)c[4], qi1);
        qr2 = fma(br, (float8)c[5], qr2);
        qi2 = fma(bi, (float8)c[5], qi2);
        c += 2 * FFT_ODD_GROUP;
    }
    odd->low_re[0] = pr0 + qi0;
    odd->low_im[0] = pi0 - qr0;
    odd->high_re[0] = pr0 - qi0;
    odd->high_im[0] = pi0 + qr0;
    odd->low_re[1] = pr1 + qi1;
    odd->low_im[1] = pi1 - qr1;
    odd->high_re[1] = pr1 - qi1;
    odd->high_im[1] = pi1 + qr1;
    odd->low_re[2] = pr2 + qi2;
    odd->low_im[2] = pi2 - qr2;
    odd->high_re[2] = pr2 - qi2;
    odd->high_im[2] = pi2 + qr2;
}

/* An output outside low..low+wanted-1 need not be right (the last stage of a pruned transform). */
FFT_INLINE void fft_stage_odd(FFT_MEM float8 *scratch, int from, int to, int radix, int span,
                              __global const float *twiddles, __global const float *cosines, int low, int wanted)
{
    for (int b = from; b < to; ++b) {
        FFT_MEM float8 *block = scratch + (size_t)b * (size_t)(2 * radix * span);
        for (int j = 0; j < span; ++j) {
            FFT_MEM float8 *q = block + 2 * j;
            fft_odd odd;
            float8 re, im;
            fft_odd_all(&odd, radix);
            fft_odd_take(&odd, radix, q, span, twiddles + (size_t)(2 * (radix - 1)) * (size_t)j);
            fft_odd_first(&odd, &re, &im);
            q[0] = re;
            q[1] = im;
            for (int m = 1; m <= radix / 2; m += FFT_ODD_GROUP) {
                const int count = min(FFT_ODD_GROUP, radix / 2 - m + 1);
                int skip = 1;
                for (int g = 0; g < count; ++g)
                    skip &= (uint)(j + (m + g) * span - low) >= (uint)wanted &&
                            (uint)(j + (radix - m - g) * span - low) >= (uint)wanted;
                if (skip)
                    continue;
                fft_odd_group(&odd, radix, m / FFT_ODD_GROUP, cosines);
                for (int g = 0; g < count; ++g) {
                    q[2 * (m + g) * span] = odd.low_re[g];
                    q[2 * (m + g) * span + 1] = odd.low_im[g];
                    q[2 * (radix - m - g) * span] = odd.high_re[g];
                    q[2 * (radix - m - g) * span + 1] = odd.high_im[g];
                }
            }
        }
    }
}

/* The outputs of an odd-length butterfly, times their twiddle factors, to their places. */
FFT_INLINE void fft_odd_give(fft_odd *odd, int radix, FFT_MEM float8 *q, int span, __global const float *w,
                             __global const float *cosines)
{
    float8 re, im;
    fft_odd_first(odd, &re, &im);
    q[0] = re;
    q[1] = im;
    for (int m = 1; m <= radix / 2; m += FFT_ODD_GROUP) {
        fft_odd_group(odd, radix, m / FFT_ODD_GROUP, cosines);
        for (int g = 0; g < min(FFT_ODD_GROUP, radix / 2 - m + 1); ++g) {
            const int low = m + g, high = radix - low;
            fft_times_twiddle(&odd->low_re[g], &odd->low_im[g], w[2 * low - 2], w[2 * low - 1]);
            fft_times_twiddle(&odd->high_re[g], &odd->high_im[g], w[2 * high - 2], w[2 * high - 1]);
            q[2 * low * span] = odd->low_re[g];
            q[2 * low * span + 1] = odd->low_im[g];
            q[2 * high * span] = odd->high_re[g];
            q[2 * high * span + 1] = odd->high_im[g];
        }
    }
}

/* Points of a block outside first..end-1 are 0. */
FFT_INLINE void fft_unstage_odd(FFT_MEM float8 *scratch, int from, int to, int radix, int span,
                                __global const float *twiddles, __global const float *cosines, int first, int end)
{
    for (int b = from; b < to; ++b) {
        FFT_MEM float8 *block = scratch + (size_t)b * (size_t)(2 * radix * span);
        for (int j = 0; j < span; ++j) {
            FFT_MEM float8 *q = block + 2 * j;
            fft_odd odd;
            fft_odd_range(&odd, radix, span, j, first, end);
            fft_odd_take(&odd, radix, q, span, 0);
            fft_odd_give(&odd, radix, q, span, twiddles + (size_t)(2 * (radix - 1)) * (size_t)j, cosines);
        }
    }
}

/* The points from_point..to_point-1 through the stage s, in place. Of a stage of any radix, `back` 0: only the outputs
 * first..first+count-1 need be right; 1: inputs outside these are 0. */
FFT_INLINE void fft_stage(FFT_MEM float8 *scratch, __global const int *table, __global const float *floats, int s,
                          int from_point, int to_point, int back, int first, int count)
{
    __global const int *stage = table + FFT_HEADER + s * FFT_STAGE_INTS;
    const int radix = stage[FFT_RADIX], span = stage[FFT_SPAN];
    const int from = from_point / (radix * span), to = to_point / (radix * span);
    __global const float *w = floats + stage[FFT_TWIDDLES], *cosines = floats + stage[FFT_COSINES];
    switch (radix) {
    case 1: break; FFT_CASES(fft_stage, (scratch, from, to, span, w, back))
    default:
        if (back)
            fft_unstage_odd(scratch, from, to, radix, span, w, cosines, first, first + count);
        else
            fft_stage_odd(scratch, from, to, radix, span, w, cosines, first, count);
        break;
    }
}

/* A walk over the stages: first those of each chunk, chunk by chunk, then the others over all points. Part `part` of
 * `chunks + 1` is the stages first..last-1 over the points from..to-1. */
typedef struct fft_part {
    int first, last, from, to;
} fft_part;

FFT_INLINE fft_part fft_part_of(__global const int *table, int part)
{
    const int points = table[FFT_POINTS], chunk = table[FFT_CHUNK];
    fft_part p;
    if (part < points / chunk) {
        p.first = 0;
        p.last = table[FFT_CHUNK_STAGES];
        p.from = part * chunk;
        p.to = p.from + chunk;
    } else {
        p.first = table[FFT_CHUNK_STAGES];
        p.last = table[FFT_STAGES];
        p.from = 0;
        p.to = points;
    }
    return p;
}

/* The stages first..last-1, chunk by chunk as long as that goes. */
FFT_INLINE void fft_stages(FFT_MEM float8 *scratch, __global const int *table, __global const float *floats, int first,
                           int last)
{
    const int points = table[FFT_POINTS];
    for (int i = 0; i <= points / table[FFT_CHUNK]; ++i) {
        const fft_part part = fft_part_of(table, i);
        for (int s = max(part.first, first); s < min(part.last, last); ++s)
            fft_stage(scratch, table, floats, s, part.from, part.to, 0, 0, points);
    }
}

/* The stages 0..last-1 backwards, chunk by chunk at last. */
FFT_INLINE void fft_unstages(FFT_MEM float8 *scratch, __global const int *table, __global const float *floats, int last)
{
    const int points = table[FFT_POINTS];
    for (int i = points / table[FFT_CHUNK]; i >= 0; --i) {
        const fft_part part = fft_part_of(table, i);
        for (int s = min(part.last, last) - 1; s >= part.first; --s)
            fft_stage(scratch, table, floats, s, part.from, part.to, 1, 0, points);
    }
}

/* Multiplies scratch by the transform of the chirp and leaves its product with real and imaginary parts swapped, so
 * that a forward transform backwards through the stages is an inverse one. Ends in digit-reversed order, swapped. */
FFT_INLINE void fft_convolve(FFT_MEM float8 *scratch, __global const int *table, __global const float *floats)
{
    const int points = table[FFT_POINTS];
    __global const float *chirp = floats + table[FFT_CHIRP_SPECTRUM];
    for (int i = 0; i < points; ++i) {
        float8 re = scratch[2 * i], im = scratch[2 * i + 1];
        fft_times_twiddle(&re, &im, chirp[2 * i], chirp[2 * i + 1]);
        scratch[2 * i] = im;
        scratch[2 * i + 1] = re;
    }
    fft_unstages(scratch, table, floats, table[FFT_STAGES]);
}

#endif
