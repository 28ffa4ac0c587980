/* The stage of radix 43 of transforms by work-groups in place (inc_fft_groups.h), the last of a length's stages. An
 * item takes whole butterflies in registers, so it writes only what it has read itself. Input or output k of butterfly
 * j is point j + k span of the transform. Pairs k, 43 - k are left out where both are zero or not wanted: the middle
 * 383 of 1376 points are 7 of 21 pairs.
 *
 * The loops over pairs are not unrolled: that would be 9000 instructions of a kernel and half a minute of a CPU's
 * compiler. So cosines and sines are in the stage's table, and its twiddle factors are ordered by k, then by j
 * (`across` of lib/fft/fft_own.h). */
#ifndef INC_FFT_GROUPS_ODD_H
#define INC_FFT_GROUPS_ODD_H

#include "inc_fft_groups.h"
#include "inc_fft_radix_large.h"

/* The numbers k that have points of the rectangle: first ... last. */
typedef struct fft_odd_range {
    int first, last;
} fft_odd_range;

FFT_INLINE fft_odd_range fft_odd_range_of(int point0, int points, int span)
{
    fft_odd_range range;
    range.first = point0 / span;
    range.last = (point0 + points - 1) / span;
    return range;
}

FFT_INLINE int fft_odd_holds(fft_odd_range range, int k)
{
    return k >= range.first && k <= range.last;
}

FFT_INLINE int fft_odd_holds_pair(fft_odd_range range, int k)
{
    return fft_odd_holds(range, k) || fft_odd_holds(range, FFT_ODD_RADIX - k);
}

/* The stage of a table, and the pairs of a rectangle's points. */
typedef struct fft_odd_stage {
    int span, step; /* step: from a point of a butterfly to the next one in scratch */
    fft_odd_range range;
    __global const float2 *twiddles;
    __global const float *cosines;
} fft_odd_stage;

FFT_INLINE fft_odd_stage fft_odd_stage_of(__global const int *table, int width, int point0, int points)
{
    __global const int *last = table + FFT_HEADER + (table[FFT_STAGES] - 1) * FFT_STAGE_INTS;
    __global const float *floats = FFT_FLOATS_OF(table);
    fft_odd_stage stage;
    stage.span = table[FFT_LENGTH] / FFT_ODD_RADIX;
    stage.step = stage.span * width;
    stage.range = fft_odd_range_of(point0, points, stage.span);
    stage.twiddles = (__global const float2 *)(floats + last[FFT_TWIDDLES]);
    stage.cosines = floats + last[FFT_COSINES];
    return stage;
}

/* p and q of X[m], X[43 - m] = p -+ i q, pair after pair of inputs, of some outputs: m = m0 ... m1, literals. */
typedef struct fft_odd_halves {
    float2 p[FFT_ODD_PAIRS + 1], q[FFT_ODD_PAIRS + 1];
} fft_odd_halves;

FFT_INLINE void fft_odd_begin(fft_odd_halves *sums, int m0, int m1, float2 x)
{
#pragma unroll
    for (int m = 0; m <= FFT_ODD_PAIRS; ++m)
        if (m >= m0 && m <= m1) {
            sums->p[m] = x;
            sums->q[m] = (float2)0.0f;
        }
}

/* Cosine and sine of 2 pi m k / 43 for m = 1 ... 21, of k. */
FFT_INLINE __global const float2 *fft_odd_turns(__global const float *cosines, int k)
{
    return (__global const float2 *)cosines + (k - 1) * FFT_ODD_PAIRS - 1;
}

/* Inputs k and 43 - k, k from 1 on; turns: of k. */
FFT_INLINE void fft_odd_add(fft_odd_halves *sums, int m0, int m1, __global const float2 *turns, float2 x, float2 y)
{
    const float2 a = x + y, b = x - y;
    if (m0 == 0)
        sums->p[0] += a;
#pragma unroll
    for (int m = 1; m <= FFT_ODD_PAIRS; ++m)
        if (m >= m0 && m <= m1) {
            const float2 c = turns[m];
            sums->p[m] = fma(a, (float2)c.x, sums->p[m]);
            sums->q[m] = fma(b, (float2)c.y, sums->q[m]);
        }
}

/* The outputs, times their twiddle factors, to `step` points apart. */
FFT_INLINE void fft_odd_leave(const fft_odd_halves *sums, int m0, int m1, FFT_MEM float2 *q, int step,
                              __global const float2 *twiddles, int span)
{
#pragma unroll
    for (int m = 1; m <= FFT_ODD_PAIRS; ++m)
        if (m >= m0 && m <= m1) {
            const float2 u = sums->p[m], v = sums->q[m];
            const float2 w = twiddles[(m - 1) * span], x = twiddles[(FFT_ODD_RADIX - 1 - m) * span];
            q[m * step] = fft_twiddled((float2)(u.x + v.y, u.y - v.x), w.x, w.y);
            q[(FFT_ODD_RADIX - m) * step] = fft_twiddled((float2)(u.x - v.y, u.y + v.x), x.x, x.y);
        }
    if (m0 == 0)
        q[0] = sums->p[0];
}

/* Inputs times their twiddle factors, as sums and differences (fft_odd_fold). */
FFT_INLINE void fft_odd_fetch(FFT_MEM const float2 *q, int step, __global const float2 *twiddles, int span, float *re,
                              float *im)
{
    re[0] = q[0].x;
    im[0] = q[0].y;
#pragma unroll
    for (int k = 1; k < FFT_ODD_RADIX; ++k) {
        const float2 w = twiddles[(k - 1) * span], v = fft_twiddled(q[k * step], w.x, w.y);
        re[k] = v.x;
        im[k] = v.y;
    }
    fft_odd_fold(re, im);
}

/* Outputs m and 43 - m of what fft_odd_fetch left, m from 1 on; turns: of m. Output 0 is the sum of all. */
FFT_INLINE float4 fft_odd_outputs(const float *re, const float *im, __global const float2 *turns)
{
    float2 p = (float2)(re[0], im[0]), q = (float2)0.0f;
#pragma unroll
    for (int k = 1; k <= FFT_ODD_PAIRS; ++k) {
        const float2 c = turns[k];
        p = fma((float2)(re[k], im[k]), (float2)c.x, p);
        q = fma((float2)(re[FFT_ODD_RADIX - k], im[FFT_ODD_RADIX - k]), (float2)c.y, q);
    }
    return (float4)(p.x + q.y, p.y - q.x, p.x - q.y, p.y + q.x);
}

FFT_INLINE float2 fft_odd_whole(const float *re, const float *im)
{
    float2 p = (float2)(re[0], im[0]);
#pragma unroll
    for (int k = 1; k <= FFT_ODD_PAIRS; ++k)
        p += (float2)(re[k], im[k]);
    return p;
}

#endif
