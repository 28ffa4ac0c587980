/* Weights in the order in which the kernels of convolutions read them. */
#define CONV_MEM __global
#include "inc_conv_winograd.h"

/* Weights for direct convolutions, from w[coarse][fine][kernel row][kernel column]
 * (lib/net/conv.h): [phase][group][input block][tap row][tap column][input channel of the block][output channel of the
 * group], zero where there is no such channel. Phases and taps: inc_conv.h. Dimensions: output channels of all groups,
 * input channels of all blocks. */
__kernel void conv_pack(__global const float *w, ulong w_offset, int in_channels, int out_channels, int to_coarse,
                        int kernel_rows, int kernel_cols, int pad_rows, int pad_cols, int step, int block, int lanes,
                        __global float *packed)
{
    const int out = get_global_id(0), in = get_global_id(1);
    const int in_blocks = (in_channels + block - 1) / block, groups = get_global_size(0) / lanes;
    const int known = out < out_channels && in < in_channels, places = kernel_rows * kernel_cols;
    const size_t from =
        w_offset + (to_coarse ? (size_t)out * in_channels + in : (size_t)in * out_channels + out) * places;
    const size_t tap_floats = (size_t)block * lanes, taps_rows = (kernel_rows + step - 1) / step;
    const size_t group_floats = taps_rows * ((kernel_cols + step - 1) / step) * in_blocks * tap_floats;
    for (int phase = 0; phase < step * step; ++phase) {
        const conv_taps rows = conv_taps_of(kernel_rows, pad_rows, step, phase / step);
        const conv_taps cols = conv_taps_of(kernel_cols, pad_cols, step, phase % step);
        __global float *to = packed + ((size_t)phase * groups + out / lanes) * group_floats +
                             (size_t)(in / block) * rows.count * cols.count * tap_floats + in % block * lanes +
                             out % lanes;
        for (int r = 0; r < rows.count; ++r)
            for (int c = 0; c < cols.count; ++c) {
                /* a convolution's taps run with the places of its kernel, a transposed one's against them */
                const int u = to_coarse ? r : rows.u0 - step * r, v = to_coarse ? c : cols.u0 - step * c;
                to[(r * cols.count + c) * tap_floats] = known ? w[from + u * kernel_cols + v] : 0.0f;
            }
    }
}

/* One dimension of the weights' transform: o = G g. */
static inline void conv_weights_1d(const float *g, int step, float *o)
{
    const float a = g[0], b = g[step], c = g[2 * step];
#if CONV_TILE == 4
    const float s = (a + c) * (1.0f / 6.0f), q = fma(c, 1.0f / 6.0f, a * (1.0f / 24.0f));
    o[0] = 0.25f * a;
    o[1] = -s - b * (1.0f / 6.0f);
    o[2] = -s + b * (1.0f / 6.0f);
    o[3] = q + b * (1.0f / 12.0f);
    o[4] = q - b * (1.0f / 12.0f);
    o[5] = c;
#else
    o[0] = a;
    o[1] = 0.5f * (a + b + c);
    o[2] = 0.5f * (a - b + c);
    o[3] = c;
#endif
}

/* Weights for Winograd's F(m x m, 3 x 3): G g G^T for each pair of channels, [place][group][input channel of all
 * blocks] [output channel of the group], zero where there is no such channel. Arguments as in conv_pack; the way to
 * fine takes the kernel mirrored. Dimensions: output channels of all groups, input channels of all blocks. */
__kernel void conv_winograd_pack(__global const float *w, ulong w_offset, int in_channels, int out_channels,
                                 int to_coarse, int lanes, __global float *packed)
{
    const int out = get_global_id(0), in = get_global_id(1), groups = get_global_size(0) / lanes;
    const int known = out < out_channels && in < in_channels;
    const size_t from = w_offset + (to_coarse ? (size_t)out * in_channels + in : (size_t)in * out_channels + out) * 9;
    float g[9], across[3 * CONV_REACH];
    for (int i = 0; i < 9; ++i)
        g[i] = known ? w[from + (to_coarse ? i : 8 - i)] : 0.0f;
    for (int r = 0; r < 3; ++r)
        conv_weights_1d(g + 3 * r, 1, across + CONV_REACH * r);
    for (int c = 0; c < CONV_REACH; ++c) {
        float down[CONV_REACH];
        conv_weights_1d(across + c, CONV_REACH, down);
        for (int r = 0; r < CONV_REACH; ++r)
            packed[((size_t)((r * CONV_REACH + c) * groups + out / lanes) * get_global_size(1) + in) * lanes +
                   out % lanes] = down[r];
    }
}
