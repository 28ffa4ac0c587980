/* 3 x 3 convolutions, stride 1, padding 1, by Winograd's F(m x m, 3 x 3), all in one launch: a work-item takes `tiles`
 * neighbouring tiles (a multiple of CONV_PIXELS) through all three steps, in local memory: places of the transformed
 * tiles, behind them of the products. Shape lanes. Weights: [place] [block group][input channel][output channel], as
 * conv_pack.cl writes them. The last tiles of a row and the last rows overlap those before; so do the last tiles of an
 * image. Dimensions: groups of tiles, images. */
#define CONV_MEM __local
#include "inc_conv_doubled.h"
#include "inc_conv_winograd_products.h"
#include "shared_local.h"

/* Prefetches the inputs of the tiles begin, begin + CONV_PLACES, ... before `end`, is_half 1: those that are doubled. A
 * processor by itself fetches ahead only within a row, of which a tile takes few pixels. The first two columns of a
 * tile are the last two of the tile before. */
static inline void conv_fetch_tiles(__global const float *x, int begin, int end, int blocks, int rows, int cols,
                                    int is_half)
{
    const conv_grid grid = conv_grid_of(rows, cols);
    const size_t row = is_half ? grid.half_row : grid.row, plane = is_half ? grid.half_plane : grid.plane;
    const int reach = is_half ? 4 : CONV_REACH;
    for (int tile = begin; tile < end; tile += CONV_PLACES) {
        const conv_place place = conv_place_of(tile, rows, cols);
        __global const float *at = x + (place.row >> is_half) * row + (place.col >> is_half) * NET_BLOCK;
        for (int b = 0; b < blocks; ++b, at += plane)
            for (int r = 0; r < reach; ++r)
                for (int c = 2; c < reach; ++c)
                    CONV_FETCH(at + r * row + c * NET_BLOCK);
    }
}

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
conv_winograd(__global const float *restrict x, __global const float *restrict low,
              __global const float *restrict weights, __global const float *restrict bias, __global float *restrict y,
              __global const float *restrict mask, __global float *restrict pooled,
              __local STATED_SIZE float *restrict places, hada_conv_problem problem)
{
    const int x_blocks = problem.in.blocks, low_blocks = problem.low.blocks, in_blocks = x_blocks + low_blocks,
              out_channels = problem.out.channels;
    const int rows = problem.out.rows, cols = problem.out.cols, tiles = problem.tiles;
    const int flags = problem.epilogue.flags, activation = problem.epilogue.activation;
    const float slope = problem.epilogue.slope;
    const int image = get_global_id(1), begin = get_global_id(0) * tiles;
    const conv_grid grid = conv_grid_of(rows, cols);
    const int first = min(begin, grid.tiles - tiles), out_blocks = (out_channels + NET_BLOCK - 1) / NET_BLOCK;
    const size_t block_floats = (size_t)tiles * NET_BLOCK, v_place = CONV_APART(in_blocks * block_floats);
    const size_t m_place = CONV_APART(CONV_BLOCKS * block_floats);
    const size_t group_floats = (size_t)in_blocks * NET_BLOCK * NET_BLOCK * CONV_BLOCKS;
    __local float *restrict const v = places, *restrict const m = places + CONV_PLACES * v_place;
    x += problem.in.offset + image * problem.in.image;
    low += problem.low.offset + image * problem.low.image;
    y += problem.out.offset + image * problem.out.image + grid.row + NET_BLOCK;
    mask += problem.epilogue.mask + image * problem.epilogue.mask_image + grid.row + NET_BLOCK;
    pooled += problem.epilogue.pooled + image * problem.epilogue.pooled_image + grid.half_row + NET_BLOCK;

    for (int t = 0; t < tiles; ++t) {
        const conv_place place = conv_place_of(first + t, rows, cols);
        for (int b = 0; b < x_blocks; ++b)
            conv_tile_in(x + b * grid.plane + place.row * grid.row + place.col * NET_BLOCK, grid.row,
                         v + b * block_floats + t * NET_BLOCK, v_place);
    }
    /* tiles inside: values that do not depend on the block do not fit in registers */
    for (int b = 0; b < low_blocks; ++b)
        for (int t = 0; t < tiles; ++t)
            conv_tile_in_doubled(low + b * grid.half_plane, conv_place_of(first + t, rows, cols), rows, cols,
                                 v + (x_blocks + b) * block_floats + t * NET_BLOCK, v_place);
    for (int group = 0; group < out_blocks / CONV_BLOCKS; ++group) {
        for (int f = 0; f < CONV_PLACES; ++f) {
            if (group == 0) { /* those of the next work-item, most likely on the same processor */
                conv_fetch_tiles(x, first + tiles + f, min(first + 2 * tiles, grid.tiles), x_blocks, rows, cols, 0);
                conv_fetch_tiles(low, first + tiles + f, min(first + 2 * tiles, grid.tiles), low_blocks, rows, cols, 1);
            }
            for (int t = 0; t < tiles; t += CONV_PIXELS)
                conv_tile_products(v + f * v_place + t * NET_BLOCK, block_floats,
                                   weights + ((size_t)f * (out_blocks / CONV_BLOCKS) + group) * group_floats, in_blocks,
                                   m + f * m_place + t * NET_BLOCK, block_floats);
        }
        for (int o = 0; o < CONV_BLOCKS; ++o) {
            const int block = group * CONV_BLOCKS + o, present = out_channels - block * NET_BLOCK;
            const conv_v b = conv_bias(bias + problem.epilogue.bias + block * NET_BLOCK, flags, present);
            for (int t = begin - first; t < tiles; ++t) {
                const conv_place place = conv_place_of(first + t, rows, cols);
                const size_t at = block * grid.plane + place.row * grid.row + place.col * NET_BLOCK;
                conv_v out[CONV_TILE][CONV_TILE];
                conv_tile_out(m + o * block_floats + t * NET_BLOCK, m_place, b, out);
                conv_tile_put(out, place, flags, activation, slope, present, mask + at, y + at, grid.row,
                              pooled + block * grid.half_plane + place.row / 2 * grid.half_row +
                                  place.col / 2 * NET_BLOCK,
                              grid.half_row);
            }
        }
    }
}
