/* 3 x 3 convolutions, stride 1, padding 1, by Winograd's F(m x m, 3 x 3), all in one launch: a work-item takes `tiles`
 * neighbouring tiles (a multiple of CONV_PIXELS) through all three steps, in local memory: places of the transformed
 * tiles, behind them of the products. Shape lanes. Weights: [place] [block group][input channel][output channel], as
 * conv_pack.cl writes them. The last tiles of a row and the last rows overlap those before; so do the last tiles of an
 * image. Dimensions: groups of tiles, images. */
#define CONV_MEM __local
#include "inc_conv_doubled.h"
#include "inc_conv_winograd_products.h"
#include "shared_local.h"

/* Prefetches the inputs of the tiles begin, begin + CONV_PLACES, ... before `end`: a processor by itself fetches ahead
 * only within a row, of which a tile takes few pixels. Their first two columns are the last two of the tile before. */
static inline void conv_fetch_tiles(__global const float *x, int begin, int end, int in_blocks, int rows, int cols)
{
    const size_t row_floats = (size_t)(cols + 2) * NET_BLOCK, plane = (rows + 2) * row_floats;
    for (int tile = begin; tile < end; tile += CONV_PLACES) {
        const conv_place place = conv_place_of(tile, rows, cols);
        __global const float *at = x + place.row * row_floats + place.col * NET_BLOCK;
        for (int b = 0; b < in_blocks; ++b, at += plane)
            for (int r = 0; r < CONV_REACH; ++r)
                for (int c = CONV_REACH - CONV_TILE; c < CONV_REACH; ++c)
                    CONV_FETCH(at + r * row_floats + c * NET_BLOCK);
    }
}

/* The same for channels that are doubled: again two of their four columns belong to the tile before. */
static inline void conv_fetch_doubled(__global const float *low, int begin, int end, int low_blocks, int rows, int cols)
{
    const size_t row_floats = (size_t)(cols / 2 + 2) * NET_BLOCK, plane = (rows / 2 + 2) * row_floats;
    for (int tile = begin; tile < end; tile += CONV_PLACES) {
        const conv_place place = conv_place_of(tile, rows, cols);
        __global const float *at = low + place.row / 2 * row_floats + (place.col / 2 + 2) * NET_BLOCK;
        for (int b = 0; b < low_blocks; ++b, at += plane)
            for (int r = 0; r < 4; ++r)
                for (int c = 0; c < 2; ++c)
                    CONV_FETCH(at + r * row_floats + c * NET_BLOCK);
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
    const int all = (cols + CONV_TILE - 1) / CONV_TILE * ((rows + CONV_TILE - 1) / CONV_TILE);
    const int first = min(begin, all - tiles), out_blocks = (out_channels + NET_BLOCK - 1) / NET_BLOCK;
    const size_t row_floats = (size_t)(cols + 2) * NET_BLOCK, plane = (rows + 2) * row_floats;
    const size_t pooled_row = (size_t)(cols / 2 + 2) * NET_BLOCK, pooled_plane = (rows / 2 + 2) * pooled_row;
    const size_t block_floats = (size_t)tiles * NET_BLOCK, v_place = CONV_APART(in_blocks * block_floats);
    const size_t m_place = CONV_APART(CONV_BLOCKS * block_floats);
    const size_t group_floats = (size_t)in_blocks * NET_BLOCK * NET_BLOCK * CONV_BLOCKS;
    const size_t low_plane = (size_t)(rows / 2 + 2) * (cols / 2 + 2) * NET_BLOCK;
    __local float *restrict const v = places, *restrict const m = places + CONV_PLACES * v_place;
    x += problem.in.offset + image * problem.in.image;
    low += problem.low.offset + image * problem.low.image;
    y += problem.out.offset + image * problem.out.image + row_floats + NET_BLOCK;
    mask += problem.epilogue.mask + image * problem.epilogue.mask_image + row_floats + NET_BLOCK;
    pooled += problem.epilogue.pooled + image * problem.epilogue.pooled_image + pooled_row + NET_BLOCK;

    for (int t = 0; t < tiles; ++t) {
        const conv_place place = conv_place_of(first + t, rows, cols);
        for (int b = 0; b < x_blocks; ++b)
            conv_tile_in(x + b * plane + place.row * row_floats + place.col * NET_BLOCK, row_floats,
                         v + b * block_floats + t * NET_BLOCK, v_place);
    }
    /* tiles inside: values that do not depend on the block do not fit in registers */
    for (int b = 0; b < low_blocks; ++b)
        for (int t = 0; t < tiles; ++t)
            conv_tile_in_doubled(low + b * low_plane, conv_place_of(first + t, rows, cols), rows, cols,
                                 v + (x_blocks + b) * block_floats + t * NET_BLOCK, v_place);
    for (int group = 0; group < out_blocks / CONV_BLOCKS; ++group) {
        for (int f = 0; f < CONV_PLACES; ++f) {
            if (group == 0) { /* those of the next work-item, most likely on the same processor */
                conv_fetch_tiles(x, first + tiles + f, min(first + 2 * tiles, all), x_blocks, rows, cols);
                conv_fetch_doubled(low, first + tiles + f, min(first + 2 * tiles, all), low_blocks, rows, cols);
            }
            for (int t = 0; t < tiles; t += CONV_PIXELS)
                conv_tile_products(v + f * v_place + t * NET_BLOCK, block_floats,
                                   weights + ((size_t)f * (out_blocks / CONV_BLOCKS) + group) * group_floats, in_blocks,
                                   m + f * m_place + t * NET_BLOCK, block_floats);
        }
        for (int o = 0; o < CONV_BLOCKS; ++o) {
            const int block = group * CONV_BLOCKS + o, present = out_channels - block * NET_BLOCK;
            const conv_v b = flags & HADA_CONV_HAS_BIAS
                                 ? conv_bias(bias + problem.epilogue.bias + block * NET_BLOCK, present)
                                 : (conv_v)(0.0f);
            for (int t = begin - first; t < tiles; ++t) {
                const conv_place place = conv_place_of(first + t, rows, cols);
                const size_t at = block * plane + place.row * row_floats + place.col * NET_BLOCK;
                conv_v out[CONV_TILE][CONV_TILE];
                conv_tile_out(m + o * block_floats + t * NET_BLOCK, m_place, b, out);
                conv_tile_put(out, place, flags, activation, slope, present, mask + at, y + at, row_floats,
                              pooled + block * pooled_plane + place.row / 2 * pooled_row + place.col / 2 * NET_BLOCK,
                              pooled_row);
            }
        }
    }
}
