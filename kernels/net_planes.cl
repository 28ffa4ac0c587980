/* Planar images resized by linear interpolation (net_resize.cl, HADA_RESIZE_HALF): the arithmetic and the bits of
 * net_resize_linear, without tensors whose blocks a plane of one or three channels would leave nearly empty. Values
 * below `floor` become `floor`. Images: [image][channel][row][col]. A work-item takes PLANES_WIDE columns of `tall`
 * rows of a channel. Dimensions: runs of columns, runs of rows, channels times images. */
#include "inc_resize.h"

#ifndef PLANES_WIDE
#define PLANES_WIDE 64
#endif

__kernel void net_planes_resize(__global const float *restrict from, __global float *restrict to,
                                hada_planar_layout at_from, hada_planar_layout at_to, hada_planes_sizes sizes,
                                float floor)
{
    const int in_rows = sizes.in_rows, in_cols = sizes.in_cols, rows = sizes.rows, cols = sizes.cols;
    const int col = get_global_id(0) * PLANES_WIDE, wide = min(PLANES_WIDE, cols - col);
    const int first = get_global_id(1) * sizes.tall, last = min(first + sizes.tall, rows);
    const ulong channel = get_global_id(2) % sizes.channels, image = get_global_id(2) / sizes.channels;
    const net_at step = net_step_of(1, in_cols, cols, HADA_RESIZE_HALF);
    const float unit = 1.0f / step.whole;
    int col0[PLANES_WIDE], col1[PLANES_WIDE];
    float right[PLANES_WIDE];
    net_at at = net_at_of(col, in_cols, cols, HADA_RESIZE_HALF);
    for (int k = 0; k < PLANES_WIDE; ++k, at = net_walk(at, step)) { /* values beyond the last one are not stored */
        col0[k] = clamp(at.index, 0, in_cols - 1);
        col1[k] = clamp(at.index + 1, 0, in_cols - 1);
        right[k] = at.rest * unit;
    }
    from += at_from.offset + image * at_from.image + channel * at_from.channel;
    to += at_to.offset + image * at_to.image + channel * at_to.channel + col;
    for (int r = first; r < last; ++r) {
        const net_at row = net_at_of(r, in_rows, rows, HADA_RESIZE_HALF);
        const float down = row.rest * (1.0f / row.whole);
        __global const float *top = from + max(row.index, 0) * at_from.row;
        __global const float *low = from + min(row.index + 1, in_rows - 1) * at_from.row;
        __global float *out = to + r * at_to.row;
        for (int k = 0; k < wide; ++k) {
            const float a = max(top[col0[k]], floor), b = max(low[col0[k]], floor);
            const float upper = fma(right[k], max(top[col1[k]], floor) - a, a);
            const float lower = fma(right[k], max(low[col1[k]], floor) - b, b);
            out[k] = fma(down, lower - upper, upper);
        }
    }
}
