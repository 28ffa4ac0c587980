/* As refine_group_columns.cl, for lengths whose last stage is of radix 43 (inc_fft_groups_odd.h) and sensors that do
 * not crop. The stages go backwards on the way in, so that this one meets the window's rows first, straight from
 * memory, and last on the way out, straight to it. Between the transforms the points stand in digit-reversed order.
 *
 * Dimensions: parts of blocks of columns, channels, sets. `scratch`: `width` columns for each depth of a set.
 * partial[set][channel][part]. */
#include "shared_refine.h"
#define REFINE_WIDTH 1
#define REFINE_GROUP HADA_REFINE_ODD_GROUP
#include "inc_fft_groups_odd.h"
#include "inc_refine_groups.h"
#include "shared_fft.h"

/* A row of a column of the window; zero beyond. */
FFT_INLINE float2 row_of(__global const float2 *window, int row, int rows)
{
    return (uint)row < (uint)rows ? window[(size_t)row * HADA_FFT_BLOCK] : (float2)0.0f;
}

/* Parts changed over: the transform was an inverse one. */
FFT_INLINE void put_row(__global float2 *window, int row, int rows, float2 value)
{
    if ((uint)row < (uint)rows)
        window[(size_t)row * HADA_FFT_BLOCK] = value.yx;
}

/* The outputs m0 ... m1, literals, and their mirror images of the stage of radix 43 backwards: butterfly j from the
 * window to scratch. All at once would take more registers than there are. */
FFT_INLINE void way_in(__global const float2 *window, const hada_refine_rows *rows, fft_odd_range range, int j,
                       int span, int m0, int m1, __local float2 *to, int step, __global const float2 *twiddles,
                       __global const float *cosines)
{
    fft_odd_halves sums;
    fft_odd_begin(&sums, m0, m1, row_of(window, j - rows->row0, rows->rows));
    for (int k = 1; k <= FFT_ODD_PAIRS; ++k)
        if (fft_odd_holds_pair(range, k))
            fft_odd_add(&sums, m0, m1, fft_odd_turns(cosines, k), row_of(window, j + k * span - rows->row0, rows->rows),
                        row_of(window, j + (FFT_ODD_RADIX - k) * span - rows->row0, rows->rows));
    fft_odd_leave(&sums, m0, m1, to, step, twiddles, span);
}

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_odd_columns(__global float *planes, __global const float *otf, __global const int *list,
                   __global const float *frame, __global const float *prior, __global float *now_w,
                   __global float *partial, hada_refine_step now, hada_refine_rows rows, __global const int *table,
                   __local float2 *scratch)
{
    REFINE_LOCAL
    const int depths = now.problem.depths, n = table[FFT_LENGTH], last = table[FFT_STAGES] - 1, width = rows.width;
    const int cold = now.start == HADA_REFINE_COLD, each = n * width, span = n / FFT_ODD_RADIX, step = span * width;
    const fft_side side = fft_side_of(width);
    const fft_odd_range range = fft_odd_range_of(rows.row0, rows.rows, span);
    __global const int *place = table + table[FFT_PLACE];
    __global const float *floats = FFT_FLOATS_OF(table);
    __global const int *odd = table + FFT_HEADER + last * FFT_STAGE_INTS;
    __global const float2 *twiddles = (__global const float2 *)(floats + odd[FFT_TWIDDLES]);
    __global const float *cosines = floats + odd[FFT_COSINES];
    const uint parts = HADA_FFT_BLOCK / width, blocks = get_num_groups(0) / parts, cols = now.problem.spectrum.cols;
    const uint block = get_group_id(0) / parts, col = get_group_id(0) % parts * width + side.w;
    const uint channel = get_group_id(1), channels = get_num_groups(1), set = get_group_id(2);
    const size_t count = now.problem.spectrum.count, h_step = 2 * (size_t)channels * count;
    const size_t first = (size_t)set * depths * channels + channel, block_values = (size_t)rows.rows * HADA_FFT_BLOCK;
    __global const float *h = otf + 2 * (now.problem.otf_offset + channel * count);
    __global const float *b = frame + 2 * (now.problem.frame_offset + channel * count);
    __global const float *p = prior + (now.has_prior ? channel * count : 0);
    __global float *w = now_w + 2 * first * count;
    __global float2 *window = (__global float2 *)planes + (first * blocks + block) * block_values + col;
    const size_t window_step = (size_t)channels * blocks * block_values;
    __global const int *z = list + set * (uint)depths;
    float sum = 0.0f;

    FFT_SHARE_SIDE(i, (cold ? 0 : depths * span), side)
    {
        const int s = i / span, j = i - s * span;
        __global const float2 *from = window + s * window_step;
        __local float2 *to = scratch + s * each + j * width + side.w;
        way_in(from, &rows, range, j, span, 0, FFT_ODD_PAIRS / 2, to, step, twiddles + j, cosines);
        way_in(from, &rows, range, j, span, FFT_ODD_PAIRS / 2 + 1, FFT_ODD_PAIRS, to, step, twiddles + j, cosines);
    }
    for (int s = (cold ? 0 : last) - 1; s >= 0; --s) {
        FFT_WAIT();
        fft_stage(scratch, n * depths, side, table + FFT_HEADER + s * FFT_STAGE_INTS, floats, 1);
    }
    FFT_WAIT();
    FFT_SHARE_SIDE(y, n, side)
    {
        const uint i = (block * (uint)n + y) * HADA_FFT_BLOCK + col;
        sum += refine_count(
            solve(&now, h, h_step, z, b, now_w, p, w, h_step, i, scratch + place[y] * width + side.w, each), i, n,
            HADA_FFT_BLOCK, cols);
    }
    for (int s = 0; s < last; ++s) {
        FFT_WAIT();
        fft_stage(scratch, n * depths, side, table + FFT_HEADER + s * FFT_STAGE_INTS, floats, 0);
    }
    /* others have read what is written here */
    barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    FFT_SHARE_SIDE(i, depths * span, side)
    {
        const int s = i / span, j = i - s * span;
        __global float2 *to = window + s * window_step;
        float re[FFT_ODD_RADIX], im[FFT_ODD_RADIX];
        fft_odd_fetch(scratch + s * each + j * width + side.w, step, twiddles + j, span, re, im);
        if (fft_odd_holds(range, 0))
            put_row(to, j - rows.row0, rows.rows, fft_odd_whole(re, im));
        for (int m = 1; m <= FFT_ODD_PAIRS; ++m)
            if (fft_odd_holds_pair(range, m)) {
                const float4 x = fft_odd_outputs(re, im, fft_odd_turns(cosines, m));
                put_row(to, j + m * span - rows.row0, rows.rows, x.lo);
                put_row(to, j + (FFT_ODD_RADIX - m) * span - rows.row0, rows.rows, x.hi);
            }
    }
    REFINE_PARTIAL(partial, (now.problem.sums.first + (set * channels + channel) * get_num_groups(0) + get_group_id(0)),
                   sum)
}
