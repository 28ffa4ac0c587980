/* The distance of two images' features at every pixel, a stage of LPIPS (Zhang et al., CVPR 2018): both scaled to unit
 * length over the channels, the squared differences weighted per channel.
 *     out[p][r][c] = sum_k w[k] (x[p][k][r][c] / |x[p][r][c]| - x[pairs + p][k][r][c] / |x[pairs + p][r][c]|)^2 */
#include "inc_layers.h"

/* Equal features must give 0, so products are rounded before they are subtracted. */
#pragma OPENCL FP_CONTRACT OFF

NET_INLINE float lpips_per_length(__global const float *pixel, size_t plane, int blocks)
{
    net_vector sum = 0.0f;
    for (int b = 0; b < blocks; b++) {
        const net_vector v = net_get(pixel + b * plane);
        sum += v * v;
    }
    return 1.0f / (sqrt(net_sum(sum)) + 1e-10f);
}

/* Dimension 2 counts pairs. w: one plain float per channel. */
__kernel void lpips_distance(__global const float *x, __global const float *w, __global float *out,
                             hada_tensor_layout at_x, ulong w_offset, ulong out_offset, int pairs, int span)
{
    const int channels = at_x.channels, rows = at_x.rows, cols = at_x.cols, blocks = at_x.blocks;
    const net_part part = net_part_of(1, rows, span);
    const size_t plane = (size_t)(rows + 2) * (cols + 2) * NET_BLOCK;
    for (int r = part.first; r < part.last; r++) {
        __global const float *a = x + net_row(at_x, part.image, 0, r);
        __global const float *b = x + net_row(at_x, pairs + part.image, 0, r);
        __global float *to = out + out_offset + ((size_t)part.image * rows + r) * cols;
        NET_EACH_PIXEL (c, cols) {
            const float per_a = lpips_per_length(a + c * NET_BLOCK, plane, blocks);
            const float per_b = lpips_per_length(b + c * NET_BLOCK, plane, blocks);
            net_vector sum = 0.0f;
            for (int k = 0; k < blocks; k++) {
                const net_vector unit_a = net_get(a + k * plane + c * NET_BLOCK) * per_a;
                const net_vector unit_b = net_get(b + k * plane + c * NET_BLOCK) * per_b;
                const net_vector d = unit_a - unit_b;
                sum += net_per_channel(w + w_offset, k, channels, 0.0f) * d * d;
            }
            to[c] = net_sum(sum);
        }
    }
}
