/* Activations and sums of tensors in blocks of channels, value by value. x, y and gradients have one shape; outputs may
 * be inputs. */
#include "inc_layers.h"

/* y = x above zero, slope * x below (ReLU with slope 0, the identity with slope 1), or 1 / (1 + exp(-x)). */
__kernel void net_activation_forward(__global const float *x, __global float *y, hada_tensor_layout at_x,
                                     hada_tensor_layout at_y, int span, int sigmoid, float slope)
{
    const int rows = at_x.rows, cols = at_x.cols, channels = at_x.channels;
    const net_part part = net_part_of(at_x.blocks, rows, span);
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(at_x, part.image, part.block, r);
        __global float *out = y + net_row(at_y, part.image, part.block, r);
        NET_EACH_PIXEL (c, cols) {
            const net_vector v = net_get(in + c * NET_BLOCK);
            net_put(sigmoid ? net_present(1.0f / (1.0f + exp(-v)), part.block, channels)
                            : fma((net_vector)slope, min(v, 0.0f), max(v, 0.0f)),
                    out + c * NET_BLOCK);
        }
    }
}

/* From the output, whose sign is that of the input where the slope is not negative. */
__kernel void net_activation_backward(__global const float *y, __global const float *dy, __global float *dx,
                                      hada_tensor_layout at_y, hada_tensor_layout at_dy, hada_tensor_layout at_dx,
                                      int span, int sigmoid, float slope)
{
    const int rows = at_y.rows, cols = at_y.cols;
    const net_part part = net_part_of(at_y.blocks, rows, span);
    for (int r = part.first; r < part.last; r++) {
        __global const float *out = y + net_row(at_y, part.image, part.block, r);
        __global const float *from = dy + net_row(at_dy, part.image, part.block, r);
        __global float *to = dx + net_row(at_dx, part.image, part.block, r);
        NET_EACH_PIXEL (c, cols) {
            const net_vector v = net_get(out + c * NET_BLOCK), g = net_get(from + c * NET_BLOCK);
            net_put(sigmoid ? g * v * (1.0f - v) : select(slope * g, g, v > 0.0f), to + c * NET_BLOCK);
        }
    }
}

/* y = a x + b y; with b = 0 y is not read. */
__kernel void net_blend(__global const float *x, __global float *y, hada_tensor_layout at_x, hada_tensor_layout at_y,
                        int span, float a, float b)
{
    const int rows = at_x.rows, cols = at_x.cols;
    const net_part part = net_part_of(at_x.blocks, rows, span);
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(at_x, part.image, part.block, r);
        __global float *out = y + net_row(at_y, part.image, part.block, r);
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
