/* Activations and sums of tensors, value by value. x, y and gradients have one shape; outputs may be inputs. */
#include "inc_layers.h"

/* y = x above zero, slope * x below: ReLU with slope 0, nothing with slope 1. */
__kernel void net_leaky_forward(__global const float *x, ulong x_offset, ulong x_image, __global float *y,
                                ulong y_offset, ulong y_image, int rows, int cols, int blocks, int span, float slope)
{
    const net_part part = net_part_of(blocks, rows, span);
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(x_offset, x_image, part.image, part.block, r, rows, cols);
        __global float *out = y + net_row(y_offset, y_image, part.image, part.block, r, rows, cols);
        NET_EACH_PIXEL (c, cols) {
            const net_vector v = net_get(in + c * NET_BLOCK);
            net_put(fma((net_vector)slope, min(v, 0.0f), max(v, 0.0f)), out + c * NET_BLOCK);
        }
    }
}

/* From the output, whose sign is that of the input where the slope is not negative. */
__kernel void net_leaky_backward(__global const float *y, ulong y_offset, ulong y_image, __global const float *dy,
                                 ulong dy_offset, ulong dy_image, __global float *dx, ulong dx_offset, ulong dx_image,
                                 int rows, int cols, int blocks, int span, float slope)
{
    const net_part part = net_part_of(blocks, rows, span);
    for (int r = part.first; r < part.last; r++) {
        __global const float *out = y + net_row(y_offset, y_image, part.image, part.block, r, rows, cols);
        __global const float *from = dy + net_row(dy_offset, dy_image, part.image, part.block, r, rows, cols);
        __global float *to = dx + net_row(dx_offset, dx_image, part.image, part.block, r, rows, cols);
        NET_EACH_PIXEL (c, cols) {
            const net_vector g = net_get(from + c * NET_BLOCK);
            net_put(select(slope * g, g, net_get(out + c * NET_BLOCK) > 0.0f), to + c * NET_BLOCK);
        }
    }
}

__kernel void net_sigmoid_forward(__global const float *x, ulong x_offset, ulong x_image, __global float *y,
                                  ulong y_offset, ulong y_image, int rows, int cols, int blocks, int span, int channels)
{
    const net_part part = net_part_of(blocks, rows, span);
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(x_offset, x_image, part.image, part.block, r, rows, cols);
        __global float *out = y + net_row(y_offset, y_image, part.image, part.block, r, rows, cols);
        NET_EACH_PIXEL (c, cols) {
            const net_vector v = 1.0f / (1.0f + exp(-net_get(in + c * NET_BLOCK)));
            net_put(net_present(v, part.block, channels), out + c * NET_BLOCK);
        }
    }
}

__kernel void net_sigmoid_backward(__global const float *y, ulong y_offset, ulong y_image, __global const float *dy,
                                   ulong dy_offset, ulong dy_image, __global float *dx, ulong dx_offset, ulong dx_image,
                                   int rows, int cols, int blocks, int span)
{
    const net_part part = net_part_of(blocks, rows, span);
    for (int r = part.first; r < part.last; r++) {
        __global const float *out = y + net_row(y_offset, y_image, part.image, part.block, r, rows, cols);
        __global const float *from = dy + net_row(dy_offset, dy_image, part.image, part.block, r, rows, cols);
        __global float *to = dx + net_row(dx_offset, dx_image, part.image, part.block, r, rows, cols);
        NET_EACH_PIXEL (c, cols) {
            const net_vector s = net_get(out + c * NET_BLOCK);
            net_put(net_get(from + c * NET_BLOCK) * s * (1.0f - s), to + c * NET_BLOCK);
        }
    }
}

/* y = a x + b y; with b = 0 y is not read. */
__kernel void net_blend(__global const float *x, ulong x_offset, ulong x_image, __global float *y, ulong y_offset,
                        ulong y_image, int rows, int cols, int blocks, int span, float a, float b)
{
    const net_part part = net_part_of(blocks, rows, span);
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(x_offset, x_image, part.image, part.block, r, rows, cols);
        __global float *out = y + net_row(y_offset, y_image, part.image, part.block, r, rows, cols);
        if (b == 0.0f) {
            NET_EACH_PIXEL (c, cols)
                net_put(a * net_get(in + c * NET_BLOCK), out + c * NET_BLOCK);
        } else {
            NET_EACH_PIXEL (c, cols)
                net_put(fma((net_vector)a, net_get(in + c * NET_BLOCK), b * net_get(out + c * NET_BLOCK)),
                        out + c * NET_BLOCK);
        }
    }
}
