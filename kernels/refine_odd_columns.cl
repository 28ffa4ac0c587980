/* As refine_group_columns.cl, for lengths whose last stage is of radix 43 (inc_fft_groups_odd.h) and sensors that do
 * not crop. On the way in the stages go backwards, so that the last one comes first and reads the window's rows
 * straight from memory; on the way out it comes last and writes them there. Between the transforms points are in
 * digit-reversed order.
 *
 * Buffers as in refine_group_columns.cl, without A and E. Dimensions: parts of blocks of columns, channels, sets. */
#include "shared_refine.h"
#define REFINE_GROUP HADA_REFINE_ODD_GROUP
#include "inc_fft_groups_odd.h"
#include "inc_refine_groups.h"

/* A row of a column of the window; zero beyond. */
FFT_INLINE float2 row_of(__global const float2 *window, int row, int rows)
{
    return (uint)row < (uint)rows ? window[(size_t)row * HADA_FFT_BLOCK] : (float2)0.0f;
}

/* Parts swapped: the transform was an inverse one. */
FFT_INLINE void put_row(__global float2 *window, int row, int rows, float2 value)
{
    if ((uint)row < (uint)rows)
        window[(size_t)row * HADA_FFT_BLOCK] = value.yx;
}

/* Outputs m0 ... m1, literals, of the stage of radix 43 backwards and their mirror images 43 - m: butterfly j from the
 * window to scratch. All at once would take more registers than there are. */
FFT_INLINE void way_in(__global const float2 *window, const hada_refine_columns *job, fft_odd_stage stage, int j,
                       int m0, int m1, __local float2 *to)
{
    const int span = stage.span;
    fft_odd_halves sums;
    fft_odd_begin(&sums, m0, m1, row_of(window, j - job->row0, job->rows));
    for (int k = 1; k <= FFT_ODD_PAIRS; ++k)
        if (fft_odd_holds_pair(stage.range, k))
            fft_odd_add(&sums, m0, m1, fft_odd_turns(stage.cosines, k),
                        row_of(window, j + k * span - job->row0, job->rows),
                        row_of(window, j + (FFT_ODD_RADIX - k) * span - job->row0, job->rows));
    fft_odd_leave(&sums, m0, m1, to, stage.step, stage.twiddles + j, span);
}

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_odd_columns(__global float *planes, __global const float *otf, __global const int *list,
                   __global const float *frame, __global const float *prior, __global float *now_w,
                   __global float *partial, hada_refine_columns job, __local float2 *scratch)
{
    REFINE_LOCAL
    const hada_refine_step now = job.step;
    __global const int *table = list + job.table;
    const int depths = now.problem.depths, n = table[FFT_LENGTH], cold = now.start == HADA_REFINE_COLD;
    const int each = n * job.width, last = table[FFT_STAGES] - 1;
    __global const int *place = table + table[FFT_PLACE];
    __global const float *floats = FFT_FLOATS_OF(table);
    const refine_column column = refine_column_of(&job, planes, otf, list, frame, prior, now_w);
    const fft_side side = column.side;
    const fft_odd_stage stage = fft_odd_stage_of(table, job.width, job.row0, job.rows);
    const int span = stage.span;
    float sum = 0.0f;

    FFT_SHARE_SIDE(i, (cold ? 0 : depths * span), side)
    {
        const int s = i / span, j = i - s * span;
        __global const float2 *from = column.window + s * column.window_step;
        __local float2 *to = scratch + s * each + j * job.width + side.w;
        way_in(from, &job, stage, j, 0, FFT_ODD_PAIRS / 2, to);
        way_in(from, &job, stage, j, FFT_ODD_PAIRS / 2 + 1, FFT_ODD_PAIRS, to);
    }
    refine_stages_back(scratch, n * depths, side, table, floats, 0, cold ? 0 : last);
    FFT_WAIT();
    FFT_SHARE_SIDE(y, n, side)
    sum += refine_column_step(&now, &column, scratch, y, n, place[y], each);
    refine_stages(scratch, n * depths, side, table, floats, 0, 0, last);
    /* other items have read what is written here */
    barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    FFT_SHARE_SIDE(i, depths * span, side)
    {
        const int s = i / span, j = i - s * span;
        __global float2 *to = column.window + s * column.window_step;
        float re[FFT_ODD_RADIX], im[FFT_ODD_RADIX];
        fft_odd_fetch(scratch + s * each + j * job.width + side.w, stage.step, stage.twiddles + j, span, re, im);
        if (fft_odd_holds(stage.range, 0))
            put_row(to, j - job.row0, job.rows, fft_odd_whole(re, im));
        for (int m = 1; m <= FFT_ODD_PAIRS; ++m)
            if (fft_odd_holds_pair(stage.range, m)) {
                const float4 x = fft_odd_outputs(re, im, fft_odd_turns(stage.cosines, m));
                put_row(to, j + m * span - job.row0, job.rows, x.lo);
                put_row(to, j + (FFT_ODD_RADIX - m) * span - job.row0, job.rows, x.hi);
            }
    }
    REFINE_PARTIAL(partial, (now.problem.sums.first + column.image * get_num_groups(0) + get_group_id(0)), sum)
}
