/* Losses of single values or of neighbours: the value as one sum per group of work-items, at sums[index of the group],
 * and the gradient, times `scale`. The sums are not scaled. */
#include "inc_layers.h"

NET_INLINE size_t net_group(void)
{
    return (get_global_id(2) * get_global_size(1) + get_global_id(1)) * get_num_groups(0) + get_group_id(0);
}

/* The sum of a group, in its place. */
#if NET_SHARES > 1
#define NET_ADD(to, from) (all[to] += all[from])
#define NET_PUT_SUM(sum, sums)                                                                                         \
    __local net_vector all[NET_GROUP];                                                                                 \
    all[get_local_id(0)] = sum;                                                                                        \
    NET_TREE(NET_ADD)                                                                                                  \
    barrier(CLK_LOCAL_MEM_FENCE);                                                                                      \
    if (get_local_id(0) == 0) {                                                                                        \
        for (int share = 1; share < NET_SHARES; share++)                                                               \
            all[0] += all[share];                                                                                      \
        sums[net_group()] = net_sum(all[0]);                                                                           \
    }
#else
#define NET_PUT_SUM(sum, sums) sums[net_group()] = net_sum(sum);
#endif

NET_INLINE net_vector net_sign(net_vector v)
{
    return select(select((net_vector)0.0f, (net_vector)-1.0f, v < 0.0f), (net_vector)1.0f, v > 0.0f);
}

NET_INLINE void net_gradient(net_vector g, __global float *to, int accumulate)
{
    net_put(accumulate ? g + net_get(to) : g, to);
}

__kernel __attribute__((reqd_work_group_size(NET_GROUP, 1, 1))) void
net_loss_values(__global const float *x, __global const float *target, __global float *dx, __global float *sums,
                hada_tensor_layout at_x, hada_tensor_layout at_target, hada_tensor_layout at_dx, int span,
                hada_loss_term term)
{
    const int rows = at_x.rows, cols = at_x.cols, channels = at_x.channels;
    const int kind = term.loss, has_gradient = term.has_gradient, accumulate = term.accumulate;
    const float scale = term.scale;
    const net_part part = net_part_of(at_x.blocks, rows, span);
    net_vector sum = 0.0f;
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(at_x, part.image, part.block, r);
        __global const float *aim = target + net_row(at_target, part.image, part.block, r);
        __global float *to = dx + net_row(at_dx, part.image, part.block, r);
        NET_EACH_PIXEL (c, cols) {
            const net_vector v = net_get(in + c * NET_BLOCK), t = net_get(aim + c * NET_BLOCK), d = v - t;
            net_vector g;
            if (kind == HADA_LOSS_MSE) {
                sum = fma(d, d, sum);
                g = 2.0f * scale * d;
            } else if (kind == HADA_LOSS_L1) {
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
    NET_PUT_SUM(sum, sums)
}

/* Total variation. At the edges the neighbour is the pixel itself, with a difference of 0. */
__kernel __attribute__((reqd_work_group_size(NET_GROUP, 1, 1))) void
net_loss_variation(__global const float *x, __global float *dx, __global float *sums, hada_tensor_layout at_x,
                   hada_tensor_layout at_dx, int span, hada_loss_term term)
{
    const int rows = at_x.rows, cols = at_x.cols, squared = term.loss == HADA_LOSS_TV_SQUARED;
    const int has_gradient = term.has_gradient, accumulate = term.accumulate;
    const float scale = term.scale;
    const net_part part = net_part_of(at_x.blocks, rows, span);
    const int pitch = (cols + 2) * NET_BLOCK;
    net_vector sum = 0.0f;
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(at_x, part.image, part.block, r);
        __global float *to = dx + net_row(at_dx, part.image, part.block, r);
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
    NET_PUT_SUM(sum, sums)
}
