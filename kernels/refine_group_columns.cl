/* As refine_columns.cl, by work-groups: a group takes `width` columns of one block (2, 4 or 8) of all depths of a set,
 * and where a sensor crops (REFINE_CROPPED, a program of its own) of E and A.
 * Between the transforms the points stand in natural order; the stages backwards leave them in the digit-reversed order
 * of the input. For lengths whose stages all have butterflies.
 *
 * Dimensions: parts of blocks of columns, channels, sets. `scratch`: `width` columns for each depth of a set, and as
 * many where a sensor crops. partial[set][channel][part]. */
#include "shared_refine.h"
#define REFINE_WIDTH 1
#define REFINE_GROUP HADA_REFINE_FUSED_GROUP
#include "inc_fft_groups.h"
#include "inc_refine_groups.h"
#include "shared_fft.h"

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_group_columns(__global float *planes, __global const float *otf, __global const int *list,
                     __global const float *frame, __global const float *prior, __global float *now_w,
                     __global float *split, __global float *partial, hada_refine_step now, hada_refine_rows rows,
                     hada_refine_rows frame_rows, __global const int *table, __local float2 *scratch)
{
    REFINE_LOCAL
    const int depths = now.problem.depths, n = table[FFT_LENGTH], stages = table[FFT_STAGES], width = rows.width;
    const int cold = now.start == HADA_REFINE_COLD, further = now.start == HADA_REFINE_CONTINUE, each = n * width;
    const fft_side side = fft_side_of(width);
    __global const int *place = table + table[FFT_PLACE];
    __global const float *floats = FFT_FLOATS_OF(table);
    const uint parts = HADA_FFT_BLOCK / width, blocks = get_num_groups(0) / parts, cols = now.problem.spectrum.cols;
    const uint block = get_group_id(0) / parts, col = get_group_id(0) % parts * width + side.w;
    const uint channel = get_group_id(1), channels = get_num_groups(1), set = get_group_id(2);
    const size_t count = now.problem.spectrum.count, step = 2 * (size_t)channels * count;
    const size_t first = (size_t)set * depths * channels + channel, block_values = (size_t)rows.rows * HADA_FFT_BLOCK;
    __global const float *h = otf + 2 * (now.problem.otf_offset + channel * count);
    __global const float *b = frame + 2 * (now.problem.frame_offset + channel * count);
    __global const float *p = prior + (now.has_prior ? channel * count : 0);
    __global float *w = now_w + 2 * first * count;
    __global float2 *window = (__global float2 *)planes + (first * blocks + block) * block_values + col;
    const size_t window_step = (size_t)channels * blocks * block_values, plane = (size_t)set * channels + channel;
    __global float *a = split + (REFINE_CROPPED ? 2 * plane * count : 0);
    __global float2 *cropped = (__global float2 *)split + (REFINE_CROPPED ? now.split_e : 0) +
                               (plane * blocks + block) * (size_t)frame_rows.rows * HADA_FFT_BLOCK + col;
    __global const int *z = list + set * (uint)depths;
    float sum = 0.0f;

    for (int s = 0; s < (cold ? 0 : depths); ++s)
        FFT_SHARE_SIDE(y, n, side)
        {
            const int row = y - rows.row0;
            float2 v = (float2)0.0f;
            if ((uint)row < (uint)rows.rows)
                v = window[s * window_step + (size_t)row * HADA_FFT_BLOCK];
            scratch[s * each + place[y] * width + side.w] = v;
        }
    for (int s = 0; s < (REFINE_CROPPED && further); ++s)
        FFT_SHARE_SIDE(y, n, side)
        {
            const int row = y - frame_rows.row0;
            float2 v = (float2)0.0f;
            if ((uint)row < (uint)frame_rows.rows)
                v = cropped[(size_t)row * HADA_FFT_BLOCK];
            scratch[depths * each + place[y] * width + side.w] = v;
        }
    for (int s = 0; s < (cold ? 0 : stages); ++s) {
        FFT_WAIT();
        fft_stage(scratch, n * (depths + (REFINE_CROPPED && further)), side, table + FFT_HEADER + s * FFT_STAGE_INTS,
                  floats, 0);
    }
    FFT_WAIT();
    FFT_SHARE_SIDE(y, n, side)
    {
        const uint i = (block * (uint)n + y) * HADA_FFT_BLOCK + col;
        sum += refine_count(solve(&now, h, step, z, b, a, p, w, step, i, scratch + y * width + side.w, each), i, n,
                            HADA_FFT_BLOCK, cols);
    }
    for (int s = stages - 1; s >= 0; --s) {
        FFT_WAIT();
        fft_stage(scratch, n * (depths + REFINE_CROPPED), side, table + FFT_HEADER + s * FFT_STAGE_INTS, floats, 1);
    }
    /* others have read what is written here */
    barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    for (int s = 0; s < depths; ++s)
        FFT_SHARE_SIDE(row, rows.rows, side)
    window[s * window_step + (size_t)row * HADA_FFT_BLOCK] =
        scratch[s * each + place[rows.row0 + row] * width + side.w].yx;
    for (int s = 0; s < REFINE_CROPPED; ++s)
        FFT_SHARE_SIDE(row, frame_rows.rows, side)
    cropped[(size_t)row * HADA_FFT_BLOCK] = scratch[depths * each + place[frame_rows.row0 + row] * width + side.w].yx;
    REFINE_PARTIAL(partial, (now.problem.sums.first + (set * channels + channel) * get_num_groups(0) + get_group_id(0)),
                   sum)
}
