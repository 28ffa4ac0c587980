/* As refine_columns.cl, by work-groups: a group takes `width` columns of one block (2, 4 or 8) of all depths of a set,
 * and where a sensor crops (REFINE_CROPPED, a program of its own) of E and A. For lengths without a stage of radix 43
 * whose other stages have butterflies. Between the transforms points are in natural order; the stages backwards leave
 * them in the digit-reversed order of the input.
 *
 * Buffers as in refine_columns.cl.
 * partial: [set][channel][part of a block]
 * scratch: float2 [depth of the set, then E][n][width]
 * Dimensions: parts of blocks of columns, channels, sets. */
#include "shared_refine.h"
#define REFINE_GROUP HADA_REFINE_FUSED_GROUP
#include "inc_refine_groups.h"

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_group_columns(__global float *planes, __global const float *otf, __global const int *list,
                     __global const float *frame, __global const float *prior, __global float *now_w,
                     __global float *partial, hada_refine_columns job, __local float2 *scratch)
{
    REFINE_LOCAL
    const hada_refine_step now = job.step;
    __global const int *table = list + job.table;
    const int depths = now.problem.depths, n = table[FFT_LENGTH], stages = table[FFT_STAGES];
    const int cold = now.start == HADA_REFINE_COLD, further = now.start == HADA_REFINE_CONTINUE, each = n * job.width;
    __global const int *place = table + table[FFT_PLACE];
    const refine_column column = refine_column_of(&job, planes, otf, list, frame, prior, now_w);
    const fft_side side = column.side;
    __global float2 *cropped =
        (__global float2 *)planes + now.split +
        ((size_t)column.image * column.blocks + column.block) * (size_t)job.frame_rows * HADA_FFT_BLOCK + column.col;
    float sum = 0.0f;

    for (int s = 0; s < (cold ? 0 : depths); ++s)
        refine_column_in(scratch + s * each, column.window + s * column.window_step, job.row0, job.rows, n, place,
                         side);
    for (int s = depths; s < depths + (REFINE_CROPPED && further); ++s) /* a loop, as PoCL wants it: FFT_SHARE */
        refine_column_in(scratch + s * each, cropped, job.frame_row0, job.frame_rows, n, place, side);
    refine_stages(scratch, n * (depths + (REFINE_CROPPED && further)), side, table, 0, 1, 0, cold ? 0 : stages);
    FFT_WAIT();
    FFT_SHARE_SIDE(y, n, side)
    sum += refine_column_step(&now, &column, scratch, y, n, y, each);
    refine_stages_back(scratch, n * (depths + REFINE_CROPPED), side, table, 0, 1, stages);
    /* other items have read what is written here */
    barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    for (int s = 0; s < depths; ++s)
        refine_column_out(scratch + s * each, column.window + s * column.window_step, job.row0, job.rows, place, side);
    for (int s = depths; s < depths + REFINE_CROPPED; ++s)
        refine_column_out(scratch + s * each, cropped, job.frame_row0, job.frame_rows, place, side);
    REFINE_PARTIAL(partial, (now.problem.sums.first + column.image * get_num_groups(0) + get_group_id(0)), sum)
}
