/* Pooling of tensors in blocks of channels over windows of size x size every `stride` pixels, without padding, and its
 * gradient. The work is divided by the tensor that is written (inc_layers.h). */
#include "inc_layers.h"

/* The largest value of each window, or the mean. */
__kernel void net_pool_forward(__global const float *x, __global float *y, hada_tensor_layout at_x,
                               hada_tensor_layout at_y, int span, hada_pool_window windows, int mean)
{
    const int in_cols = at_x.cols, rows = at_y.rows, cols = at_y.cols;
    const int size = windows.size, stride = windows.stride;
    const net_part part = net_part_of(at_y.blocks, rows, span);
    const int pitch = (in_cols + 2) * NET_BLOCK;
    const float share = 1.0f / (size * size);
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(at_x, part.image, part.block, r * stride);
        __global float *out = y + net_row(at_y, part.image, part.block, r);
        NET_EACH_PIXEL (c, cols) {
            __global const float *window = in + c * stride * NET_BLOCK;
            net_vector v;
            if (!mean && size == 2) {
                v = max(max(net_get(window), net_get(window + NET_BLOCK)),
                        max(net_get(window + pitch), net_get(window + pitch + NET_BLOCK)));
            } else {
                v = mean ? (net_vector)0.0f : net_get(window);
                for (int i = 0; i < size; i++)
                    for (int k = 0; k < size; k++) {
                        const net_vector one = net_get(window + i * pitch + k * NET_BLOCK);
                        v = mean ? v + one : max(v, one);
                    }
            }
            net_put(mean ? v * share : v, out + c * NET_BLOCK);
        }
    }
}

/* The windows that pixel `at` belongs to: from the first to before the last. */
NET_INLINE int net_window_first(int at, int size, int stride)
{
    return at < size ? 0 : (at - size) / stride + 1;
}

NET_INLINE int net_window_end(int at, int stride, int count)
{
    return min(at / stride + 1, count);
}

/* A window's gradient goes to the first of its values, row by row, that equals its maximum. */
__kernel void net_pool_max_backward(__global const float *x, __global const float *y, __global const float *dy,
                                    __global float *dx, hada_pool_gradient at)
{
    const int in_rows = at.dx.rows, in_cols = at.dx.cols, rows = at.dy.rows, cols = at.dy.cols;
    const int size = at.windows.size, stride = at.windows.stride, accumulate = at.accumulate;
    const net_part part = net_part_of(at.dx.blocks, in_rows, at.span);
    const int pitch = (in_cols + 2) * NET_BLOCK, out_pitch = (cols + 2) * NET_BLOCK;
    __global const float *top = x + net_row(at.x, part.image, part.block, 0);
    __global const float *largest = y + net_row(at.y, part.image, part.block, 0);
    __global const float *from = dy + net_row(at.dy, part.image, part.block, 0);
    for (int r = part.first; r < part.last; r++) {
        __global float *to = dx + net_row(at.dx, part.image, part.block, r);
        const int row0 = net_window_first(r, size, stride), row1 = net_window_end(r, stride, rows);
        NET_EACH_PIXEL (c, in_cols) {
            const net_vector own = net_get(top + r * pitch + c * NET_BLOCK);
            net_vector sum = accumulate ? net_get(to + c * NET_BLOCK) : (net_vector)0.0f;
            const int col0 = net_window_first(c, size, stride), col1 = net_window_end(c, stride, cols);
            for (int i = row0; i < row1; i++)
                for (int k = col0; k < col1; k++) {
                    const int place = i * out_pitch + k * NET_BLOCK;
                    const net_vector m = net_get(largest + place);
                    net_lanes here = own == m;
                    for (int u = i * stride; u <= r; u++)
                        for (int w = k * stride; w < (u < r ? k * stride + size : c); w++)
                            here &= net_get(top + u * pitch + w * NET_BLOCK) != m;
                    sum += select((net_vector)0.0f, net_get(from + place), here);
                }
            net_put(sum, to + c * NET_BLOCK);
        }
    }
}

/* The same for windows of 2 x 2 that do not overlap: window by window. The parts are rows of windows, the incomplete
 * ones at the end counted, which get zeros. */
__kernel void net_pool_max2_backward(__global const float *x, __global const float *y, __global const float *dy,
                                     __global float *dx, hada_pool_gradient at)
{
    const int in_rows = at.dx.rows, in_cols = at.dx.cols, rows = at.dy.rows, cols = at.dy.cols;
    const int accumulate = at.accumulate;
    const net_part part = net_part_of(at.dx.blocks, (in_rows + 1) / 2, at.span);
    const int pitch = (in_cols + 2) * NET_BLOCK;
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(at.x, part.image, part.block, 2 * r);
        __global const float *out = y + net_row(at.y, part.image, part.block, r);
        __global const float *from = dy + net_row(at.dy, part.image, part.block, r);
        __global float *to = dx + net_row(at.dx, part.image, part.block, 2 * r);
        NET_EACH_PIXEL (c, (in_cols + 1) / 2) {
            const int place = 2 * c * NET_BLOCK;
            if (r < rows && c < cols) {
                const net_vector m = net_get(out + c * NET_BLOCK), g = net_get(from + c * NET_BLOCK), none = 0.0f;
                const net_lanes a = net_get(in + place) == m, b = ~a & (net_get(in + place + NET_BLOCK) == m);
                const net_lanes d = ~(a | b) & (net_get(in + place + pitch) == m);
                const net_lanes e = ~(a | b | d) & (net_get(in + place + pitch + NET_BLOCK) == m);
                net_vector ga = select(none, g, a), gb = select(none, g, b);
                net_vector gd = select(none, g, d), ge = select(none, g, e);
                if (accumulate) {
                    ga += net_get(to + place);
                    gb += net_get(to + place + NET_BLOCK);
                    gd += net_get(to + place + pitch);
                    ge += net_get(to + place + pitch + NET_BLOCK);
                }
                net_put(ga, to + place);
                net_put(gb, to + place + NET_BLOCK);
                net_put(gd, to + place + pitch);
                net_put(ge, to + place + pitch + NET_BLOCK);
            } else if (!accumulate) {
                for (int i = 0; i < min(2, in_rows - 2 * r); i++)
                    for (int k = 0; k < min(2, in_cols - 2 * c); k++)
                        net_put((net_vector)0.0f, to + place + i * pitch + k * NET_BLOCK);
            }
        }
    }
}

__kernel void net_pool_mean_backward(__global const float *dy, __global float *dx, hada_tensor_layout at_dy,
                                     hada_tensor_layout at_dx, int span, hada_pool_window windows, int accumulate)
{
    const int in_rows = at_dx.rows, in_cols = at_dx.cols, rows = at_dy.rows, cols = at_dy.cols;
    const int size = windows.size, stride = windows.stride;
    const net_part part = net_part_of(at_dx.blocks, in_rows, span);
    const int out_pitch = (cols + 2) * NET_BLOCK;
    const float share = 1.0f / (size * size);
    __global const float *from = dy + net_row(at_dy, part.image, part.block, 0);
    for (int r = part.first; r < part.last; r++) {
        __global float *to = dx + net_row(at_dx, part.image, part.block, r);
        const int row0 = net_window_first(r, size, stride), row1 = net_window_end(r, stride, rows);
        NET_EACH_PIXEL (c, in_cols) {
            const int col0 = net_window_first(c, size, stride), col1 = net_window_end(c, stride, cols);
            net_vector sum = 0.0f;
            for (int i = row0; i < row1; i++)
                for (int k = col0; k < col1; k++)
                    sum += net_get(from + i * out_pitch + k * NET_BLOCK);
            sum *= share;
            net_put(accumulate ? sum + net_get(to + c * NET_BLOCK) : sum, to + c * NET_BLOCK);
        }
    }
}
