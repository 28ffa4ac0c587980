/* The products in the middle of a convolution by Winograd's tiles. */
#ifndef INC_CONV_WINOGRAD_PRODUCTS_H
#define INC_CONV_WINOGRAD_PRODUCTS_H

#include "inc_conv_winograd.h"

#ifndef CONV_BLOCKS
#define CONV_BLOCKS 2
#endif
#ifndef CONV_PIXELS
#define CONV_PIXELS 6
#endif

/* Products of one place: CONV_PIXELS tiles times CONV_BLOCKS blocks of output channels, over all input channels. v:
 * [input block][tile][channel], tiles `v_block` floats a block; u: [input channel][output channel]; m: [output
 * block][tile][channel]. */
static inline void conv_tile_products(CONV_MEM const float *restrict v, size_t v_block,
                                      __global const float *restrict u, int in_blocks, CONV_MEM float *restrict m,
                                      size_t m_block)
{
    conv_v sums[CONV_BLOCKS][CONV_PIXELS];
#pragma unroll
    for (int o = 0; o < CONV_BLOCKS; ++o)
#pragma unroll
        for (int p = 0; p < CONV_PIXELS; ++p)
            sums[o][p] = (conv_v)(0.0f);
    for (int b = 0; b < in_blocks; ++b, v += v_block)
#pragma unroll
        for (int i = 0; i < NET_BLOCK; ++i, u += CONV_BLOCKS * NET_BLOCK) {
            conv_v w[CONV_BLOCKS];
#pragma unroll
            for (int o = 0; o < CONV_BLOCKS; ++o)
                w[o] = CONV_LOAD(u + o * NET_BLOCK);
#pragma unroll
            for (int p = 0; p < CONV_PIXELS; ++p) {
                const conv_v x = (conv_v)(v[p * NET_BLOCK + i]);
#pragma unroll
                for (int o = 0; o < CONV_BLOCKS; ++o)
                    sums[o][p] = fma(x, w[o], sums[o][p]);
            }
        }
#pragma unroll
    for (int o = 0; o < CONV_BLOCKS; ++o)
#pragma unroll
        for (int p = 0; p < CONV_PIXELS; ++p)
            CONV_STORE_IN(CONV_MEM, sums[o][p], m + o * m_block + p * NET_BLOCK);
}

#endif
