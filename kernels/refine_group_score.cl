/* As refine_score of refine.cl, from half spectra of rows as refine_group_rows.cl leaves them, by work-groups: a group
 * takes `width` columns of one block of all planes of a set, channel after channel. Spectra of planes are never stored.
 *
 * Buffers as in refine_group_columns.cl; variance: as the OTFs, real; NULL where job.band has none.
 * partial: [set][part of a block]
 * sums: float4 [n][width], over channels, then scratch: float2 [depth of the set][n][width]
 * Dimensions: parts of blocks of columns, sets. */
#include "shared_refine.h"
#define REFINE_GROUP HADA_REFINE_FUSED_GROUP
#include "inc_refine_groups.h"

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_group_score(__global const float *planes, __global const float *otf, __global const int *list,
                   __global const float *frame, __global const float *prior, __global const float *variance,
                   __global float *partial, hada_refine_scoring job, __local float4 *sums)
{
    REFINE_LOCAL
    __global const int *table = list + job.table;
    const hada_refine_problem problem = job.problem;
    const hada_refine_band band = job.band;
    const int depths = problem.depths, n = table[FFT_LENGTH], stages = table[FFT_STAGES], width = job.width;
    const int each = n * width;
    const fft_side side = fft_side_of(width);
    __global const int *place = table + table[FFT_PLACE], *z = list + get_group_id(1) * (uint)depths;
    __global const float *floats = FFT_FLOATS_OF(table);
    const uint parts = HADA_FFT_BLOCK / width, blocks = get_num_groups(0) / parts, set = get_group_id(1);
    const uint block = get_group_id(0) / parts, col = get_group_id(0) % parts * width + side.w;
    const size_t block_values = (size_t)job.rows * HADA_FFT_BLOCK, plane_values = blocks * block_values;
    __local float2 *scratch = (__local float2 *)(sums + each);
    float sum = 0.0f;

    for (uint c = 0; c < problem.channels; ++c) {
        const size_t first = (size_t)set * depths * problem.channels + c;
        __global const float2 *window =
            (__global const float2 *)planes + first * plane_values + block * block_values + col;
        FFT_WAIT();
        for (int s = 0; s < depths; ++s)
            refine_column_in(scratch + s * each, window + s * problem.channels * plane_values, job.row0, job.rows, n,
                             place, side);
        refine_stages(scratch, n * depths, side, table, floats, 0, 0, stages);
        FFT_WAIT();
        FFT_SHARE_SIDE(y, n, side)
        {
            /* an item has the same points in every channel */
            const int at = y * width + side.w;
            const refine_held held = {scratch + at, each};
            const float4 so_far = c ? sums[at] : (float4)0.0f;
            refine_left left = {so_far.x, so_far.y, so_far.z, so_far.w};
            refine_add_channel(&left, &problem, band, z, c, (block * (uint)n + y) * HADA_FFT_BLOCK + col, otf, frame,
                               prior, variance, held);
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
