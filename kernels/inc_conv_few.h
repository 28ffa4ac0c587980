/* For convolutions to few output channels, whose lanes are input channels: weights in local memory, and the end of a
 * sum. */
#ifndef INC_CONV_FEW_H
#define INC_CONV_FEW_H

#include "inc_conv.h"
#include "shared_local.h"

#ifndef CONV_FEW
#define CONV_FEW 1
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

#endif
