/* Gradients of weights from those of their transforms: partial sums added in order, then G^T dU G. partial[part]
 * [coarse block][fine][place][coarse] from `offset` on, channels filled up to blocks of NET_BLOCK;
 * dw[coarse][fine][3][3]. Dimensions: fine channels, blocks of coarse channels. */
#define CONV_MEM __global
#include "inc_conv_winograd.h"

/* o = G^T i, one dimension. */
static inline void conv_transposed_weights_1d(const conv_v *i, int step, conv_v *o)
{
    const conv_v s = i[step] + i[2 * step], d = i[2 * step] - i[step];
    const conv_v p = i[3 * step] + i[4 * step], m = i[3 * step] - i[4 * step];
    o[0] = 0.25f * i[0] - s * (1.0f / 6.0f) + p * (1.0f / 24.0f);
    o[1] = d * (1.0f / 6.0f) + m * (1.0f / 12.0f);
    o[2] = (p - s) * (1.0f / 6.0f) + i[5 * step];
}

__kernel void conv_winograd_reduce(__global const float *restrict partial, __global float *restrict dw, ulong offset,
                                   ulong dw_offset, int parts, int coarse_channels, int fine_channels, int accumulate)
{
    const int fine = get_global_id(0), block = get_global_id(1), present = coarse_channels - block * NET_BLOCK;
    const size_t filled = (size_t)(fine_channels + NET_BLOCK - 1) / NET_BLOCK * NET_BLOCK;
    const size_t part_floats = get_global_size(1) * filled * CONV_PLACES * NET_BLOCK;
    if (fine >= fine_channels)
        return;
    partial += offset + (block * filled + fine) * CONV_PLACES * NET_BLOCK;
    conv_v u[CONV_PLACES], across[3 * CONV_REACH], w[9];
    for (int f = 0; f < CONV_PLACES; ++f) {
        u[f] = CONV_LOAD(partial + f * NET_BLOCK);
        for (int part = 1; part < parts; ++part)
            u[f] += CONV_LOAD(partial + part * part_floats + f * NET_BLOCK);
    }
    for (int r = 0; r < CONV_REACH; ++r) {
        conv_v o[3];
        conv_transposed_weights_1d(u + r * CONV_REACH, 1, o);
        for (int c = 0; c < 3; ++c)
            across[c * CONV_REACH + r] = o[c];
    }
    for (int c = 0; c < 3; ++c) {
        conv_v o[3];
        conv_transposed_weights_1d(across + c * CONV_REACH, 1, o);
        for (int r = 0; r < 3; ++r)
            w[r * 3 + c] = o[r];
    }
    dw += dw_offset + ((size_t)block * NET_BLOCK * fine_channels + fine) * 9;
    for (int i = 0; i < 9; ++i) {
        float lanes[NET_BLOCK];
        CONV_STORE_IN(__private, w[i], lanes);
        for (int k = 0; k < NET_BLOCK && k < present; ++k) {
            __global float *to = dw + (size_t)k * fine_channels * 9 + i;
            *to = accumulate ? *to + lanes[k] : lanes[k];
        }
    }
}
