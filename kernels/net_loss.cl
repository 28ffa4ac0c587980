/* Losses that look at single values or neighbours: the value as one sum per work-item, at sums[index of the work-item],
 * and the gradient, times `scale`. Sums are not scaled. */
#include "inc_layers.h"

#define LOSS_SQUARED  0
#define LOSS_ABSOLUTE 1
#define LOSS_LOGITS   2

NET_INLINE size_t net_item(void)
{
    return (get_global_id(2) * get_global_size(1) + get_global_id(1)) * get_global_size(0) + get_global_id(0);
}

NET_INLINE net_vector net_sign(net_vector v)
{
    return select(select((net_vector)0.0f, (net_vector)-1.0f, v < 0.0f), (net_vector)1.0f, v > 0.0f);
}

NET_INLINE void net_gradient(net_vector g, __global float *to, int accumulate)
{
    net_put(accumulate ? g + net_get(to) : g, to);
}

__kernel void net_loss_values(__global const float *x, ulong x_offset, ulong x_image, __global const float *target,
                              ulong target_offset, ulong target_image, __global float *dx, ulong dx_offset,
                              ulong dx_image, int rows, int cols, int blocks, int span, int channels, int kind,
                              float scale, int has_gradient, int accumulate, __global float *sums)
{
    const net_part part = net_part_of(blocks, rows, span);
    net_vector sum = 0.0f;
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(x_offset, x_image, part.image, part.block, r, rows, cols);
        __global const float *aim =
            target + net_row(target_offset, target_image, part.image, part.block, r, rows, cols);
        __global float *to = dx + net_row(dx_offset, dx_image, part.image, part.block, r, rows, cols);
        NET_EACH_PIXEL (c, cols) {
            const net_vector v = net_get(in + c * NET_BLOCK), t = net_get(aim + c * NET_BLOCK), d = v - t;
            net_vector g;
            if (kind == LOSS_SQUARED) {
                sum = fma(d, d, sum);
                g = 2.0f * scale * d;
            } else if (kind == LOSS_ABSOLUTE) {
                sum += fabs(d);
                g = scale * net_sign(d);
            } else {
                const net_vector e = exp(-fabs(v)), low = e / (1.0f + e);
                sum += net_present(fma(-v, t, max(v, 0.0f)) + log1p(e), part.block, channels);
                g = net_present(scale * (select(low, 1.0f / (1.0f + e), v > 0.0f) - t), part.block, channels);
            }
            if (has_gradient)
                net_gradient(g, to + c * NET_BLOCK, accumulate);
        }
    }
    sums[net_item()] = net_sum(sum);
}

/* Total variation. At the edges the neighbour is the pixel itself, whose difference counts nothing. */
__kernel void net_loss_variation(__global const float *x, ulong x_offset, ulong x_image, __global float *dx,
                                 ulong dx_offset, ulong dx_image, int rows, int cols, int blocks, int span, int squared,
                                 float scale, int has_gradient, int accumulate, __global float *sums)
{
    const net_part part = net_part_of(blocks, rows, span);
    const int pitch = (cols + 2) * NET_BLOCK;
    net_vector sum = 0.0f;
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(x_offset, x_image, part.image, part.block, r, rows, cols);
        __global float *to = dx + net_row(dx_offset, dx_image, part.image, part.block, r, rows, cols);
        const int up = r > 0 ? -pitch : 0, down = r + 1 < rows ? pitch : 0;
        NET_EACH_PIXEL (c, cols) {
            __global const float *here = in + c * NET_BLOCK;
            const net_vector v = net_get(here);
            const net_vector right = net_get(here + (c + 1 < cols ? NET_BLOCK : 0)) - v;
            const net_vector low = net_get(here + down) - v;
            sum += squared ? fma(right, right, low * low) : fabs(right) + fabs(low);
            if (has_gradient) {
                const net_vector left = v - net_get(here - (c > 0 ? NET_BLOCK : 0)), high = v - net_get(here + up);
                const net_vector g = squared ? 2.0f * ((left - right) + (high - low))
                                             : (net_sign(left) - net_sign(right)) + (net_sign(high) - net_sign(low));
                net_gradient(scale * g, to + c * NET_BLOCK, accumulate);
            }
        }
    }
    sums[net_item()] = net_sum(sum);
}
