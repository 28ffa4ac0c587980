/* A step of the refinement along columns, while a block of columns of all depths of a set is in the cache: planes'
 * half spectra of rows become U by a forward transform, U and the last W become the next W by the linear step of
 * refine.cl, and an inverse transform makes half spectra of rows of the next W. U is never stored in global memory.
 * Where a sensor crops, E and A take the same way: E comes from half spectra of the frame's rows, and A becomes such.
 *
 * planes: complex [set][place in the set][channel][block of eight columns][row of the window][8]; cold: not read. From
 *     step.split on half spectra of E and A, as [set][channel][block][row of the frame][8]
 * list: the depths of the sets, and from job.table on the transform along columns (shared_fft_table.h)
 * partial: [set][channel][block], sums of |Y - sum H U|^2
 * the others: as in refine_solve
 * scratch: a block of columns for each depth of a set, and one more where a sensor crops
 * Dimensions: blocks of columns, channels, sets. */
#define REFINE_FUSED 1
#include "inc_fft_convolve.h"
#include "inc_refine_step.h"
#include "shared_local.h"

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
refine_columns(__global float *planes, __global const float *otf, __global const int *list, __global const float *frame,
               __global const float *prior, __global float *now_w, __global float *partial, hada_refine_columns job,
               __local STATED_SIZE float8 *scratch)
{
    const hada_refine_step now = job.step;
    __global const int *table = list + job.table;
    const int depths = now.problem.depths, padded = now.padded, n = table[FFT_LENGTH];
    __global const int *place = table + table[FFT_PLACE];
    __global const float *floats = FFT_FLOATS_OF(table);
    const uint block = get_group_id(0), blocks = get_num_groups(0), cols = now.problem.spectrum.cols;
    const uint channel = get_group_id(1), channels = get_num_groups(1), set = get_group_id(2);
    const refine_channel at = refine_channel_step(&now, set, channel, channels, otf, list, frame, prior, now_w);
    const fft_columns cropped = fft_window_block(planes + 2 * now.split, (set * channels + channel) * blocks + block,
                                                 job.frame_row0, job.frame_rows);
    float8 sum = 0.0f;
    if (now.start != HADA_REFINE_COLD)
        for (int s = 0; s < depths; ++s) {
            const fft_columns plane =
                fft_window_block(planes, (at.first + s * channels) * blocks + block, job.row0, job.rows);
            fft_enter(&plane, scratch + s * 2 * n, table, floats);
        }
    if (padded && now.start == HADA_REFINE_CONTINUE)
        fft_enter(&cropped, scratch + depths * 2 * n, table, floats);
    for (int row = 0; row < n; ++row) {
        const uint i = (block * (uint)n + row) * 8;
        const refine_held held = {scratch + 2 * place[row], 2 * n};
        sum += refine_count(refine_step_at(&now, &at, padded, i, held), i, n, 8, cols);
    }
    for (int s = 0; s < depths; ++s) {
        const fft_columns plane =
            fft_window_block(planes, (at.first + s * channels) * blocks + block, job.row0, job.rows);
        fft_leave(&plane, scratch + s * 2 * n, table, floats);
    }
    if (padded)
        fft_leave(&cropped, scratch + depths * 2 * n, table, floats);
    partial[now.problem.sums.first + (set * channels + channel) * blocks + block] = refine_sum(sum);
}
