/* Images in and out of blocks of channels (lib/net/tensor.h), and operations on planar images. */

#include "inc_vectors.h"
#include "shared_net.h"

/* Activations in blocks of channels from and to planar floats, and zeros for the halo alone. A work-item takes a row of
 * a block or (TENSOR_FOURS, for work-groups) four channels of a pixel, an aligned access of 128 bits. Dimensions: 1, or
 * pixels times the fours of a block; rows; blocks times images. */
#ifndef TENSOR_FOURS
#define TENSOR_FOURS 0
#endif
#if TENSOR_FOURS
#define TENSOR_LANE(block)  ((int)get_global_id(0) % ((block) / 4) * 4)
#define TENSOR_PIXEL(block) ((int)get_global_id(0) / ((block) / 4))
#define TENSOR_ITEMS(block) ((int)get_global_size(0) / ((block) / 4))
#endif

/* Rows and columns with the halo; channels beyond the last one and the halo become zero. */
__kernel void net_tensor_load(__global const float *in, __global float *out, hada_planar_layout at_in,
                              hada_tensor_layout at_out, int block)
{
    const int channels = at_out.channels, rows = at_out.rows, cols = at_out.cols;
    const ulong in_channel = at_in.channel;
    const int blocks = (channels + block - 1) / block, b = get_global_id(2) % blocks, image = get_global_id(2) / blocks;
    const int row = (int)get_global_id(1) - 1, present = min(block, channels - b * block);
    const int inside = row >= 0 && row < rows;
    __global const float *from = in + at_in.offset + image * at_in.image + b * block * in_channel + row * at_in.row;
    __global float *to =
        out + at_out.offset + image * at_out.image + ((size_t)b * (rows + 2) + row + 1) * (cols + 2) * block + block;
#if TENSOR_FOURS
    const int x = TENSOR_PIXEL(block) - 1, lane = TENSOR_LANE(block);
    const int here = inside && x >= 0 && x < cols ? present - lane : 0;
    if (x > cols)
        return;
    from += lane * in_channel + x;
    float4 v = (float4)(0.0f);
    v.x = here > 0 ? from[0] : 0.0f;
    v.y = here > 1 ? from[in_channel] : 0.0f;
    v.z = here > 2 ? from[2 * in_channel] : 0.0f;
    v.w = here > 3 ? from[3 * in_channel] : 0.0f;
    *(__global float4 *)(to + x * block + lane) = v;
#else
    for (int x = -1; x < cols + 1; ++x) {
        const int here = inside && x >= 0 && x < cols ? present : 0;
        for (int k = 0; k < here; ++k)
            to[x * block + k] = from[k * in_channel + x];
        for (int k = here; k < block; ++k)
            to[x * block + k] = 0.0f;
    }
#endif
}

__kernel void net_tensor_store(__global const float *in, __global float *out, hada_tensor_layout at_in,
                               hada_planar_layout at_out, int block)
{
    const int channels = at_in.channels, rows = at_in.rows, cols = at_in.cols;
    const ulong out_channel = at_out.channel;
    const int blocks = (channels + block - 1) / block, b = get_global_id(2) % blocks, image = get_global_id(2) / blocks;
    const int row = get_global_id(1);
    const int present = min(block, channels - b * block);
    __global const float *from =
        in + at_in.offset + image * at_in.image + (((size_t)b * (rows + 2) + row + 1) * (cols + 2) + 1) * block;
    __global float *to = out + at_out.offset + image * at_out.image + b * block * out_channel + row * at_out.row;
#if TENSOR_FOURS
    const int x = TENSOR_PIXEL(block), lane = TENSOR_LANE(block), here = present - lane;
    if (x >= cols)
        return;
    const float4 v = *(__global const float4 *)(from + x * block + lane);
    const float lanes[4] = {v.x, v.y, v.z, v.w};
#pragma unroll
    for (int k = 0; k < 4; ++k)
        if (k < here)
            to[(lane + k) * out_channel + x] = lanes[k];
#else
    for (int k = 0; k < present; ++k)
        for (int x = 0; x < cols; ++x)
            to[k * out_channel + x] = from[x * block + k];
#endif
}

/* Zeros into the halo alone. Some work-items share a row in work-groups. */
__kernel void net_tensor_halo(__global float *out, hada_tensor_layout at_out, int block)
{
    const int rows = at_out.rows, cols = at_out.cols;
    const int blocks = (at_out.channels + block - 1) / block, b = get_global_id(2) % blocks,
              image = get_global_id(2) / blocks;
    const int row = get_global_id(1), width = (cols + 2) * block, jump = row > 0 && row <= rows ? width - block : block;
    __global float *to = out + at_out.offset + image * at_out.image + ((size_t)b * (rows + 2) + row) * width;
#if TENSOR_FOURS
    for (int x = TENSOR_PIXEL(block) * jump; row < rows + 2 && x < width; x += TENSOR_ITEMS(block) * jump)
        *(__global float4 *)(to + x + TENSOR_LANE(block)) = (float4)(0.0f);
#else
    for (int x = 0; x < width; x += jump)
        for (int k = 0; k < block; ++k)
            to[x + k] = 0.0f;
#endif
}

/* Where light is: the largest magnitude over all channels in cells of one row by `cell` columns of planar images
 * [channel][row][col], so that dark parts of an image can be left out. */

/* Work-item (cell, row, plane), planes one after the other; out[plane][row][cell], `cells` in a row. */
__kernel void net_content(__global const float *image, __global float *out, ulong offset, int channels, int rows,
                          int cols, int cell, int cells)
{
    const int which = get_global_id(0), row = get_global_id(1);
    const size_t plane = get_global_id(2);
    if (which < cells) {
        const int first = which * cell, last = min(first + cell, cols);
        float8 most = 0.0f;
        for (int c = 0; c < channels; c++) {
            __global const float *p = image + offset + ((plane * channels + c) * rows + row) * cols;
            int x = first;
            for (; x + 8 <= last; x += 8)
                most = max(most, fabs(vload8(0, p + x)));
            for (; x < last; x++)
                most.s0 = max(most.s0, fabs(p[x]));
        }
        const float4 four = max(most.lo, most.hi);
        const float2 two = max(four.lo, four.hi);
        out[(plane * rows + row) * cells + which] = max(two.x, two.y);
    }
}

/* Copies parts of planar images [channel][row][col] to parts of others: tiles and the images they are cut from. */

/* Work-item (run of columns, row and channel). */
__kernel void net_part(__global const float *from, __global float *to, hada_planar_layout at_from,
                       hada_planar_layout at_to, int rows, int cols)
{
    const int first = get_global_id(0) * HADA_PART_COLS, last = min(first + HADA_PART_COLS, cols);
    const ulong row = get_global_id(1) % rows, channel = get_global_id(1) / rows;
    __global const float *a = from + at_from.offset + row * at_from.row + channel * at_from.channel;
    __global float *b = to + at_to.offset + row * at_to.row + channel * at_to.channel;
    int x = first;
    for (; x + 8 <= last; x += 8)
        VECTORS_STORE8(__global, vload8(0, a + x), b + x);
    for (; x < last; x++)
        b[x] = a[x];
}

/* Planes [plane][value] that together explain a frame. Work-items: values. */

__kernel void net_add_planes(__global const float *planes, __global float *sum, ulong offset, ulong values, int count)
{
    const ulong i = get_global_id(0);
    float total = 0.0f;
    if (i >= values)
        return;
    for (int k = 0; k < count; k++)
        total += planes[offset + k * values + i];
    sum[i] = total;
}

/* A plane, and beside it the sum of the others. */
__kernel void net_beside(__global const float *planes, __global const float *sum, __global float *out, ulong offset,
                         ulong out_offset, ulong values)
{
    const ulong i = get_global_id(0);
    if (i >= values)
        return;
    const float own = planes[offset + i];
    out[out_offset + i] = own;
    out[out_offset + values + i] = sum[i] - own;
}

/* The planes of a frame keep their shares of each value, and add up to `whole`. Light that no plane claims is split
 * equally. */
__kernel void net_share(__global float *planes, __global const float *whole, ulong offset, ulong values, int count)
{
    const ulong i = get_global_id(0);
    float total = 0.0f;
    if (i >= values)
        return;
    for (int k = 0; k < count; k++)
        total += planes[offset + k * values + i];
    const float factor = total > 0.0f ? whole[i] / total : 0.0f, even = total > 0.0f ? 0.0f : whole[i] / (float)count;
    for (int k = 0; k < count; k++)
        planes[offset + k * values + i] = planes[offset + k * values + i] * factor + even;
}
