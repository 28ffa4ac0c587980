/* Weights for Winograd's F(m x m, 3 x 3): G g G^T for each pair of channels, [place][group][input channel of all
 * blocks] [output channel of the group], zero where there is no such channel. Arguments as in conv_pack.cl; the way to
 * fine takes the kernel mirrored. Dimensions: output channels of all groups, input channels of all blocks. */
#define CONV_MEM __global
#include "inc_conv_winograd.h"

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
