/* Fused steps by work-groups, of columns or rows in local memory: what refine_group_columns.cl, refine_group_rows.cl
 * and their forms for lengths with a factor of 43, refine_odd_columns.cl and refine_odd_rows.cl, share. A group holds
 * `width` transforms of n points side by side, number i of transform w at scratch[i * width + w]. */
#ifndef INC_REFINE_GROUPS_H
#define INC_REFINE_GROUPS_H

#define REFINE_WIDTH 1
#define REFINE_FUSED 1
#include "inc_fft_groups.h"
#include "inc_refine_step.h"
#include "shared_fft.h"

/* 1: a program of its own for sensors that crop. */
#ifndef REFINE_CROPPED
#define REFINE_CROPPED 0
#endif

/* Stages from ... to - 1 of the transforms of `points` points in all. late, a literal:
 * `floats` are looked up at each stage instead, which leaves kernels with many values more registers. */
REFINE_INLINE void refine_stages(__local float2 *scratch, int points, fft_side side, __global const int *table,
                                 __global const float *floats, int late, int from, int to)
{
    for (int s = from; s < to; ++s) {
        FFT_WAIT();
        fft_stage(scratch, points, side, table + FFT_HEADER + s * FFT_STAGE_INTS, late ? FFT_FLOATS_OF(table) : floats,
                  0);
    }
}

/* The stages to - 1 ... 0 backwards: from natural to digit-reversed order. */
REFINE_INLINE void refine_stages_back(__local float2 *scratch, int points, fft_side side, __global const int *table,
                                      __global const float *floats, int late, int to)
{
    for (int s = to - 1; s >= 0; --s) {
        FFT_WAIT();
        fft_stage(scratch, points, side, table + FFT_HEADER + s * FFT_STAGE_INTS, late ? FFT_FLOATS_OF(table) : floats,
                  1);
    }
}

/* Columns. What a work-item of a group has: the item's column of the group's block, of one channel of a set. */
typedef struct refine_column {
    fft_side side;
    refine_channel at;
    __global float2 *window; /* of the first depth, the window's first row; 8 values a row */
    size_t window_step;      /* from a depth's to the next one's */
    uint block, col, blocks; /* col: within the block */
    uint image;              /* set * channels + channel */
} refine_column;

REFINE_INLINE refine_column refine_column_of(const hada_refine_columns *job, __global float *planes,
                                             __global const float *otf, __global const int *list,
                                             __global const float *frame, __global const float *prior,
                                             __global float *now_w)
{
    const uint parts = HADA_FFT_BLOCK / job->width, channels = get_num_groups(1);
    const size_t block_values = (size_t)job->rows * HADA_FFT_BLOCK;
    refine_column column;
    column.side = fft_side_of(job->width);
    column.at =
        refine_channel_step(&job->step, get_group_id(2), get_group_id(1), channels, otf, list, frame, prior, now_w);
    column.blocks = get_num_groups(0) / parts;
    column.block = get_group_id(0) / parts;
    column.col = get_group_id(0) % parts * job->width + column.side.w;
    column.image = get_group_id(2) * channels + get_group_id(1);
    column.window =
        (__global float2 *)planes + (column.at.first * column.blocks + column.block) * block_values + column.col;
    column.window_step = (size_t)channels * column.blocks * block_values;
    return column;
}

/* The linear step at row y of the item's column, point `point` of its transforms; `each`: points of a depth's
 * transforms. Returns the energy to add up. */
REFINE_INLINE float refine_column_step(const hada_refine_step *now, const refine_column *column,
                                       __local float2 *scratch, int y, int n, int point, int each)
{
    const uint i = (column->block * (uint)n + y) * HADA_FFT_BLOCK + column->col;
    const refine_held held = {scratch + point * column->side.width + column->side.w, each};
    return refine_count(refine_step_at(now, &column->at, REFINE_CROPPED, i, held), i, n, HADA_FFT_BLOCK,
                        now->problem.spectrum.cols);
}

/* A column's rows from row0 on, of a grid of n, to scratch, each to its place; zero elsewhere. */
REFINE_INLINE void refine_column_in(__local float2 *scratch, __global const float2 *rows, int row0, int count, int n,
                                    __global const int *place, fft_side side)
{
    FFT_SHARE_SIDE(y, n, side)
    {
        const int row = y - row0;
        float2 v = (float2)0.0f;
        if ((uint)row < (uint)count)
            v = rows[(size_t)row * HADA_FFT_BLOCK];
        scratch[place[y] * side.width + side.w] = v;
    }
}

/* The way back; parts are swapped once more. */
REFINE_INLINE void refine_column_out(__local const float2 *scratch, __global float2 *rows, int row0, int count,
                                     __global const int *place, fft_side side)
{
    FFT_SHARE_SIDE(row, count, side)
    rows[(size_t)row * HADA_FFT_BLOCK] = scratch[place[row0 + row] * side.width + side.w].yx;
}

/* Rows. Half spectra are [block of eight columns][height rows][8]; a group takes `count` rows, at most 2 width, from
 * `values` on: row w and row width + w are the real and imaginary parts of transform w. `place`: the point at which a
 * frequency is in scratch; 0: in natural order. */
#define REFINE_ROW_POINT(place, k) ((place) ? (place)[k] : (k))

/* Half spectra of the two rows of transform w to a spectrum whose frequency k is point n - k: a forward transform of it
 * is an inverse one. */
REFINE_INLINE void refine_rows_together(__local float2 *scratch, __global const float2 *values, int height, int w,
                                        int count, int n, int width, __global const int *place)
{
    FFT_SHARE (k, n / 2 + 1) {
        __global const float2 *q =
            values + (size_t)(k / HADA_FFT_BLOCK * height + w) * HADA_FFT_BLOCK + k % HADA_FFT_BLOCK;
        float2 x = (float2)0.0f, y = (float2)0.0f;
        if (w < count)
            x = q[0];
        if (width + w < count)
            y = q[HADA_FFT_BLOCK * width];
        if (k == 0 || 2 * k == n) {
            scratch[REFINE_ROW_POINT(place, k) * width + w] = (float2)(x.x, y.x);
        } else {
            scratch[REFINE_ROW_POINT(place, n - k) * width + w] = (float2)(x.x - y.y, x.y + y.x);
            scratch[REFINE_ROW_POINT(place, k) * width + w] = (float2)(x.x + y.y, y.x - x.y);
        }
    }
}

/* The spectrum of transform w to the half spectra of its two rows; frequencies beyond n/2 are filled up with 0. */
REFINE_INLINE void refine_rows_apart(__local const float2 *scratch, __global float2 *values, int height, int w,
                                     int count, int n, int width, __global const int *place)
{
    FFT_SHARE (k, (n / 2 / HADA_FFT_BLOCK + 1) * HADA_FFT_BLOCK) {
        __global float2 *to = values + (size_t)(k / HADA_FFT_BLOCK * height + w) * HADA_FFT_BLOCK + k % HADA_FFT_BLOCK;
        float2 z = (float2)0.0f, u = z;
        if (k <= n / 2) {
            z = 0.5f * scratch[REFINE_ROW_POINT(place, k) * width + w];
            u = 0.5f * scratch[REFINE_ROW_POINT(place, k ? n - k : 0) * width + w];
        }
        to[0] = (float2)(z.x + u.x, z.y - u.y);
        if (width + w < count)
            to[HADA_FFT_BLOCK * width] = (float2)(z.y + u.y, u.x - z.x);
    }
}

#endif
