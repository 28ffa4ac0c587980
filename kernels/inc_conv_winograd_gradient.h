/* The gradients of weights by Winograd's F(4 x 4, 3 x 3), tile by tile. */
#ifndef INC_CONV_WINOGRAD_GRADIENT_H
#define INC_CONV_WINOGRAD_GRADIENT_H

#include "inc_conv_winograd.h"

#ifndef CONV_BLOCKS
#define CONV_BLOCKS 2
#endif
#ifndef CONV_FINE
#define CONV_FINE 4
#endif

/* o = A i, one dimension. */
static inline void conv_back_1d(const conv_v *i, conv_v *o)
{
    const conv_v e = i[0] + i[2], d = i[1] + i[3];
    const conv_v e2 = fma((conv_v)(4.0f), i[2], i[0]), d2 = fma((conv_v)(8.0f), i[3], 2.0f * i[1]);
    o[0] = i[0];
    o[1] = e + d;
    o[2] = e - d;
    o[3] = e2 + d2;
    o[4] = e2 - d2;
    o[5] = i[3];
}

/* The gradient at a tile of output pixels, without pixels that other tiles have, to A dy A^T. */
static inline void conv_tile_back(__global const float *restrict dy, size_t row_floats, conv_place place,
                                  CONV_MEM float *restrict to, size_t pitch)
{
    conv_v down[CONV_REACH][CONV_TILE];
#pragma unroll
    for (int c = 0; c < CONV_TILE; ++c) {
        conv_v i[CONV_TILE], o[CONV_REACH];
#pragma unroll
        for (int r = 0; r < CONV_TILE; ++r)
            i[r] = r < place.done_rows || c < place.done_cols ? (conv_v)(0.0f)
                                                              : CONV_LOAD(dy + r * row_floats + c * NET_BLOCK);
        conv_back_1d(i, o);
#pragma unroll
        for (int r = 0; r < CONV_REACH; ++r)
            down[r][c] = o[r];
    }
#pragma unroll
    for (int r = 0; r < CONV_REACH; ++r) {
        conv_v o[CONV_REACH];
        conv_back_1d(down[r], o);
#pragma unroll
        for (int c = 0; c < CONV_REACH; ++c)
            CONV_STORE_IN(CONV_MEM, o[c], to + (r * CONV_REACH + c) * pitch);
    }
}

/* The gradient of transformed weights at one place: CONV_BLOCKS blocks of coarse channels times CONV_FINE fine
 * channels, summed over `count` tiles; d: [coarse block][tile][channel], v: [tile][channel]; `adds`: to what is there.
 * Gradients stand as [coarse block][fine channel][place][coarse channel of the block]. */
static inline void conv_tile_correlate(CONV_MEM const float *d, size_t d_block, CONV_MEM const float *v, int count,
                                       int adds, __global float *to, int fine_channels)
{
    conv_v sums[CONV_BLOCKS][CONV_FINE];
#pragma unroll
    for (int o = 0; o < CONV_BLOCKS; ++o)
#pragma unroll
        for (int i = 0; i < CONV_FINE; ++i)
            sums[o][i] = (conv_v)(0.0f);
#pragma nounroll
    for (int t = 0; t < count; ++t) {
        conv_v g[CONV_BLOCKS];
#pragma unroll
        for (int o = 0; o < CONV_BLOCKS; ++o)
            g[o] = CONV_LOAD(d + o * d_block + t * NET_BLOCK);
#pragma unroll
        for (int i = 0; i < CONV_FINE; ++i) {
            const conv_v x = (conv_v)(v[t * NET_BLOCK + i]);
#pragma unroll
            for (int o = 0; o < CONV_BLOCKS; ++o)
                sums[o][i] = fma(x, g[o], sums[o][i]);
        }
    }
#pragma unroll
    for (int o = 0; o < CONV_BLOCKS; ++o)
#pragma unroll
        for (int i = 0; i < CONV_FINE; ++i) {
            __global float *restrict p = to + ((size_t)o * fine_channels + i) * CONV_PLACES * NET_BLOCK;
            CONV_STORE(adds ? CONV_LOAD(p) + sums[o][i] : sums[o][i], p);
        }
}

#endif
