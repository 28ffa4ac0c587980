/* Adds partial sums in order: the second half of the gradients of weights and biases, and what each part of a tensor
 * adds to the biases. */
#include "inc_conv.h"

/* 1: without the kernels of the lanes shape. */
#ifndef CONV_GROUPS
#define CONV_GROUPS 0
#endif
#if !CONV_GROUPS

/* dw[coarse][fine][place] from partial[part][coarse block][fine filled up][place][coarse], `blocks` coarse blocks.
 * Where they are swapped, dw[fine][coarse][places - 1 - place]. Dimensions: fine channels, blocks of coarse channels.
 */
__kernel void conv_reduce_weights(__global const float *partial, __global float *dw, hada_conv_partials sizes,
                                  ulong dw_offset, int accumulate)
{
    const int parts = sizes.parts, places = sizes.places, fine_filled = sizes.fine_filled;
    const int fine_channels = sizes.fine_channels;
    const int fine = get_global_id(0), block = get_global_id(1);
    const int present = min(NET_BLOCK, sizes.coarse_channels - block * NET_BLOCK);
    const int swapped = sizes.swapped, lane_step = (swapped ? 1 : fine_channels) * places;
    const int fine_step = (swapped ? sizes.coarse_channels : 1) * places;
    const size_t part_floats = (size_t)sizes.blocks * fine_filled * places * NET_BLOCK;
    if (fine >= fine_channels)
        return;
    partial += ((size_t)block * fine_filled + fine) * places * NET_BLOCK;
    dw += dw_offset + (size_t)block * NET_BLOCK * lane_step + (size_t)fine * fine_step;
    for (int place = 0; place < places; ++place) {
        conv_v sum = CONV_LOAD(partial + place * NET_BLOCK);
        for (int part = 1; part < parts; ++part)
            sum += CONV_LOAD(partial + part * part_floats + place * NET_BLOCK);
        float lanes[NET_BLOCK];
        CONV_STORE_IN(__private, sum, lanes);
        for (int k = 0; k < present; ++k) {
            __global float *to = dw + (size_t)k * lane_step + (swapped ? places - 1 - place : place);
            *to = accumulate ? *to + lanes[k] : lanes[k];
        }
    }
}

/* Sums over rows: partial[part][block][lane] of the rows image * rows + row that belong to a part. Dimensions: blocks,
 * parts. */
__kernel void conv_bias_partial(__global const float *dy, __global float *partial, hada_tensor_layout at_dy, int images)
{
    const int rows = at_dy.rows, cols = at_dy.cols;
    const ulong image_stride = at_dy.image;
    const int block = get_global_id(0), part = get_global_id(1), parts = get_global_size(1);
    const int end = (part + 1) * (images * rows) / parts, pitch = (cols + 2) * NET_BLOCK;
    conv_v sum = (conv_v)(0.0f);
    dy += at_dy.offset + (size_t)block * (rows + 2) * pitch + pitch + NET_BLOCK;
    for (int line = part * (images * rows) / parts; line < end; ++line) {
        __global const float *p = dy + line / rows * image_stride + (size_t)(line % rows) * pitch;
        conv_v a = (conv_v)(0.0f), b = a, c = a, d = a;
        int col = 0;
        for (; col + 4 <= cols; col += 4) {
            a += CONV_LOAD(p + col * NET_BLOCK);
            b += CONV_LOAD(p + (col + 1) * NET_BLOCK);
            c += CONV_LOAD(p + (col + 2) * NET_BLOCK);
            d += CONV_LOAD(p + (col + 3) * NET_BLOCK);
        }
        for (; col < cols; ++col)
            a += CONV_LOAD(p + col * NET_BLOCK);
        sum += (a + b) + (c + d);
    }
    CONV_STORE(sum, partial + ((size_t)part * get_global_size(0) + block) * NET_BLOCK);
}

#endif

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

/* db from partial sums, which begin at `offset`. One work-item takes a channel. */
__kernel void conv_reduce_bias(__global const float *partial, __global float *db, ulong offset, ulong db_offset,
                               int parts, int blocks, int channels, int accumulate)
{
    const int channel = get_global_id(0);
    if (channel >= channels)
        return;
    float sum = 0.0f;
    for (int part = 0; part < parts; ++part)
        sum += partial[offset + (size_t)part * blocks * NET_BLOCK + channel];
    db += db_offset + channel;
    *db = accumulate ? *db + sum : sum;
}
