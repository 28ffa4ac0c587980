/* As refine_group_rows.cl, for lengths whose last stage is of radix 43 (inc_fft_groups_odd.h) and sensors that do not
 * crop. The inverse transform's input is put in digit-reversed order, so that this stage comes last and makes only the
 * window's pixels; the stages of the forward transform go backwards, so that it comes first and reads them: they are
 * all of one work-item.
 *
 * spectra, planes, table, scratch: as in refine_group_rows.cl. Dimension: groups of rows of all planes. */
#include "shared_refine.h"
#define REFINE_GROUP HADA_REFINE_ODD_GROUP
#include "inc_fft_groups_odd.h"
#include "inc_refine_groups.h"

/* Where an item's pixels are: in a row of the window, and in the row that shares its transform. */
typedef struct pixel_rows {
    __global float *x, *y;
    int x_there, y_there, col0, cols, clip;
} pixel_rows;

/* A pixel of both rows; zero beyond the window and in rows that do not exist. */
FFT_INLINE float2 pixel_in(const pixel_rows *pixels, int point)
{
    const int c = point - pixels->col0, there = (uint)c < (uint)pixels->cols;
    return (float2)(there && pixels->x_there ? pixels->x[c] : 0.0f, there && pixels->y_there ? pixels->y[c] : 0.0f);
}

/* Clips a pixel of both rows and writes them to the planes; returns them, zero as above. */
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
    const int inverse = rows.pass & HADA_REFINE_TO_PIXELS, forward = rows.pass & HADA_REFINE_TO_SPECTRA;
    const int blocks = n / 2 / HADA_FFT_BLOCK + 1, groups = (rows.rows + 2 * width - 1) / (2 * width);
    const int plane = get_group_id(0) / groups, first = get_group_id(0) % groups * 2 * width;
    const int count = min(2 * width, rows.rows - first);
    const fft_side side = fft_side_of(width);
    const fft_odd_stage stage = fft_odd_stage_of(table, width, rows.col0, rows.cols);
    const fft_odd_range range = stage.range;
    const int span = stage.span, step = stage.step;
    __global const int *place = table + table[FFT_PLACE];
    __global const float *floats = FFT_FLOATS_OF(table);
    __global const float2 *twiddles = stage.twiddles;
    __global const float *cosines = stage.cosines;
    __global float2 *values = (__global float2 *)spectra +
                              (size_t)(plane * blocks * rows.rows + first) * HADA_FFT_BLOCK; /* an int has room */

    for (int w = 0; w < (inverse ? width : 0); ++w)
        refine_rows_together(scratch, values, rows.rows, w, count, n, width, place);
    refine_stages(scratch, n, side, table, floats, 0, 0, inverse ? last : 0);
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
        pixels.clip = rows.pass & HADA_REFINE_CLIP;
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
    refine_stages_back(scratch, n, side, table, floats, 0, forward ? last : 0);
    FFT_WAIT();
    for (int w = 0; w < (forward ? min(width, count) : 0); ++w)
        refine_rows_apart(scratch, values, rows.rows, w, count, n, width, place);
}
