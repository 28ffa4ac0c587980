/* As refine_score of refine.cl, from half spectra of rows as refine_group_rows.cl leaves them, by work-groups: a group
 * takes `width` columns of one block of all planes of a set, channel after channel; spectra of planes stand nowhere.
 *
 * Dimensions: parts of blocks of columns, sets. `scratch`: `width` columns for each depth of a set and, behind them,
 * two more, what the channels add up to. partial[set][part]. */
#include "shared_refine.h"
#define REFINE_WIDTH 1
#define REFINE_GROUP HADA_REFINE_FUSED_GROUP
#include "inc_fft_groups.h"
#include "inc_refine_step.h"
#include "shared_fft.h"

/* Adds a channel at frequency i, as refine_score does. `u`: U of the first depth, and those of the others every `each`
 * values on. */
REFINE_INLINE void add_channel(refine_left *left, hada_refine_problem problem, hada_refine_band band,
                               __global const float *otf, __global const int *z, __global const float *frame,
                               __global const float *prior, __global const float *variance, uint c, size_t i,
                               __local const float2 *u, int each)
{
    const size_t count = problem.spectrum.count;
    const float2 b = vload2(problem.frame_offset + c * count + i, frame);
    float power = 0.0f;
    left->re += b.x;
    left->im += b.y;
    for (int s = 0; s < problem.depths; ++s) {
        const size_t at = ((size_t)z[s] * problem.channels + c) * count + i;
        const float2 h = vload2(problem.otf_offset + at, otf), v = u[s * each];
        refine_left_by(left, &power, band, h.x, h.y, v.x, v.y, band.has_variance ? variance[at] : 0.0f);
    }
    if (band.has_prior)
        left->cost = fma(prior[c * count + i], power, left->cost);
}

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_group_score(__global const float *planes, __global const float *otf, __global const int *list,
                   __global const float *frame, __global const float *prior, __global const float *variance,
                   __global float *partial, hada_refine_problem problem, hada_refine_band band, hada_refine_rows rows,
                   __global const int *table, __local float2 *scratch)
{
    REFINE_LOCAL
    const int depths = problem.depths, n = table[FFT_LENGTH], stages = table[FFT_STAGES], width = rows.width;
    const int each = n * width;
    const fft_side side = fft_side_of(width);
    __global const int *place = table + table[FFT_PLACE], *z = list + get_group_id(1) * (uint)depths;
    __global const float *floats = FFT_FLOATS_OF(table);
    const uint parts = HADA_FFT_BLOCK / width, blocks = get_num_groups(0) / parts, set = get_group_id(1);
    const uint block = get_group_id(0) / parts, col = get_group_id(0) % parts * width + side.w;
    const size_t block_values = (size_t)rows.rows * HADA_FFT_BLOCK, plane_values = blocks * block_values;
    __local float4 *sums = (__local float4 *)(scratch + depths * each);
    float sum = 0.0f;

    for (uint c = 0; c < problem.channels; ++c) {
        const size_t first = (size_t)set * depths * problem.channels + c;
        __global const float2 *window =
            (__global const float2 *)planes + first * plane_values + block * block_values + col;
        FFT_WAIT();
        for (int s = 0; s < depths; ++s)
            FFT_SHARE_SIDE(y, n, side)
            {
                const int row = y - rows.row0;
                float2 v = (float2)0.0f;
                if ((uint)row < (uint)rows.rows)
                    v = window[s * problem.channels * plane_values + (size_t)row * HADA_FFT_BLOCK];
                scratch[s * each + place[y] * width + side.w] = v;
            }
        for (int s = 0; s < stages; ++s) {
            FFT_WAIT();
            fft_stage(scratch, n * depths, side, table + FFT_HEADER + s * FFT_STAGE_INTS, floats, 0);
        }
        FFT_WAIT();
        FFT_SHARE_SIDE(y, n, side)
        {
            /* an item meets the same points in every channel */
            const int at = y * width + side.w;
            const uint i = (block * (uint)n + y) * HADA_FFT_BLOCK + col;
            const float4 so_far = c ? sums[at] : (float4)0.0f;
            refine_left left = {so_far.x, so_far.y, so_far.z, so_far.w};
            add_channel(&left, problem, band, otf, z, frame, prior, variance, c, i, scratch + at, each);
            sums[at] = (float4)(left.re, left.im, left.cost, left.spread);
        }
    }
    FFT_SHARE_SIDE(y, n, side)
    {
        const uint i = (block * (uint)n + y) * HADA_FFT_BLOCK + col;
        const float4 all = sums[y * width + side.w];
        const refine_left left = {all.x, all.y, all.z, all.w};
        const float energy = refine_badness(&left, problem.channels);
        if (2 * (uint)min(y, n - y) < band.rows)
            sum += refine_count(refine_band(energy, i, n, HADA_FFT_BLOCK, band.cols), i, n, HADA_FFT_BLOCK,
                                problem.spectrum.cols);
    }
    REFINE_PARTIAL(partial, (problem.sums.first + (size_t)set * get_num_groups(0) + get_group_id(0)), sum)
}
