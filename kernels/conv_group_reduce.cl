/* Sums of the gradients of weights and biases for work-groups: the second half of conv_group_weights.cl, and what each
 * part of a tensor adds to the biases. */
#include "inc_conv.h"

#define CONV_FOURS (NET_BLOCK / 4)

/* dw[coarse][fine][place] from partial[part][coarse block][fine filled up][place][coarse], `blocks` coarse blocks. A
 * work-item takes four coarse channels of a place. Dimensions: fine channels times places times fours, blocks of coarse
 * channels. */
__kernel void conv_group_reduce_weights(__global const float *partial, __global float *dw, hada_conv_partials sizes,
                                        ulong dw_offset, int accumulate)
{
    const int places = sizes.places, fine_channels = sizes.fine_channels, parts = sizes.parts;
    const int which = get_global_id(0), four = which % CONV_FOURS * 4, place = which / CONV_FOURS % places;
    const int fine = which / CONV_FOURS / places, block = get_global_id(1), first = block * NET_BLOCK + four;
    const size_t part_floats = (size_t)sizes.blocks * sizes.fine_filled * places * NET_BLOCK;
    if (fine >= fine_channels)
        return;
    partial += (size_t)block * sizes.fine_filled * places * NET_BLOCK + (size_t)which * 4;
    float4 sum = *(__global const float4 *)partial;
    for (int part = 1; part < parts; ++part)
        sum += *(__global const float4 *)(partial + part * part_floats);
    const float lanes[4] = {sum.x, sum.y, sum.z, sum.w};
    __global float *to = dw + dw_offset + ((size_t)first * fine_channels + fine) * places + place;
#pragma unroll
    for (int k = 0; k < 4; ++k, to += (size_t)fine_channels * places)
        if (first + k < sizes.coarse_channels)
            *to = accumulate ? *to + lanes[k] : lanes[k];
}

/* Sums over rows: partial[part][block][lane] of the rows image * rows + row that belong to a part, a group for each.
 * Dimensions: the items, blocks, parts. */
__kernel __attribute__((reqd_work_group_size(HADA_CONV_GROUP_ITEMS, 1, 1))) void
conv_group_bias(__global const float *dy, __global float *partial, hada_tensor_layout at_dy, int images)
{
    __local float4 sums[HADA_CONV_GROUP_ITEMS];
    const int rows = at_dy.rows, pitch = (at_dy.cols + 2) * NET_BLOCK, item = get_local_id(0);
    const int block = get_global_id(1), part = get_global_id(2), parts = get_global_size(2);
    const int end = (int)((long)(part + 1) * images * rows / parts);
    float4 sum = (float4)(0.0f);
    dy += at_dy.offset + (size_t)block * (rows + 2) * pitch + pitch + NET_BLOCK;
    for (int line = (int)((long)part * images * rows / parts); line < end; ++line) {
        __global const float4 *p =
            (__global const float4 *)(dy + line / rows * at_dy.image + (size_t)(line % rows) * pitch);
        for (int i = item; i < at_dy.cols * CONV_FOURS; i += HADA_CONV_GROUP_ITEMS)
            sum += p[i];
    }
    sums[item] = sum;
    for (int left = HADA_CONV_GROUP_ITEMS / 2; left >= CONV_FOURS; left /= 2) {
        barrier(CLK_LOCAL_MEM_FENCE);
        if (item < left)
            sums[item] += sums[item + left];
    }
    if (item < CONV_FOURS)
        *(__global float4 *)(partial + ((size_t)part * get_global_size(1) + block) * NET_BLOCK + item * 4) = sums[item];
}
