/* Resizing of tensors in blocks of channels by interpolation, and the transposed operation by gathering. Along each
 * axis value i of the output is at a place on the input that is an exact fraction:
 *     aligned 0: (i + 1/2) in / out - 1/2        aligned 1: i (in - 1) / (out - 1)        nearest: i in / out
 * Its whole part and remainder are computed with integers, so that they are exact for every size. Taps outside the
 * input take its edge. Cubic: Keys 1981 with a = -0.75. */
#include "inc_layers.h"
#include "inc_resize.h"

/* The cubic weight of a tap at distance d below 2. */
NET_INLINE float net_cubic(float d)
{
    const float a = -0.75f;
    return d <= 1.0f ? fma(fma(a + 2.0f, d, -(a + 3.0f)) * d, d, 1.0f)
                     : fma(fma(fma(a, d, -5.0f * a), d, 8.0f * a), d, -4.0f * a);
}

__kernel void net_resize_nearest(__global const float *x, __global float *y, hada_tensor_layout at_x,
                                 hada_tensor_layout at_y, int span)
{
    const int in_rows = at_x.rows, in_cols = at_x.cols, rows = at_y.rows, cols = at_y.cols;
    const net_part part = net_part_of(at_y.blocks, rows, span);
    const net_at first = net_at_of(NET_ITEM, in_cols, cols, HADA_RESIZE_FLOOR);
    const net_at step = net_step_of(NET_ITEMS, in_cols, cols, HADA_RESIZE_FLOOR);
    for (int r = part.first; r < part.last; r++) {
        const int row = net_at_of(r, in_rows, rows, HADA_RESIZE_FLOOR).index;
        __global const float *in = x + net_row(at_x, part.image, part.block, row);
        __global float *out = y + net_row(at_y, part.image, part.block, r);
        net_at at = first;
        NET_EACH_PIXEL (c, cols) {
            net_put(net_get(in + at.index * NET_BLOCK), out + c * NET_BLOCK);
            at = net_walk(at, step);
        }
    }
}

__kernel void net_resize_linear(__global const float *x, __global float *y, hada_tensor_layout at_x,
                                hada_tensor_layout at_y, int span, int rule)
{
    const int in_rows = at_x.rows, in_cols = at_x.cols, rows = at_y.rows, cols = at_y.cols;
    const net_part part = net_part_of(at_y.blocks, rows, span);
    const net_at first = net_at_of(NET_ITEM, in_cols, cols, rule);
    const net_at step = net_step_of(NET_ITEMS, in_cols, cols, rule);
    const float unit = 1.0f / first.whole;
    const int pitch = (in_cols + 2) * NET_BLOCK;
    for (int r = part.first; r < part.last; r++) {
        const net_at row = net_at_of(r, in_rows, rows, rule);
        const net_vector down = (net_vector)(row.rest * (1.0f / row.whole));
        const int row0 = max(row.index, 0), row1 = min(row.index + 1, in_rows - 1);
        __global const float *top = x + net_row(at_x, part.image, part.block, row0);
        __global const float *low = top + (row1 - row0) * pitch;
        __global float *out = y + net_row(at_y, part.image, part.block, r);
        net_at at = first;
        NET_EACH_PIXEL (c, cols) {
            const int col0 = max(at.index, 0) * NET_BLOCK, col1 = min(at.index + 1, in_cols - 1) * NET_BLOCK;
            const net_vector right = (net_vector)(at.rest * unit);
            const net_vector a = net_get(top + col0), b = net_get(low + col0);
            const net_vector upper = fma(right, net_get(top + col1) - a, a);
            const net_vector lower = fma(right, net_get(low + col1) - b, b);
            net_put(fma(down, lower - upper, upper), out + c * NET_BLOCK);
            at = net_walk(at, step);
        }
    }
}

__kernel void net_resize_cubic(__global const float *x, __global float *y, hada_tensor_layout at_x,
                               hada_tensor_layout at_y, int span, int rule)
{
    const int in_rows = at_x.rows, in_cols = at_x.cols, rows = at_y.rows, cols = at_y.cols;
    const net_part part = net_part_of(at_y.blocks, rows, span);
    const net_at first = net_at_of(NET_ITEM, in_cols, cols, rule);
    const net_at step = net_step_of(NET_ITEMS, in_cols, cols, rule);
    const float unit = 1.0f / first.whole;
    const int pitch = (in_cols + 2) * NET_BLOCK;
    __global const float *in = x + net_row(at_x, part.image, part.block, 0);
    for (int r = part.first; r < part.last; r++) {
        const net_at row = net_at_of(r, in_rows, rows, rule);
        const float down = row.rest * (1.0f / row.whole);
        __global const float *line[4];
        net_vector weight[4];
        for (int i = 0; i < 4; i++) {
            line[i] = in + clamp(row.index + i - 1, 0, in_rows - 1) * pitch;
            weight[i] = (net_vector)net_cubic(fabs(down - (i - 1)));
        }
        __global float *out = y + net_row(at_y, part.image, part.block, r);
        net_at at = first;
        NET_EACH_PIXEL (c, cols) {
            const float right = at.rest * unit;
            net_vector sum = 0.0f;
            for (int k = 0; k < 4; k++) {
                const int col = clamp(at.index + k - 1, 0, in_cols - 1) * NET_BLOCK;
                net_vector across = weight[0] * net_get(line[0] + col);
                for (int i = 1; i < 4; i++)
                    across = fma(weight[i], net_get(line[i] + col), across);
                sum = fma((net_vector)net_cubic(fabs(right - (k - 1))), across, sum);
            }
            net_put(sum, out + c * NET_BLOCK);
            at = net_walk(at, step);
        }
    }
}

/* The first output whose whole part is `index` or above; `out` where there is none. */
NET_INLINE int net_first_from(int index, int in, int out, int rule)
{
    if (index <= (rule == HADA_RESIZE_HALF ? -1 : 0))
        return 0;
    int first;
    if (rule == HADA_RESIZE_ALIGNED)
        first = in > 1 ? (index * max(out - 1, 1) + in - 2) / (in - 1) : out;
    else if (rule == HADA_RESIZE_FLOOR)
        first = (index * out + in - 1) / in;
    else
        first = max(0, (2 * index + 1) * out - in + 2 * in - 1) / (2 * in);
    return min(first, out);
}

/* The weight with which the output at `at` takes input `to`: 1, 2 or 4 taps, those outside at the edge. */
NET_INLINE float net_weight(net_at at, float unit, int to, int in, int taps)
{
    const float rest = at.rest * unit;
    if (taps == 1)
        return 1.0f;
    if (taps == 2)
        return (max(at.index, 0) == to ? 1.0f - rest : 0.0f) + (min(at.index + 1, in - 1) == to ? rest : 0.0f);
    float sum = 0.0f;
    for (int k = -1; k < 3; k++)
        sum += clamp(at.index + k, 0, in - 1) == to ? net_cubic(fabs(rest - k)) : 0.0f;
    return sum;
}

/* Rows for which weights are computed at once. */
#define NET_TALL 16

/* dx from dy. */
__kernel void net_resize_backward(__global const float *dy, __global float *dx, hada_tensor_layout at_dy,
                                  hada_tensor_layout at_dx, int span, int rule, int taps, int accumulate)
{
    const int in_rows = at_dx.rows, in_cols = at_dx.cols, rows = at_dy.rows, cols = at_dy.cols;
    const net_part part = net_part_of(at_dx.blocks, in_rows, span);
    const int before = taps == 4 ? 1 : 0, behind = taps / 2; /* taps are at index - before ... index + behind */
    const int pitch = (cols + 2) * NET_BLOCK;
    const net_at one = net_step_of(1, in_cols, cols, rule), one_row = net_step_of(1, in_rows, rows, rule);
    const float unit = 1.0f / one.whole, row_unit = 1.0f / one_row.whole;
    __global const float *from = dy + net_row(at_dy, part.image, part.block, 0);
    for (int r = part.first; r < part.last; r++) {
        __global float *to = dx + net_row(at_dx, part.image, part.block, r);
        int first = net_first_from(r - behind, in_rows, rows, rule);
        const int end = net_first_from(r + before + 1, in_rows, rows, rule);
        int more = accumulate;
        do {
            const int tall = min(end - first, NET_TALL);
            float weight[NET_TALL];
            net_at row = net_at_of(first, in_rows, rows, rule);
            for (int i = 0; i < tall; i++, row = net_walk(row, one_row))
                weight[i] = net_weight(row, row_unit, r, in_rows, taps);
            int col0 = net_first_from(NET_ITEM - behind, in_cols, cols, rule);
            net_at at0 = net_at_of(col0, in_cols, cols, rule);
            NET_EACH_PIXEL (c, in_cols) {
                if (NET_ITEMS > 1) { /* far from the last pixel */
                    col0 = net_first_from(c - behind, in_cols, cols, rule);
                    at0 = net_at_of(col0, in_cols, cols, rule);
                }
                for (; col0 < cols && at0.index < c - behind; col0++)
                    at0 = net_walk(at0, one);
                net_at at = at0;
                net_vector sum = more ? net_get(to + c * NET_BLOCK) : (net_vector)0.0f;
                for (int k = col0; k < cols && at.index <= c + before; k++, at = net_walk(at, one)) {
                    __global const float *line = from + first * pitch + k * NET_BLOCK;
                    net_vector down = 0.0f;
                    for (int i = 0; i < tall; i++)
                        down = fma((net_vector)weight[i], net_get(line + i * pitch), down);
                    sum = fma((net_vector)net_weight(at, unit, c, in_cols, taps), down, sum);
                }
                net_put(sum, to + c * NET_BLOCK);
            }
            first += tall;
            more = 1;
        } while (first < end);
    }
}
