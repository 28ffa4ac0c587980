/* conv_few.cl for kernels of 3 x 3 with padding 1 after a batch norm with given statistics (net_batch_norm_apply),
 * which is applied to each row as it is read: the normalised tensor is never written, and the bits are those of both
 * steps one after the other. The halo is not normalised: it stays zero. Local memory holds the weights and behind them,
 * for each input block, scales, centres and shifts. Dimensions: groups of rows, images. */
#include "inc_conv_few.h"

#ifndef CONV_PIXELS
#define CONV_PIXELS 5
#endif

/* The values of a block of channels, `otherwise` beyond the last of `present`. */
static inline conv_v conv_per_channel(__global const float *values, int present, float otherwise)
{
    float lanes[NET_BLOCK];
    for (int k = 0; k < NET_BLOCK; ++k)
        lanes[k] = k < present ? values[k] : otherwise;
    return CONV_LOAD(lanes);
}

static inline void conv_norm_values(__global const float *values, hada_norm_values at, int channels,
                                    __local float *restrict to)
{
    for (int first = 0; first < channels; first += NET_BLOCK, to += 3 * NET_BLOCK) {
        const int present = channels - first;
        conv_v scale = conv_per_channel(values + at.second + first, present, 1.0f);
        scale = 1.0f / sqrt(scale + at.eps);
        scale *= conv_per_channel(values + at.weight + first, present, 0.0f);
        CONV_STORE_IN(__local, scale, to);
        CONV_STORE_IN(__local, conv_per_channel(values + at.mean + first, present, 0.0f), to + NET_BLOCK);
        CONV_STORE_IN(__local, conv_per_channel(values + at.bias + first, present, 0.0f), to + 2 * NET_BLOCK);
    }
}

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
conv_normed(__global const float *restrict x, __global const float *restrict weights,
            __global const float *restrict bias, __global float *restrict y, __global const float *restrict values,
            __local STATED_SIZE float *restrict w, hada_conv_problem problem, hada_norm_values norm)
{
    const int in_channels = problem.in.channels, in_blocks = problem.in.blocks, out_channels = problem.out.channels;
    const int rows = problem.out.rows, cols = problem.out.cols, rows_each = problem.rows_each;
    const int flags = problem.epilogue.flags, activation = problem.epilogue.activation, image = get_global_id(1);
    const float slope = problem.epilogue.slope, floor = activation == HADA_ACTIVATION_RELU ? 0.0f : -INFINITY;
    const size_t row_floats = (size_t)(cols + 2) * NET_BLOCK, plane = (rows + 2) * row_floats;
    const int row_end = min((int)(get_global_id(0) + 1) * rows_each, rows);
    const conv_v biases =
        flags & HADA_CONV_HAS_BIAS ? conv_bias(bias + problem.epilogue.bias, out_channels) : (conv_v)(0.0f);
    __local float *const normed = w + 9 * in_blocks * CONV_FEW * NET_BLOCK;
    x += problem.in.offset + image * problem.in.image;
    y += problem.out.offset + image * problem.out.image + row_floats + NET_BLOCK;
    conv_few_weights(weights, 9, in_blocks, w);
    conv_norm_values(values, norm, in_channels, normed);
    for (int row = get_global_id(0) * rows_each; row < row_end; ++row)
        for (int col = 0; col < cols; col += CONV_PIXELS) {
            const int start = min(col, cols - CONV_PIXELS);
            conv_v sums[CONV_FEW][CONV_PIXELS];
#pragma unroll
            for (int o = 0; o < CONV_FEW; ++o)
#pragma unroll
                for (int p = 0; p < CONV_PIXELS; ++p)
                    sums[o][p] = (conv_v)(0.0f);
            for (int b = 0; b < in_blocks; ++b) {
                const conv_v scale = CONV_LOAD(normed + 3 * b * NET_BLOCK);
                const conv_v centre = CONV_LOAD(normed + (3 * b + 1) * NET_BLOCK);
                const conv_v shift = CONV_LOAD(normed + (3 * b + 2) * NET_BLOCK);
                for (int r = row > 0 ? 0 : 1; r < (row + 1 < rows ? 3 : 2); ++r) {
                    __global const float *xt = x + b * plane + (row + r) * row_floats + start * NET_BLOCK;
                    __local const float *wt = w + (b * 9 + r * 3) * CONV_FEW * NET_BLOCK;
                    conv_v in[CONV_PIXELS + 2];
#pragma unroll
                    for (int p = 0; p < CONV_PIXELS + 2; ++p)
                        in[p] = fma(CONV_LOAD(xt + p * NET_BLOCK) - centre, scale, shift);
                    if (start == 0)
                        in[0] = (conv_v)(0.0f);
                    if (start + CONV_PIXELS == cols)
                        in[CONV_PIXELS + 1] = (conv_v)(0.0f);
#pragma unroll
                    for (int c = 0; c < 3; ++c)
#pragma unroll
                        for (int o = 0; o < CONV_FEW; ++o) {
                            const conv_v wi = CONV_LOAD(wt + (c * CONV_FEW + o) * NET_BLOCK);
#pragma unroll
                            for (int p = 0; p < CONV_PIXELS; ++p)
                                sums[o][p] = fma(in[p + c], wi, sums[o][p]);
                        }
                }
            }
#pragma unroll
            for (int p = 0; p < CONV_PIXELS; ++p) {
                __global float *to = y + row * row_floats + (start + p) * NET_BLOCK;
                conv_v few[CONV_FEW];
#pragma unroll
                for (int o = 0; o < CONV_FEW; ++o)
                    few[o] = sums[o][p];
                if (start + p >= col) /* the tile before has done the others */
                    conv_put(conv_few_finish(biases, few), flags, activation, floor, slope, out_channels, to, to);
            }
        }
}
