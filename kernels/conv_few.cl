/* Convolutions with stride 1 to few output channels (at most CONV_FEW), such as the last layer of a net or the gradient
 * of an image: conv_direct.cl would compute a block of outputs of which most do not exist. Here the lanes of a sum are
 * input channels, added up at the end. Shape lanes: work-groups of one.
 *
 * Weights: as for conv_direct.cl, in one block of outputs; a work-item copies them to local memory as w[input
 * block][tap][output channel][input channel] for its rows. Reads stay within the halo of one, which the host checks.
 * Dimensions: groups of rows, images. */
#include "inc_conv.h"
#include "shared_local.h"

#ifndef CONV_FEW
#define CONV_FEW 1
#endif
#ifndef CONV_PIXELS
#define CONV_PIXELS 8
#endif

/* The sum of the lanes of v, by halves. */
static inline float conv_lanes_sum(conv_v v)
{
#if NET_BLOCK == 16
    const float8 eight = v.lo + v.hi;
#else
    const float8 eight = v;
#endif
    const float4 four = eight.lo + eight.hi;
    const float2 two = four.lo + four.hi;
    return two.x + two.y;
}

static inline void conv_few_weights(__global const float *restrict weights, int taps, int in_blocks,
                                    __local float *restrict w)
{
    for (int tap = 0; tap < taps * in_blocks; ++tap)
        for (int o = 0; o < CONV_FEW; ++o)
            for (int i = 0; i < NET_BLOCK; ++i)
                w[(tap * CONV_FEW + o) * NET_BLOCK + i] = weights[(tap * NET_BLOCK + i) * NET_BLOCK + o];
}

/* The sums of a pixel, one for each output channel, and their biases. */
static inline conv_v conv_few_finish(conv_v biases, const conv_v *sums)
{
    conv_v v = biases;
    v.s0 += conv_lanes_sum(sums[0]);
#if CONV_FEW > 1
    v.s1 += conv_lanes_sum(sums[1]);
    v.s2 += conv_lanes_sum(sums[2]);
#endif
    return v;
}

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
conv_few(__global const float *restrict x, __global const float *restrict weights, __global const float *restrict bias,
         __global float *restrict y, __global const float *restrict mask, __local STATED_SIZE float *restrict w,
         hada_conv_problem problem)
{
    const int out_channels = problem.out.channels, out_rows = problem.out.rows, out_cols = problem.out.cols;
    const int flags = problem.epilogue.flags, activation = problem.epilogue.activation;
    const float slope = problem.epilogue.slope;
    const int rows_each = problem.rows_each, image = get_global_id(1);
    const int in_blocks = (problem.in.channels + NET_BLOCK - 1) / NET_BLOCK;
    const int x_row = (problem.in.cols + 2) * NET_BLOCK, y_row = (out_cols + 2) * NET_BLOCK;
    const size_t x_plane = (size_t)(problem.in.rows + 2) * x_row;
    const int row_end = min((int)(get_global_id(0) + 1) * rows_each, out_rows);
    const hada_conv_taps rows = hada_conv_taps_of(problem.kernel_rows, problem.pad_rows, 1, 0);
    const hada_conv_taps cols = hada_conv_taps_of(problem.kernel_cols, problem.pad_cols, 1, 0);
    const int down = rows.count, across = cols.count;
    const conv_v biases = conv_bias(bias + problem.epilogue.bias, flags, out_channels);
    x += problem.in.offset + image * problem.in.image + (rows.first + 1) * x_row + (cols.first + 1) * NET_BLOCK;
    y += problem.out.offset + image * problem.out.image + y_row + NET_BLOCK;
    mask += problem.epilogue.mask + image * problem.epilogue.mask_image + y_row + NET_BLOCK;
    conv_few_weights(weights, down * across, in_blocks, w);
    for (int row = get_global_id(0) * rows_each; row < row_end; ++row)
        for (int col = 0; col < out_cols; col += CONV_PIXELS) {
            const int start = min(col, out_cols - CONV_PIXELS);
            conv_v sums[CONV_FEW][CONV_PIXELS];
#pragma unroll
            for (int o = 0; o < CONV_FEW; ++o)
#pragma unroll
                for (int p = 0; p < CONV_PIXELS; ++p)
                    sums[o][p] = (conv_v)(0.0f);
            __local const float *wt = w;
            for (int b = 0; b < in_blocks; ++b)
                for (int r = 0; r < down; ++r)
                    for (int c = 0; c < across; ++c, wt += CONV_FEW * NET_BLOCK) {
                        __global const float *xt = x + b * x_plane + (row + r) * x_row + (start + c) * NET_BLOCK;
                        conv_v wi[CONV_FEW];
#pragma unroll
                        for (int o = 0; o < CONV_FEW; ++o)
                            wi[o] = CONV_LOAD(wt + o * NET_BLOCK);
#pragma unroll
                        for (int p = 0; p < CONV_PIXELS; ++p) {
                            const conv_v xi = CONV_LOAD(xt + p * NET_BLOCK);
#pragma unroll
                            for (int o = 0; o < CONV_FEW; ++o)
                                sums[o][p] = fma(xi, wi[o], sums[o][p]);
                        }
                    }
#pragma unroll
            for (int p = 0; p < CONV_PIXELS; ++p) {
                const size_t at = (size_t)row * y_row + (start + p) * NET_BLOCK;
                conv_v few[CONV_FEW];
#pragma unroll
                for (int o = 0; o < CONV_FEW; ++o)
                    few[o] = sums[o][p];
                const conv_v v = conv_few_finish(biases, few);
                if (start + p >= col) /* the tile before has done the others, perhaps adding to y */
                    conv_put(v, flags, activation, slope, out_channels, mask + at, y + at);
            }
        }
}
