/* Convolution, transposed or not, by sums in registers: a work-item takes rows of CONV_BLOCKS blocks of output
 * channels, CONV_PIXELS pixels at a time; each input value is multiplied with a vector of weights. Shape lanes:
 * work-groups of one, no local memory.
 *
 * Output pixel (step r + phase) takes inputs CONV_STEP r + first + t (shared_conv.h: hada_conv_taps); a convolution has
 * step 1 and CONV_STEP its stride, a transposed one has step its stride and CONV_STEP 1. Reads stay within the halo of
 * one, which the host checks.
 * x, y, mask: tensors in blocks of channels with a halo of one pixel (lib/net/tensor.h). weights: [phase][block
 * group][input block][tap row][tap column][input channel][output channel], as conv_pack.cl writes them. Dimensions:
 * block groups, groups of rows, images. */
#include "inc_conv.h"

#ifndef CONV_BLOCKS
#define CONV_BLOCKS 2
#endif
#ifndef CONV_PIXELS
#define CONV_PIXELS 6
#endif
#ifndef CONV_STEP
#define CONV_STEP 1
#endif

/* The products of one tap and one block of input channels. */
static inline void conv_add(__global const float *x, __global const float *w, int present,
                            conv_v sums[CONV_BLOCKS][CONV_PIXELS])
{
#pragma nounroll
    for (int i = 0; i < present; ++i) {
        conv_v wi[CONV_BLOCKS];
#pragma unroll
        for (int o = 0; o < CONV_BLOCKS; ++o)
            wi[o] = CONV_LOAD(w + (i * CONV_BLOCKS + o) * NET_BLOCK);
#pragma unroll
        for (int p = 0; p < CONV_PIXELS; ++p) {
            const conv_v xi = (conv_v)(x[p * CONV_STEP * NET_BLOCK + i]);
#pragma unroll
            for (int o = 0; o < CONV_BLOCKS; ++o)
                sums[o][p] = fma(xi, wi[o], sums[o][p]);
        }
    }
}

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
conv_direct(__global const float *restrict x, __global const float *restrict weights,
            __global const float *restrict bias, __global float *restrict y, __global const float *restrict mask,
            hada_conv_problem problem)
{
    const int in_channels = problem.in.channels, in_rows = problem.in.rows, in_cols = problem.in.cols;
    const int out_channels = problem.out.channels, out_rows = problem.out.rows, out_cols = problem.out.cols;
    const int kernel_rows = problem.kernel_rows, kernel_cols = problem.kernel_cols;
    const int pad_rows = problem.pad_rows, pad_cols = problem.pad_cols, step = problem.step;
    const int rows_each = problem.rows_each, flat = problem.flat, flags = problem.epilogue.flags,
              activation = problem.epilogue.activation;
    const float slope = problem.epilogue.slope;
    const int group = get_global_id(0), image = get_global_id(2);
    const int in_blocks = (in_channels + NET_BLOCK - 1) / NET_BLOCK;
    const int out_blocks = (out_channels + NET_BLOCK - 1) / NET_BLOCK, first_block = group * CONV_BLOCKS;
    const int x_row = (in_cols + 2) * NET_BLOCK, y_row = (out_cols + 2) * NET_BLOCK;
    const size_t x_plane = (size_t)(in_rows + 2) * x_row, y_plane = (size_t)(out_rows + 2) * y_row;
    const size_t taps_most = (size_t)((kernel_rows + step - 1) / step) * ((kernel_cols + step - 1) / step);
    const size_t group_floats = taps_most * in_blocks * NET_BLOCK * NET_BLOCK * CONV_BLOCKS;
    /* flat: the image is one row; the pixels at the far end of each `pitch` belong to the halo */
    const int pitch = out_cols + 2, long_row = out_rows * pitch - 2, flat_each = rows_each * CONV_PIXELS;
    const int row_first = flat ? 0 : (int)get_global_id(1) * rows_each;
    const int row_end = flat ? 1 : min((int)(get_global_id(1) + 1) * rows_each, out_rows);
    const size_t to = first_block * y_plane + y_row + NET_BLOCK;
    x += problem.in.offset + image * problem.in.image;
    y += problem.out.offset + image * problem.out.image + to;
    mask += problem.epilogue.mask + image * problem.epilogue.mask_image + to;

    conv_v biases[CONV_BLOCKS];
    for (int o = 0; o < CONV_BLOCKS; ++o)
        biases[o] = conv_bias(bias + problem.epilogue.bias + (first_block + o) * NET_BLOCK, flags,
                              out_channels - (first_block + o) * NET_BLOCK);
    for (int row = row_first; row < row_end; ++row)
        for (int phase = 0; phase < step; ++phase) {
            const hada_conv_taps rows = hada_conv_taps_of(kernel_rows, pad_rows, step, row % step);
            const hada_conv_taps cols = hada_conv_taps_of(kernel_cols, pad_cols, step, phase);
            const int col_first = flat ? (int)get_global_id(1) * flat_each : 0;
            const int width = flat ? min(col_first + flat_each, long_row) : (out_cols - phase + step - 1) / step;
            __global const float *restrict w =
                weights + ((row % step * step + phase) * (size_t)(out_blocks / CONV_BLOCKS) + group) * group_floats;
            __global const float *restrict x_first =
                x + (row / step * CONV_STEP + rows.first + 1) * x_row + (cols.first + 1) * NET_BLOCK;
            for (int col = col_first; col < width; col += CONV_PIXELS) {
                const int start = min(col, width - CONV_PIXELS);
                conv_v sums[CONV_BLOCKS][CONV_PIXELS];
#pragma unroll
                for (int o = 0; o < CONV_BLOCKS; ++o)
#pragma unroll
                    for (int p = 0; p < CONV_PIXELS; ++p)
                        sums[o][p] = biases[o];
                __global const float *restrict wp = w;
                for (int b = 0; b < in_blocks; ++b) {
                    const int present = min(NET_BLOCK, in_channels - b * NET_BLOCK);
                    for (int r = 0; r < rows.count; ++r)
                        for (int c = 0; c < cols.count; ++c, wp += NET_BLOCK * NET_BLOCK * CONV_BLOCKS)
                            conv_add(x_first + b * x_plane + r * x_row + (start * CONV_STEP + c) * NET_BLOCK, wp,
                                     present, sums);
                }
#pragma unroll
                for (int o = 0; o < CONV_BLOCKS; ++o) {
                    const size_t at = o * y_plane + (size_t)row * y_row + (start * step + phase) * NET_BLOCK;
                    const int present = out_channels - (first_block + o) * NET_BLOCK;
#pragma unroll
                    for (int p = 0; p < CONV_PIXELS; ++p) {
                        const size_t to_pixel = at + p * step * NET_BLOCK;
                        if (start + p < col) /* the tile before has done them, perhaps adding to y */
                            continue;
                        if (flat && (start + p) % pitch >= out_cols)
                            continue;
                        conv_put(sums[o][p], flags, activation, slope, present, mask + to_pixel, y + to_pixel);
                    }
                }
            }
        }
}
