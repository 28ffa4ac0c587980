/* Batch normalisation of tensors in blocks of channels (lib/net/tensor.h). Sums run over parts of each block of
 * channels, then over runs of HADA_NORM_MERGE parts until one is left, always in the same order. Values per channel are
 * plain float arrays. */
#include "inc_layers.h"

/* y = (x - mean) * inverse * weight + bias, inverse being `second` itself or, where that is a variance,
 * 1 / sqrt(variance + eps). */
__kernel void net_batch_norm_apply(__global const float *x, __global float *y, __global const float *weight,
                                   __global const float *bias, __global const float *mean, __global const float *second,
                                   hada_tensor_layout at_x, hada_tensor_layout at_y, hada_norm_values at)
{
    const int rows = at_x.rows, cols = at_x.cols, channels = at_x.channels;
    const net_part part = net_part_of(at_x.blocks, rows, at.span);
    net_vector scale = net_per_channel(second + at.second, part.block, channels, 1.0f);
    if (at.is_variance)
        scale = 1.0f / sqrt(scale + at.eps);
    scale *= net_per_channel(weight + at.weight, part.block, channels, 0.0f);
    const net_vector centre = net_per_channel(mean + at.mean, part.block, channels, 0.0f);
    const net_vector shift = net_per_channel(bias + at.bias, part.block, channels, 0.0f);
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(at_x, part.image, part.block, r);
        __global float *out = y + net_row(at_y, part.image, part.block, r);
        NET_EACH_PIXEL (c, cols)
            net_put(fma(net_get(in + c * NET_BLOCK) - centre, scale, shift), out + c * NET_BLOCK);
    }
}

/* Place of part `index` among `parts` of a block, `vectors` each. */
NET_INLINE size_t net_part_place(int block, uint parts, uint index, int vectors)
{
    return ((size_t)block * parts + index) * vectors * NET_BLOCK + NET_FIRST_LANE;
}

/* A part belongs to a group: its first work-items write it. */
NET_INLINE uint net_part_index(net_part part)
{
    return (part.image * get_global_size(1) + get_global_id(1)) * get_num_groups(0) + get_group_id(0);
}

/* Mean, sum of squares about it, number of values: joined by the formula of Chan, Golub and LeVeque 1979. */
typedef struct net_moments {
    net_vector mean, squares, count;
} net_moments;

NET_INLINE net_moments net_join(net_moments a, net_moments b)
{
    const net_vector all = a.count + b.count, difference = b.mean - a.mean, share = b.count / max(all, 1.0f);
    a.mean = fma(difference, share, a.mean);
    a.squares += b.squares + difference * difference * a.count * share;
    a.count = all;
    return a;
}

/* Of each part: its mean, the sum of squares about it, the number of values. The part is read twice, the second time
 * from the cache, so that nothing cancels; the error of the first mean shows in the second pass (Chan, Golub, LeVeque
 * 1983). */
__kernel __attribute__((reqd_work_group_size(NET_GROUP, 1, 1))) void
net_batch_norm_statistics(__global const float *x, __global float *parts, hada_tensor_layout at_x, int span,
                          uint part_count)
{
    const int rows = at_x.rows, cols = at_x.cols;
    const net_part part = net_part_of(at_x.blocks, rows, span);
    net_vector sum = 0.0f, squares = 0.0f, off = 0.0f;
    int count = 0;
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(at_x, part.image, part.block, r);
        NET_EACH_PIXEL (c, cols) {
            sum += net_get(in + c * NET_BLOCK);
            count++;
        }
    }
    const net_vector mean = sum / (float)max(count, 1);
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(at_x, part.image, part.block, r);
        NET_EACH_PIXEL (c, cols) {
            const net_vector d = net_get(in + c * NET_BLOCK) - mean;
            squares = fma(d, d, squares);
            off += d;
        }
    }
    off /= (float)max(count, 1);
    net_moments own = {mean + off, fma(-(float)count * off, off, squares), (net_vector)(float)count};
#if NET_SHARES > 1
    __local net_moments all[NET_GROUP];
    all[get_local_id(0)] = own;
#define NET_JOIN(to, from) all[to] = net_join(all[to], all[from])
    NET_TREE(NET_JOIN)
    if (get_local_id(0) >= NET_SHARES)
        return;
    own = all[get_local_id(0)];
#endif
    __global float *to = parts + net_part_place(part.block, part_count, net_part_index(part), 3);
    net_put(own.mean, to);
    net_put(own.squares, to + NET_BLOCK);
    net_put(own.count, to + 2 * NET_BLOCK);
}

/* Joins runs of parts. Dimensions: parts of the result, blocks. */
__kernel void net_batch_norm_merge(__global float *parts, ulong in_offset, uint in_count, ulong out_offset,
                                   uint out_count)
{
    const uint index = NET_ITEM;
    const int block = get_global_id(1);
    if (index >= out_count)
        return;
    net_moments own = {(net_vector)0.0f, (net_vector)0.0f, (net_vector)0.0f};
    for (uint i = index * HADA_NORM_MERGE; i < min((index + 1) * HADA_NORM_MERGE, in_count); i++) {
        __global const float *from = parts + in_offset + net_part_place(block, in_count, i, 3);
        const net_moments more = {net_get(from), net_get(from + NET_BLOCK), net_get(from + 2 * NET_BLOCK)};
        own = net_join(own, more);
    }
    __global float *to = parts + out_offset + net_part_place(block, out_count, index, 3);
    net_put(own.mean, to);
    net_put(own.squares, to + NET_BLOCK);
    net_put(own.count, to + 2 * NET_BLOCK);
}

/* The batch's mean and 1 / sqrt(variance + eps), and the running values. One work-item per channel. */
__kernel void net_batch_norm_finish(__global const float *parts, __global float *saved, __global float *mean,
                                    __global float *variance, ulong parts_offset, ulong saved_offset, int channels,
                                    float momentum, hada_norm_values at)
{
    const int c = get_global_id(0);
    if (c >= channels)
        return;
    __global const float *from = parts + parts_offset + (size_t)(c / NET_BLOCK) * 3 * NET_BLOCK + c % NET_BLOCK;
    const float centre = from[0], squares = from[NET_BLOCK], count = from[2 * NET_BLOCK];
    saved[saved_offset + c] = centre;
    saved[saved_offset + channels + c] = 1.0f / sqrt(squares / count + at.eps);
    __global float *m = mean + at.mean + c, *v = variance + at.second + c;
    *m = fma(momentum, centre - *m, *m);
    *v = fma(momentum, squares / (count - 1.0f) - *v, *v);
}

/* Of each part: the sum of dy and of dy times the normalised x. */
__kernel __attribute__((reqd_work_group_size(NET_GROUP, 1, 1))) void
net_batch_norm_gradients(__global const float *x, __global const float *dy, __global const float *saved,
                         __global float *parts, hada_tensor_layout at_x, hada_tensor_layout at_dy, ulong saved_offset,
                         int span, uint part_count)
{
    const int rows = at_x.rows, cols = at_x.cols, channels = at_x.channels;
    const net_part part = net_part_of(at_x.blocks, rows, span);
    const net_vector mean = net_per_channel(saved + saved_offset, part.block, channels, 0.0f);
    net_vector sum = 0.0f, product = 0.0f;
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(at_x, part.image, part.block, r);
        __global const float *from = dy + net_row(at_dy, part.image, part.block, r);
        NET_EACH_PIXEL (c, cols) {
            const net_vector g = net_get(from + c * NET_BLOCK);
            sum += g;
            product = fma(g, net_get(in + c * NET_BLOCK) - mean, product);
        }
    }
    product *= net_per_channel(saved + saved_offset + channels, part.block, channels, 0.0f);
#if NET_SHARES > 1
    __local net_vector sums[NET_GROUP], products[NET_GROUP];
    sums[get_local_id(0)] = sum;
    products[get_local_id(0)] = product;
#define NET_ADD(to, from) (sums[to] += sums[from], products[to] += products[from])
    NET_TREE(NET_ADD)
    if (get_local_id(0) >= NET_SHARES)
        return;
    sum = sums[get_local_id(0)];
    product = products[get_local_id(0)];
#endif
    __global float *to = parts + net_part_place(part.block, part_count, net_part_index(part), 2);
    net_put(sum, to);
    net_put(product, to + NET_BLOCK);
}

__kernel void net_batch_norm_add(__global float *parts, ulong in_offset, uint in_count, ulong out_offset,
                                 uint out_count)
{
    const uint index = NET_ITEM;
    const int block = get_global_id(1);
    if (index >= out_count)
        return;
    net_vector sum = 0.0f, product = 0.0f;
    for (uint i = index * HADA_NORM_MERGE; i < min((index + 1) * HADA_NORM_MERGE, in_count); i++) {
        __global const float *from = parts + in_offset + net_part_place(block, in_count, i, 2);
        sum += net_get(from);
        product += net_get(from + NET_BLOCK);
    }
    __global float *to = parts + out_offset + net_part_place(block, out_count, index, 2);
    net_put(sum, to);
    net_put(product, to + NET_BLOCK);
}

/* The gradients of weight and bias. One work-item per channel. */
__kernel void net_batch_norm_weights(__global const float *parts, __global float *dweight, __global float *dbias,
                                     ulong parts_offset, ulong dweight_offset, ulong dbias_offset, int channels,
                                     int accumulate)
{
    const int c = get_global_id(0);
    if (c >= channels)
        return;
    __global const float *from = parts + parts_offset + (size_t)(c / NET_BLOCK) * 2 * NET_BLOCK + c % NET_BLOCK;
    __global float *w = dweight + dweight_offset + c, *b = dbias + dbias_offset + c;
    *b = from[0] + (accumulate ? *b : 0.0f);
    *w = from[NET_BLOCK] + (accumulate ? *w : 0.0f);
}

/* dx = weight * inverse * (dy - mean of dy - normalised x * mean of (dy * normalised x)). */
__kernel void net_batch_norm_backward(__global const float *x, __global const float *dy, __global float *dx,
                                      __global const float *saved, __global const float *weight,
                                      __global const float *parts, hada_norm_gradient at)
{
    const int rows = at.x.rows, cols = at.x.cols, channels = at.x.channels;
    const net_part part = net_part_of(at.x.blocks, rows, at.span);
    __global const float *sums = parts + at.sums + (size_t)part.block * 2 * NET_BLOCK + NET_FIRST_LANE;
    const net_vector mean = net_per_channel(saved + at.saved, part.block, channels, 0.0f);
    const net_vector inverse = net_per_channel(saved + at.saved + channels, part.block, channels, 0.0f);
    const net_vector scale = inverse * net_per_channel(weight + at.weight, part.block, channels, 0.0f);
    const net_vector level = net_get(sums) * at.per_value, slope = inverse * net_get(sums + NET_BLOCK) * at.per_value;
    for (int r = part.first; r < part.last; r++) {
        __global const float *in = x + net_row(at.x, part.image, part.block, r);
        __global const float *from = dy + net_row(at.dy, part.image, part.block, r);
        __global float *to = dx + net_row(at.dx, part.image, part.block, r);
        NET_EACH_PIXEL (c, cols) {
            const net_vector d = net_get(in + c * NET_BLOCK) - mean;
            net_put(scale * (net_get(from + c * NET_BLOCK) - level - d * slope), to + c * NET_BLOCK);
        }
    }
}
