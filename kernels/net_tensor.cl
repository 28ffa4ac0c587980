/* Images in and out of blocks of channels, and what is done to them as they are. */

#include "shared_net.h"

/* Activations in blocks of channels (lib/net/tensor.h): from and to planar floats, and the halo by itself. One
 * work-item takes `step` pixels of a row of one block: a whole row on CPUs, one pixel on GPUs. Dimensions: pixels over
 * step, rows, blocks times images. */

/* Rows and columns with the halo; channels beyond the last one and the halo become zero. */
__kernel void net_tensor_load(__global const float *in, __global float *out, hada_planar_layout at_in,
                              hada_tensor_layout at_out, int block, int step)
{
    const int channels = at_out.channels, rows = at_out.rows, cols = at_out.cols;
    const ulong in_channel = at_in.channel;
    const int blocks = (channels + block - 1) / block, b = get_global_id(2) % blocks, image = get_global_id(2) / blocks;
    const int row = (int)get_global_id(1) - 1, first = (int)get_global_id(0) * step - 1;
    const int last = min(first + step, cols + 1), present = min(block, channels - b * block);
    const int inside = row >= 0 && row < rows;
    __global const float *from = in + at_in.offset + image * at_in.image + b * block * in_channel + row * at_in.row;
    __global float *to =
        out + at_out.offset + image * at_out.image + ((size_t)b * (rows + 2) + row + 1) * (cols + 2) * block + block;
    for (int x = first; x < last; ++x) {
        const int here = inside && x >= 0 && x < cols ? present : 0;
        for (int k = 0; k < here; ++k)
            to[x * block + k] = from[k * in_channel + x];
        for (int k = here; k < block; ++k)
            to[x * block + k] = 0.0f;
    }
}

__kernel void net_tensor_store(__global const float *in, __global float *out, hada_tensor_layout at_in,
                               hada_planar_layout at_out, int block, int step)
{
    const int channels = at_in.channels, rows = at_in.rows, cols = at_in.cols;
    const ulong out_channel = at_out.channel;
    const int blocks = (channels + block - 1) / block, b = get_global_id(2) % blocks, image = get_global_id(2) / blocks;
    const int row = get_global_id(1), first = get_global_id(0) * step, last = min(first + step, cols);
    const int present = min(block, channels - b * block);
    __global const float *from =
        in + at_in.offset + image * at_in.image + (((size_t)b * (rows + 2) + row + 1) * (cols + 2) + 1) * block;
    __global float *to = out + at_out.offset + image * at_out.image + b * block * out_channel + row * at_out.row;
    for (int k = 0; k < present; ++k)
        for (int x = first; x < last; ++x)
            to[k * out_channel + x] = from[x * block + k];
}

/* Zeros into the halo alone; step does not matter: dimension 0 is one. */
__kernel void net_tensor_halo(__global float *out, hada_tensor_layout at_out, int block)
{
    const int rows = at_out.rows, cols = at_out.cols;
    const int blocks = (at_out.channels + block - 1) / block, b = get_global_id(2) % blocks,
              image = get_global_id(2) / blocks;
    const int row = get_global_id(1), width = (cols + 2) * block, jump = row > 0 && row <= rows ? width - block : block;
    __global float *to = out + at_out.offset + image * at_out.image + ((size_t)b * (rows + 2) + row) * width;
    for (int x = 0; x < width; x += jump)
        for (int k = 0; k < block; ++k)
            to[x + k] = 0.0f;
}

/* How much light stands where: the largest magnitude over all channels in cells of one row by `cell` columns of planar
 * images [channel][row][col], so that parts of an image without any can be left out. */

/* Work-item (cell, row); out[row][cell], `cells` in a row. */
__kernel void net_content(__global const float *image, __global float *out, ulong offset, int channels, int rows,
                          int cols, int cell, int cells)
{
    const int which = get_global_id(0), row = get_global_id(1);
    if (which < cells) {
        const int first = which * cell, last = min(first + cell, cols);
        float8 most = 0.0f;
        for (int c = 0; c < channels; c++) {
            __global const float *p = image + offset + ((size_t)c * rows + row) * cols;
            int x = first;
            for (; x + 8 <= last; x += 8)
                most = max(most, fabs(vload8(0, p + x)));
            for (; x < last; x++)
                most.s0 = max(most.s0, fabs(p[x]));
        }
        const float4 four = max(most.lo, most.hi);
        const float2 two = max(four.lo, four.hi);
        out[(size_t)row * cells + which] = max(two.x, two.y);
    }
}

/* Parts of planar images [channel][row][col] to parts of others: tiles and what they are cut from. */

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
        vstore8(vload8(0, a + x), 0, b + x);
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

/* A plane, and beside it what the others hold. */
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

/* The planes of a frame keep their shares of each value, and add up to `whole`. What no plane holds stays 0. */
__kernel void net_share(__global float *planes, __global const float *whole, ulong offset, ulong values, int count)
{
    const ulong i = get_global_id(0);
    float total = 0.0f;
    if (i >= values)
        return;
    for (int k = 0; k < count; k++)
        total += planes[offset + k * values + i];
    const float factor = total > 0.0f ? whole[i] / total : 0.0f;
    for (int k = 0; k < count; k++)
        planes[offset + k * values + i] *= factor;
}
