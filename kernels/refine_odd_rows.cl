/* As refine_group_rows.cl, for lengths whose last stage is of radix 43 (inc_fft_groups_odd.h) and sensors that do not
 * crop. The inverse's input is put in digit-reversed order, so that this stage comes last and makes the window's pixels
 * alone; the forward transform's stages go backwards, so that it comes first and reads these: an item has them all. */
#include "shared_refine.h"
#define REFINE_WIDTH 1
#define REFINE_GROUP HADA_REFINE_ODD_GROUP
#include "inc_fft_groups_odd.h"
#include "inc_refine.h"
#include "shared_fft.h"

/* Frequency k of two rows to scratch, as those of one complex transform, that of k at number n - k: a forward transform
 * of these is an inverse one. */
FFT_INLINE void put_together(__local float2 *scratch, __global const int *place, int k, int n, int width, float2 x,
                             float2 y)
{
    if (k == 0 || 2 * k == n) {
        scratch[place[k] * width] = (float2)(x.x, y.x);
    } else {
        scratch[place[n - k] * width] = (float2)(x.x - y.y, x.y + y.x);
        scratch[place[k] * width] = (float2)(x.x + y.y, y.x - x.y);
    }
}

/* Where an item's pixels are: those of a row of the window, and of the one that goes with it. */
typedef struct pixel_rows {
    __global float *x, *y;
    int x_there, y_there, col0, cols, clip;
} pixel_rows;

/* A pixel of both rows; zero of a row that is none, and beyond the window. */
FFT_INLINE float2 pixel_in(const pixel_rows *pixels, int point)
{
    const int c = point - pixels->col0, there = (uint)c < (uint)pixels->cols;
    return (float2)(there && pixels->x_there ? pixels->x[c] : 0.0f, there && pixels->y_there ? pixels->y[c] : 0.0f);
}

/* What is done to pixels, which go to the planes; returns them as above. */
FFT_INLINE float2 pixel_out(const pixel_rows *pixels, int point, float2 value)
{
    const int c = point - pixels->col0, there = (uint)c < (uint)pixels->cols;
    const int x_there = there && pixels->x_there, y_there = there && pixels->y_there;
    if (pixels->clip)
        value = max(value, 0.0f);
    if (x_there)
        pixels->x[c] = value.x;
    if (y_there)
        pixels->y[c] = value.y;
    return (float2)(x_there ? value.x : 0.0f, y_there ? value.y : 0.0f);
}

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_odd_rows(__global float *spectra, __global float *planes, hada_refine_rows rows, __global const int *table,
                __local float2 *scratch)
{
    const int n = table[FFT_LENGTH], last = table[FFT_STAGES] - 1, width = rows.width;
    const int inverse = rows.inverse, forward = rows.forward, span = n / FFT_ODD_RADIX, step = span * width;
    const int blocks = n / 2 / HADA_FFT_BLOCK + 1, groups = (rows.rows + 2 * width - 1) / (2 * width);
    const int plane = get_group_id(0) / groups, first = get_group_id(0) % groups * 2 * width;
    const int count = min(2 * width, rows.rows - first);
    const fft_side side = fft_side_of(width);
    const fft_odd_range range = fft_odd_range_of(rows.col0, rows.cols, span);
    __global const int *place = table + table[FFT_PLACE];
    __global const float *floats = FFT_FLOATS_OF(table);
    __global const int *odd = table + FFT_HEADER + last * FFT_STAGE_INTS;
    __global const float2 *twiddles = (__global const float2 *)(floats + odd[FFT_TWIDDLES]);
    __global const float *cosines = floats + odd[FFT_COSINES];
    __global float2 *values = (__global float2 *)spectra +
                              (size_t)(plane * blocks * rows.rows + first) * HADA_FFT_BLOCK; /* an int has room */

    for (int w = 0; w < (inverse ? width : 0); ++w)
        FFT_SHARE (k, n / 2 + 1) {
            __global const float2 *q =
                values + (size_t)(k / HADA_FFT_BLOCK * rows.rows + w) * HADA_FFT_BLOCK + k % HADA_FFT_BLOCK;
            float2 x = (float2)0.0f, y = (float2)0.0f;
            if (w < count)
                x = q[0];
            if (width + w < count)
                y = q[HADA_FFT_BLOCK * width];
            put_together(scratch + w, place, k, n, width, x, y);
        }
    for (int s = 0; s < (inverse ? last : 0); ++s) {
        FFT_WAIT();
        fft_stage(scratch, n, side, table + FFT_HEADER + s * FFT_STAGE_INTS, floats, 0);
    }
    FFT_WAIT();
    FFT_SHARE_SIDE(j, span, side)
    {
        __local float2 *q = scratch + j * width + side.w;
        pixel_rows pixels;
        pixels.x = planes + ((size_t)plane * rows.rows + first + side.w) * rows.cols;
        pixels.y = pixels.x + (size_t)width * rows.cols;
        pixels.x_there = side.w < count;
        pixels.y_there = width + side.w < count;
        pixels.col0 = rows.col0;
        pixels.cols = rows.cols;
        pixels.clip = rows.clip;
        if (inverse) {
            float re[FFT_ODD_RADIX], im[FFT_ODD_RADIX];
            fft_odd_fetch(q, step, twiddles + j, span, re, im);
            if (fft_odd_holds(range, 0))
                q[0] = pixel_out(&pixels, j, rows.scale * fft_odd_whole(re, im));
            for (int m = 1; m <= FFT_ODD_PAIRS; ++m)
                if (fft_odd_holds_pair(range, m)) {
                    const int mirror = FFT_ODD_RADIX - m;
                    const float4 x = rows.scale * fft_odd_outputs(re, im, fft_odd_turns(cosines, m));
                    q[m * step] = pixel_out(&pixels, j + m * span, x.lo);
                    q[mirror * step] = pixel_out(&pixels, j + mirror * span, x.hi);
                }
        } else {
            for (int k = range.first; k <= range.last; ++k)
                q[k * step] = pixel_in(&pixels, j + k * span);
        }
        if (forward) {
            fft_odd_halves sums;
            fft_odd_begin(&sums, 0, FFT_ODD_PAIRS, fft_odd_holds(range, 0) ? q[0] : (float2)0.0f);
            for (int k = 1; k <= FFT_ODD_PAIRS; ++k)
                if (fft_odd_holds_pair(range, k))
                    fft_odd_add(&sums, 0, FFT_ODD_PAIRS, fft_odd_turns(cosines, k),
                                fft_odd_holds(range, k) ? q[k * step] : (float2)0.0f,
                                fft_odd_holds(range, FFT_ODD_RADIX - k) ? q[(FFT_ODD_RADIX - k) * step] : (float2)0.0f);
            fft_odd_leave(&sums, 0, FFT_ODD_PAIRS, q, step, twiddles + j, span);
        }
    }
    for (int s = (forward ? last : 0) - 1; s >= 0; --s) {
        FFT_WAIT();
        fft_stage(scratch, n, side, table + FFT_HEADER + s * FFT_STAGE_INTS, floats, 1);
    }
    FFT_WAIT();
    for (int w = 0; w < (forward ? min(width, count) : 0); ++w)
        FFT_SHARE (k, blocks * HADA_FFT_BLOCK) {
            __global float2 *to =
                values + (size_t)(k / HADA_FFT_BLOCK * rows.rows + w) * HADA_FFT_BLOCK + k % HADA_FFT_BLOCK;
            float2 z = (float2)0.0f, u = z;
            if (k <= n / 2) {
                z = 0.5f * scratch[place[k] * width + w];
                u = 0.5f * scratch[place[k ? n - k : 0] * width + w];
            }
            to[0] = (float2)(z.x + u.x, z.y - u.y);
            if (width + w < count)
                to[HADA_FFT_BLOCK * width] = (float2)(z.y + u.y, u.x - z.x);
        }
}
