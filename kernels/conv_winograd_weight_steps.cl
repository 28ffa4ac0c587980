/* As conv_winograd_weights.cl, for many channels. Scratch holds the inputs of `tiles` tiles from conv_winograd_in
 * (conv_winograd_steps.cl) as v[place][fine block][tile][channel], `room` tiles apart; behind them, at d_offset, A dy
 * A^T; their products are added to the transformed gradient du[coarse block][fine][place][coarse], at du_offset. Shape
 * lanes. */
#define CONV_MEM __global
#include "inc_conv_winograd_gradient.h"

/* Dimension: tiles. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void conv_winograd_back(__global const float *restrict dy,
                                                                                __global float *restrict scratch,
                                                                                hada_tensor_layout at_dy,
                                                                                ulong d_offset, int begin, int room)
{
    const int coarse_blocks = at_dy.blocks, rows = at_dy.rows, cols = at_dy.cols;
    const conv_grid grid = conv_grid_of(rows, cols);
    const int tile = get_global_id(0), image = (begin + tile) / grid.tiles;
    const conv_place place = conv_place_of((begin + tile) % grid.tiles, rows, cols);
    const size_t block_floats = (size_t)room * NET_BLOCK;
    dy += at_dy.offset + image * at_dy.image + (place.row + 1) * grid.row + (place.col + 1) * NET_BLOCK;
    for (int b = 0; b < coarse_blocks; ++b)
        conv_tile_back(dy + b * grid.plane, grid.row, place, scratch + d_offset + b * block_floats + tile * NET_BLOCK,
                       CONV_APART(coarse_blocks * block_floats));
}

/* Dimensions: fine channels over CONV_FINE, groups of coarse blocks, places. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
conv_winograd_correlate(__global float *scratch, ulong d_offset, ulong du_offset, int tiles, int room, int adds)
{
    const int fine = get_global_id(0) * CONV_FINE, group = get_global_id(1), f = get_global_id(2);
    const size_t block_floats = (size_t)room * NET_BLOCK, fine_channels = get_global_size(0) * CONV_FINE;
    const size_t width = get_global_size(1) * CONV_BLOCKS * NET_BLOCK;
    __global const float *restrict d =
        scratch + d_offset + f * CONV_APART(width * room) + group * CONV_BLOCKS * block_floats;
    __global const float *restrict v =
        scratch + f * CONV_APART(fine_channels * room) + fine / NET_BLOCK * block_floats + fine % NET_BLOCK;
    conv_tile_correlate(d, block_floats, v, tiles, adds,
                        scratch + du_offset +
                            ((group * CONV_BLOCKS * fine_channels + fine) * CONV_PLACES + f) * NET_BLOCK,
                        fine_channels);
}
