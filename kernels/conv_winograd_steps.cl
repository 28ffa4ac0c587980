/* As conv_winograd.cl, in three launches, for many channels: each weight is then read once for all tiles. Scratch holds
 * `tiles` tiles of all images from tile `begin` on as v[place][input block][tile][channel], and their products, at
 * m_offset, as m[place][output block][tile][channel]; both have room for `room` tiles. Shape lanes. */
#define CONV_MEM __global
#include "inc_conv_doubled.h"
#include "inc_conv_winograd_products.h"

/* Dimension: tiles. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
conv_winograd_in(__global const float *restrict x, __global const float *restrict low, __global float *restrict v,
                 hada_tensor_layout at_x, hada_tensor_layout at_low, int begin, int room)
{
    const int in_blocks = at_x.blocks + at_low.blocks, rows = at_x.rows, cols = at_x.cols;
    const conv_grid grid = conv_grid_of(rows, cols);
    const int tile = get_global_id(0), image = (begin + tile) / grid.tiles;
    const conv_place place = conv_place_of((begin + tile) % grid.tiles, rows, cols);
    const size_t block_floats = (size_t)room * NET_BLOCK;
    x += at_x.offset + image * at_x.image + place.row * grid.row + place.col * NET_BLOCK;
    low += at_low.offset + image * at_low.image;
    v += tile * NET_BLOCK;
    for (int b = 0; b < at_x.blocks; ++b, v += block_floats)
        conv_tile_in(x + b * grid.plane, grid.row, v, CONV_APART(in_blocks * block_floats));
    for (int b = 0; b < at_low.blocks; ++b, v += block_floats)
        conv_tile_in_doubled(low + b * grid.half_plane, place, rows, cols, v, CONV_APART(in_blocks * block_floats));
}

/* Tiles in steps of CONV_PIXELS, the last ones at most `room`. Dimensions: groups of output blocks, places. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
conv_winograd_products(__global float *scratch, __global const float *restrict weights, ulong m_offset, int in_blocks,
                       int tiles, int room)
{
    const int group = get_global_id(0), groups = get_global_size(0), f = get_global_id(1);
    const size_t block_floats = (size_t)room * NET_BLOCK;
    const size_t group_floats = (size_t)in_blocks * NET_BLOCK * NET_BLOCK * CONV_BLOCKS;
    __global const float *restrict v = scratch + f * CONV_APART(in_blocks * block_floats);
    __global float *restrict m =
        scratch + m_offset + f * CONV_APART(groups * CONV_BLOCKS * block_floats) + group * CONV_BLOCKS * block_floats;
    weights += ((size_t)f * groups + group) * group_floats;
    for (int t = 0; t < tiles; t += CONV_PIXELS)
        conv_tile_products(v + t * NET_BLOCK, block_floats, weights, in_blocks, m + t * NET_BLOCK, block_floats);
}

/* Dimension: tiles. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
conv_winograd_out(__global const float *restrict m, __global const float *restrict bias, __global float *restrict y,
                  __global const float *restrict mask, __global float *restrict pooled, hada_conv_problem problem,
                  ulong m_offset, int begin, int room)
{
    const int out_channels = problem.out.channels, rows = problem.out.rows, cols = problem.out.cols;
    const int flags = problem.epilogue.flags, activation = problem.epilogue.activation;
    const float slope = problem.epilogue.slope;
    const conv_grid grid = conv_grid_of(rows, cols);
    const int tile = get_global_id(0), image = (begin + tile) / grid.tiles;
    const int out_blocks = (out_channels + NET_BLOCK - 1) / NET_BLOCK;
    const conv_place place = conv_place_of((begin + tile) % grid.tiles, rows, cols);
    const size_t at = (place.row + 1) * grid.row + (place.col + 1) * NET_BLOCK, block_floats = (size_t)room * NET_BLOCK;
    m += m_offset;
    y += problem.out.offset + image * problem.out.image + at;
    mask += problem.epilogue.mask + image * problem.epilogue.mask_image + at;
    pooled += problem.epilogue.pooled + image * problem.epilogue.pooled_image + (place.row / 2 + 1) * grid.half_row +
              (place.col / 2 + 1) * NET_BLOCK;
    for (int b = 0; b < out_blocks; ++b) {
        const int present = out_channels - b * NET_BLOCK;
        conv_v out[CONV_TILE][CONV_TILE];
        conv_tile_out(m + b * block_floats + tile * NET_BLOCK, CONV_APART(out_blocks * block_floats),
                      conv_bias(bias + problem.epilogue.bias + b * NET_BLOCK, flags, present), out);
        conv_tile_put(out, place, flags, activation, slope, present, mask + b * grid.plane, y + b * grid.plane,
                      grid.row, pooled + b * grid.half_plane, grid.half_row);
    }
}
