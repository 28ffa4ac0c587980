/* Some steps of refine_tv.cl on a tile of the window by a work-group, which keeps its pixels in registers and exchanges
 * neighbours' values through local memory: one launch for several steps. Values at a tile's edges are wrong from the
 * first step on, by a pixel further in each step, so tiles overlap by a halo and write only the right values: the same
 * as step by step.
 *
 * The first launch of a proximal step (tile.first) reads the planes w and leaves a copy of them, at tile.copy behind
 * the duals in `next`; further launches read the copy, and the last one (tile.last) writes the planes u in the place of
 * w, which no group reads any more. Planes and duals: as in refine_tv.cl. Dimensions: tiles, places. */
#define REFINE_WIDTH 1
#ifndef TV_CHANNELS
#define TV_CHANNELS 3
#endif
#include "inc_refine_tv.h"
#include "shared_refine.h"

enum {
    TILE = HADA_REFINE_TV_TILE,
    GROUP = HADA_REFINE_TV_GROUP,
    BELOW = GROUP / TILE, /* rows from a pixel of an item to its next one */
    EACH = TILE / BELOW   /* pixels of an item */
};

#define TV_CHANNEL(c) _Pragma("unroll") for (int c = 0; c < TV_CHANNELS; ++c)
#define TV_PIXEL(e)   _Pragma("unroll") for (int e = 0; e < EACH; ++e)

/* p' at a pixel from the differences of u there, that along a row 0 at its end. */
REFINE_INLINE void tv_project(float *qi, float *qj, float per_colour)
{
    const float share = 1.0f / (float)TV_CHANNELS;
    float square = 0.0f, sum_i = 0.0f, sum_j = 0.0f, of_mean, of_rest;
    TV_CHANNEL (c) {
        square = fma(qi[c], qi[c], fma(qj[c], qj[c], square));
        sum_i += qi[c];
        sum_j += qj[c];
    }
    const float mean = share * fma(sum_i, sum_i, sum_j * sum_j);
    tv_shorten(mean, max(square - mean, 0.0f), per_colour, &of_mean, &of_rest);
    sum_i *= share * (of_mean - of_rest);
    sum_j *= share * (of_mean - of_rest);
    TV_CHANNEL (c) {
        qi[c] = fma(of_rest, qi[c], sum_i);
        qj[c] = fma(of_rest, qj[c], sum_j);
    }
}

/* The group's pixels of an image, `each` values a channel, 0 beyond it and where they are not asked for. */
REFINE_INLINE void tv_read(float v[EACH][TV_CHANNELS], __global const float *from, int each, int asked, int first_i,
                           int j, int rows, int cols)
{
    TV_PIXEL (e) {
        const int i = first_i + e * BELOW, there = asked && (uint)i < (uint)rows && (uint)j < (uint)cols;
        TV_CHANNEL (c)
            v[e][c] = there ? from[c * each + i * cols + j] : 0.0f;
    }
}

/* Values of the group's pixels to local memory, [channel][tile]. */
REFINE_INLINE void tv_hand_over(__local float *to, int y, int x, float v[EACH][TV_CHANNELS])
{
    TV_PIXEL (e) {
        TV_CHANNEL (c)
            to[(c * TILE + y + e * BELOW) * TILE + x] = v[e][c];
    }
}

/* u = max(0, w + theta div p), p in local memory: along columns and along rows. */
REFINE_INLINE void tv_primal(float u[EACH][TV_CHANNELS], float w[EACH][TV_CHANNELS], __local const float *along_cols,
                             __local const float *along_rows, int first_y, int x, float theta)
{
    TV_PIXEL (e) {
        const int y = first_y + e * BELOW;
        TV_CHANNEL (c) {
            const int at = (c * TILE + y) * TILE + x;
            const float up = y ? along_cols[at - TILE] : 0.0f, left = x ? along_rows[at - 1] : 0.0f;
            u[e][c] = max(fma(theta, (along_cols[at] - up) + (along_rows[at] - left), w[e][c]), 0.0f);
        }
    }
}

__kernel __attribute__((reqd_work_group_size(HADA_REFINE_TV_GROUP, 1, 1))) void
refine_tv_tile(__global float *planes, __global const float *old, __global float *next, hada_refine_tv_tile tile,
               float theta, float step, float per_colour)
{
    /* only p along rows is in local memory all the time; p along columns makes room for u there */
    __local float local_i[TV_CHANNELS * TILE * TILE], local_j[TV_CHANNELS * TILE * TILE];
    const int rows = tile.rows, cols = tile.cols, steps = tile.steps, lead = steps + tile.last;
    const int inner = TILE - lead - steps, across = (cols + inner - 1) / inner, area = rows * cols;
    const int item = get_local_id(0), x = item % TILE, first_y = item / TILE, number = get_group_id(0);
    const int j = number % across * inner - lead + x, top = number / across * inner - lead;
    const size_t image = (size_t)get_global_id(1) * TV_CHANNELS * area;
    __global const float *given = (tile.first ? planes : old + tile.copy) + image, *before = old + 2 * image;
    float w[EACH][TV_CHANNELS], u[EACH][TV_CHANNELS], p[EACH][TV_CHANNELS];

    /* one after the other: all loads at once would take more registers than there are */
    tv_read(u, before + area, 2 * area, !tile.fresh, top + first_y, j, rows, cols);
    tv_hand_over(local_j, first_y, x, u);
    barrier(CLK_LOCAL_MEM_FENCE);
    tv_read(p, before, 2 * area, !tile.fresh, top + first_y, j, rows, cols);
    barrier(CLK_LOCAL_MEM_FENCE);
    tv_read(w, given, area, 1, top + first_y, j, rows, cols);
    for (int k = 0; k < steps; ++k) {
        barrier(CLK_LOCAL_MEM_FENCE);
        tv_hand_over(local_i, first_y, x, p);
        barrier(CLK_LOCAL_MEM_FENCE);
        tv_primal(u, w, local_i, local_j, first_y, x, theta);
        barrier(CLK_LOCAL_MEM_FENCE);
        tv_hand_over(local_i, first_y, x, u);
        barrier(CLK_LOCAL_MEM_FENCE);
        TV_PIXEL (e) {
            const int y = first_y + e * BELOW, i = top + y;
            const int there = (uint)i < (uint)rows && (uint)j < (uint)cols;
            float q[TV_CHANNELS];
            TV_CHANNEL (c) {
                const int at = (c * TILE + y) * TILE + x;
                const float here = local_i[at], below = i + 1 < rows && y + 1 < TILE ? local_i[at + TILE] : here;
                const float right = x + 1 < TILE ? local_i[at + 1] : 0.0f;
                p[e][c] = there ? fma(step, below - here, p[e][c]) : 0.0f;
                q[c] = there && j + 1 < cols ? fma(step, right - here, local_j[at]) : 0.0f;
            }
            tv_project(p[e], q, per_colour);
            TV_CHANNEL (c)
                local_j[(c * TILE + y) * TILE + x] = q[c];
        }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    tv_hand_over(local_i, first_y, x, p);
    barrier(CLK_LOCAL_MEM_FENCE);
    /* made here, not above: registers are scarce in the steps */
    __global float *of_planes = (tile.last ? planes : next + tile.copy) + image, *after = next + 2 * image;
    if (tile.last)
        tv_primal(w, w, local_i, local_j, first_y, x, theta);
    TV_PIXEL (e) {
        const int y = first_y + e * BELOW, i = top + y, to = i * cols + j;
        const int within = y >= lead && y < TILE - steps && x >= lead && x < TILE - steps && i < rows && j < cols;
        TV_CHANNEL (c) {
            if (within) {
                after[2 * c * area + to] = p[e][c];
                after[(2 * c + 1) * area + to] = local_j[(c * TILE + y) * TILE + x];
                of_planes[c * area + to] = w[e][c];
            }
        }
    }
}
