/* Convolution, transposed or not, for work-groups: an implicit matrix product in tiles. HADA_CONV_GROUP_ITEMS (64)
 * work-items take 64 pixels of one phase times 32 output channels; for every block of input channels and every tap the
 * inputs and the weights go to local memory, then each work-item adds to its 4 pixels x 8 channels. Arguments, phases,
 * taps and weights as in conv_direct.cl (groups of 32 output channels). Dimensions: tiles of pixels times 64, groups of
 * output channels, images times phases. */
#include "inc_conv.h"

__kernel __attribute__((reqd_work_group_size(HADA_CONV_GROUP_ITEMS, 1, 1))) void
conv_group(__global const float *restrict x, __global const float *restrict weights,
           __global const float *restrict bias, __global float *restrict y, __global const float *restrict mask,
           hada_conv_problem problem)
{
    const int in_channels = problem.in.channels, in_rows = problem.in.rows, in_cols = problem.in.cols;
    const int out_channels = problem.out.channels, out_rows = problem.out.rows, out_cols = problem.out.cols;
    const int kernel_rows = problem.kernel_rows, kernel_cols = problem.kernel_cols;
    const int pad_rows = problem.pad_rows, pad_cols = problem.pad_cols;
    const int in_step = problem.in_step, step = problem.step, flags = problem.epilogue.flags;
    const int activation = problem.epilogue.activation;
    const float slope = problem.epilogue.slope;
    __local float inputs[NET_BLOCK][HADA_CONV_GROUP_ITEMS], factors[NET_BLOCK * HADA_CONV_GROUP_LANES];
    const int item = get_local_id(0), tx = item % 16, ty = item / 16;
    const int phase = get_global_id(2) % (step * step), image = get_global_id(2) / (step * step);
    const int phase_row = phase / step, phase_col = phase % step, group = get_global_id(1);
    const int in_blocks = (in_channels + NET_BLOCK - 1) / NET_BLOCK;
    const int height = (out_rows - phase_row + step - 1) / step, width = (out_cols - phase_col + step - 1) / step;
    const int pixels = height * width, tile = get_group_id(0) * HADA_CONV_GROUP_ITEMS;
    const int x_row = (in_cols + 2) * NET_BLOCK;
    const size_t x_plane = (size_t)(in_rows + 2) * x_row;
    const hada_conv_taps rows = hada_conv_taps_of(kernel_rows, pad_rows, step, phase_row);
    const hada_conv_taps cols = hada_conv_taps_of(kernel_cols, pad_cols, step, phase_col);
    const int taps = rows.count * cols.count;
    const size_t group_floats = (size_t)((kernel_rows + step - 1) / step) * ((kernel_cols + step - 1) / step) *
                                in_blocks * NET_BLOCK * HADA_CONV_GROUP_LANES;
    /* pixels beyond the last one are worked out as the last one and not stored */
    const int mine = max(min(tile + item, pixels - 1), 0);
    weights += ((size_t)phase * get_global_size(1) + group) * group_floats;
    x += problem.in.offset + image * problem.in.image;

    float8 sums[4];
    for (int p = 0; p < 4; ++p)
        sums[p] = (float8)(0.0f);
    for (int step_in = 0; step_in < in_blocks * taps; ++step_in) {
        const int block = step_in / taps, t = step_in % taps;
        const int row = mine / max(width, 1) * in_step + rows.first + t / cols.count + 1;
        const int col = mine % max(width, 1) * in_step + cols.first + t % cols.count + 1;
        __global const float *restrict from = x + block * x_plane + (size_t)row * x_row + col * NET_BLOCK;
        __global const float *restrict w = weights + (size_t)step_in * NET_BLOCK * HADA_CONV_GROUP_LANES;
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int i = 0; i < NET_BLOCK; ++i)
            inputs[i][item] = from[i];
        for (int i = item; i < NET_BLOCK * HADA_CONV_GROUP_LANES; i += HADA_CONV_GROUP_ITEMS)
            factors[i] = w[i];
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int i = 0; i < NET_BLOCK; ++i) {
            const float8 f = vload8(0, factors + i * HADA_CONV_GROUP_LANES + ty * 8);
            for (int p = 0; p < 4; ++p)
                sums[p] = fma((float8)(inputs[i][p * 16 + tx]), f, sums[p]);
        }
    }

    const int first = group * HADA_CONV_GROUP_LANES + ty * 8, block = first / NET_BLOCK, present = out_channels - first;
    const int blocks = (out_channels + NET_BLOCK - 1) / NET_BLOCK;
    float8 b = (float8)(0.0f);
    if (block < blocks && flags & HADA_CONV_HAS_BIAS) {
        float lanes[8];
        for (int k = 0; k < 8; ++k)
            lanes[k] = k < present ? bias[problem.epilogue.bias + first + k] : 0.0f;
        b = vload8(0, lanes);
    }
    for (int p = 0; p < 4; ++p) {
        const int pixel = tile + p * 16 + tx;
        if (pixel >= pixels || block >= blocks)
            continue;
        const int row = pixel / width * step + phase_row, col = pixel % width * step + phase_col;
        const size_t at =
            ((size_t)(block * (out_rows + 2) + row + 1) * (out_cols + 2) + col + 1) * NET_BLOCK + first % NET_BLOCK;
        __global float *to = y + problem.out.offset + image * problem.out.image + at;
        float8 v = sums[p] + b;
        if (activation == HADA_ACTIVATION_SIGMOID)
            v = (float8)(1.0f) / ((float8)(1.0f) + exp(-v));
        else if (activation != HADA_ACTIVATION_NONE)
            v = max(v, (float8)(0.0f)) + (activation == HADA_ACTIVATION_RELU ? 0.0f : slope) * min(v, (float8)(0.0f));
        if (flags & HADA_CONV_HAS_MASK)
            v = select((float8)(0.0f), v,
                       vload8(0, mask + problem.epilogue.mask + image * problem.epilogue.mask_image + at) >
                           (float8)(0.0f));
        if (flags & HADA_CONV_ACCUMULATES)
            v += vload8(0, to);
        vstore8(select((float8)(0.0f), v, (int8)(0, 1, 2, 3, 4, 5, 6, 7) < (int8)(present)), 0, to);
    }
}
