/* Gradients of the weights of 3 x 3 convolutions, stride 1, padding 1, by Winograd's F(4 x 4, 3 x 3): the gradient of a
 * transformed weight is the sum over tiles of the transformed input times A dy A^T. The tiles of all images are shared
 * out to `parts` partial sums, each in groups of `tiles` tiles in local memory: partial[part][coarse
 * block][fine][place][coarse], and the sums of dy for the biases after all of them as [part][coarse]. "Coarse" and
 * "fine" as in conv_weights.cl. Shape lanes. Dimension: parts. */
#define CONV_MEM __local
#include "inc_conv_winograd_gradient.h"
#include "shared_local.h"

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
conv_winograd_weights(__global const float *restrict coarse, __global const float *restrict fine,
                      __global float *restrict partial, __local STATED_SIZE float *restrict v,
                      __local STATED_SIZE float *restrict d, hada_conv_correlation sizes)
{
    const int rows = sizes.coarse.rows, cols = sizes.coarse.cols, images = sizes.images, tiles = sizes.tiles;
    const int coarse_blocks = sizes.coarse.blocks, fine_blocks = sizes.fine.blocks;
    const ulong coarse_image = sizes.coarse.image, fine_image = sizes.fine.image;
    const int part = get_global_id(0), parts = get_global_size(0);
    const conv_grid grid = conv_grid_of(rows, cols);
    const int end = (long)(part + 1) * images * grid.tiles / parts;
    const size_t block_floats = (size_t)tiles * NET_BLOCK, v_place = CONV_APART(fine_blocks * block_floats);
    const size_t d_place = CONV_APART(coarse_blocks * block_floats), width = (size_t)coarse_blocks * NET_BLOCK;
    const int fine_channels = fine_blocks * NET_BLOCK;
    __global float *restrict sums_of_dy = partial + parts * CONV_PLACES * fine_channels * width + part * width;
    coarse += sizes.coarse.offset + grid.row + NET_BLOCK;
    fine += sizes.fine.offset;
    partial += part * CONV_PLACES * fine_channels * width;

    int started = 0;
    for (int first = (long)part * images * grid.tiles / parts; first < end; first += tiles, started = 1) {
        const int count = min(tiles, end - first);
        for (int t = 0; t < count; ++t) {
            const int image = (first + t) / grid.tiles;
            const conv_place place = conv_place_of((first + t) % grid.tiles, rows, cols);
            const size_t at = place.row * grid.row + place.col * NET_BLOCK;
            for (int b = 0; b < fine_blocks; ++b)
                conv_tile_in(fine + image * fine_image + b * grid.plane + at, grid.row,
                             v + b * block_floats + t * NET_BLOCK, v_place);
            for (int b = 0; b < coarse_blocks; ++b)
                conv_tile_back(coarse + image * coarse_image + b * grid.plane + at, grid.row, place,
                               d + b * block_floats + t * NET_BLOCK, d_place);
        }
        /* the place (1, 1) of A dy A^T is the sum of a tile */
        for (int b = 0; b < coarse_blocks; ++b) {
            __local const float *restrict sums = d + (CONV_REACH + 1) * d_place + b * block_floats;
            conv_v sum = (conv_v)(0.0f);
            for (int t = 0; t < count; ++t)
                sum += CONV_LOAD(sums + t * NET_BLOCK);
            __global float *restrict to = sums_of_dy + b * NET_BLOCK;
            CONV_STORE(started ? CONV_LOAD(to) + sum : sum, to);
        }
        for (int f = 0; f < CONV_PLACES; ++f)
            for (int o = 0; o < coarse_blocks; o += CONV_BLOCKS)
                for (int i = 0; i < fine_channels; i += CONV_FINE)
                    conv_tile_correlate(d + f * d_place + o * block_floats, block_floats,
                                        v + f * v_place + i / NET_BLOCK * block_floats + i % NET_BLOCK, count, started,
                                        partial + (((size_t)o * fine_channels + i) * CONV_PLACES + f) * NET_BLOCK,
                                        fine_channels);
    }
}
