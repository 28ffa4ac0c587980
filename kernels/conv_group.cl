/* Convolution, transposed or not, for work-groups: an implicit matrix product of tiles. HADA_CONV_GROUP_ITEMS
 * work-items take CONV_HIGH output channels times CONV_TILE pixels of one phase, eight channels times CONV_PIXELS
 * pixels each. A step takes eight input channels of one tap; while its products are added up, the values of the next
 * step are on their way from memory to registers, and go to the other half of local memory, so that a step has one
 * barrier. Weights as conv_pack.cl makes them, in groups of CONV_HIGH; phases and taps: shared_conv.h.
 *
 * Where an image has few tiles, several groups share the steps of one: each writes its sum to
 * y[part][image][block][pixel][channel], and conv_group_finish.cl adds these up in order.
 *
 * All accesses are 128 bits wide: tensors begin at multiples of four floats. Dimensions: tiles of pixels times the
 * items, groups of output channels, images times phases times parts. */
#include "inc_conv_groups.h"

/* Output channels of a tile: 4, 16, 32 or 64; pixels of an item. With 4, an item has only the first four of a block of
 * eight, so that layers of one or three channels leave less idle. */
#ifndef CONV_HIGH
#define CONV_HIGH 64
#endif
#ifndef CONV_PIXELS
#define CONV_PIXELS 8
#endif

/* Items form CONV_DOWN rows of eight channels by CONV_ACROSS columns of pixels, and a warp of 32 (or half a wave of 64)
 * WARP_DOWN by WARP_ACROSS of them, so that it reads few different values at once. */
#define CONV_DOWN   (CONV_HIGH > 8 ? CONV_HIGH / 8 : 1)
#define CONV_ACROSS (HADA_CONV_GROUP_ITEMS / CONV_DOWN)
#define CONV_TILE   (CONV_PIXELS * CONV_ACROSS)
#define WARP_DOWN   (CONV_DOWN < 4 ? CONV_DOWN : 4)
#define WARP_ACROSS (32 / WARP_DOWN)

/* Of a step: vectors of four input channels that an item loads, and vectors of weights in all. */
#define CONV_LOADS   (2 * CONV_TILE / HADA_CONV_GROUP_ITEMS)
#define CONV_FACTORS (8 * CONV_HIGH / 4)
/* four vectors more shift the second four channels by half of all banks: both are stored at once */
#define CONV_PITCH (CONV_TILE + 4)

/* A vector of sums for each pixel += channel `c` of four of its values, times the weights of that channel. */
#define CONV_ADD(c, k)                                                                                                 \
    {                                                                                                                  \
        const float4 low = w[(k) * (CONV_HIGH / 4)], high = w[(k) * (CONV_HIGH / 4) + (CONV_HIGH > 4)];                \
        _Pragma("unroll") for (int p = 0; p < CONV_PIXELS; ++p)                                                        \
        {                                                                                                              \
            lows[p] = fma((float4)(v[p].c), low, lows[p]);                                                             \
            if (CONV_HIGH > 4)                                                                                         \
                highs[p] = fma((float4)(v[p].c), high, highs[p]);                                                      \
        }                                                                                                              \
    }

__kernel __attribute__((reqd_work_group_size(HADA_CONV_GROUP_ITEMS, 1, 1))) void
conv_group(__global const float *restrict x, __global const float *restrict weights,
           __global const float *restrict bias, __global float *restrict y, __global const float *restrict mask,
           hada_conv_problem problem)
{
    __local float4 inputs[2][2 * CONV_PITCH], factors[2][CONV_FACTORS];
    const int item = get_local_id(0), warp = item / 32;
    const int tx = warp % (CONV_ACROSS / WARP_ACROSS) * WARP_ACROSS + item % WARP_ACROSS;
    const int ty = warp / (CONV_ACROSS / WARP_ACROSS) * WARP_DOWN + item % 32 / WARP_ACROSS;
    const conv_share share = conv_share_of(problem, CONV_TILE);
    __global const float4 *restrict from =
        (__global const float4 *)(x + problem.in.offset + share.image * problem.in.image);
    __global const float4 *restrict w_from =
        (__global const float4 *)weights + conv_share_weights(share, problem, CONV_FACTORS) + item % CONV_FACTORS;
    conv_walk walk = conv_walk_of(share);

    /* what the item loads: every other vector of four channels */
    uint mine[CONV_LOADS];
#pragma unroll
    for (int i = 0; i < CONV_LOADS; ++i)
        mine[i] = conv_share_pixel(share, problem, share.tile + item / 2 + i * (HADA_CONV_GROUP_ITEMS / 2)) + item % 2;
    const int store = item % 2 * CONV_PITCH + item / 2;

    float4 lows[CONV_PIXELS], highs[CONV_PIXELS], next[CONV_LOADS];
#pragma unroll
    for (int p = 0; p < CONV_PIXELS; ++p)
        lows[p] = highs[p] = (float4)(0.0f);
#pragma unroll
    for (int i = 0; i < CONV_LOADS && share.begin < share.end; ++i)
        inputs[0][store + i * (HADA_CONV_GROUP_ITEMS / 2)] = from[walk.at + mine[i]];
    if (item < CONV_FACTORS && share.begin < share.end)
        factors[0][item] = w_from[0];
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int s = share.begin; s < share.end; ++s) {
        const int half_used = (s - share.begin) % 2,
                  left = problem.in.channels - walk.block * NET_BLOCK - walk.eight * 8;
        if (s + 1 < share.end) { /* the last step loads its own values again, unused */
            walk = conv_walk_on(walk, share);
            w_from += CONV_FACTORS;
        }
#pragma unroll
        for (int i = 0; i < CONV_LOADS; ++i)
            next[i] = from[walk.at + mine[i]];
        const float4 next_factor = w_from[0];
        /* four channels that only fill up a block are not stored */
#pragma unroll
        for (int four = 0; four < 2; ++four) {
            if (four && left <= 4)
                break;
            __local const float4 *w = factors[half_used] + four * CONV_HIGH + ty * 2;
            float4 v[CONV_PIXELS];
#pragma unroll
            for (int p = 0; p < CONV_PIXELS; ++p)
                v[p] = inputs[half_used][four * CONV_PITCH + p * CONV_ACROSS + tx];
            CONV_ADD(x, 0)
            CONV_ADD(y, 1)
            CONV_ADD(z, 2)
            CONV_ADD(w, 3)
        }
#pragma unroll
        for (int i = 0; i < CONV_LOADS; ++i)
            inputs[1 - half_used][store + i * (HADA_CONV_GROUP_ITEMS / 2)] = next[i];
        if (item < CONV_FACTORS)
            factors[1 - half_used][item] = next_factor;
        barrier(CLK_LOCAL_MEM_FENCE);
    }

    const int first = share.group * CONV_HIGH + ty * 8;
    if (first / NET_BLOCK >= problem.out.blocks)
        return;
    conv_target to;
    conv_target_of(&to, share, problem, first, bias, mask, y);
#pragma unroll
    for (int p = 0; p < CONV_PIXELS; ++p)
        conv_target_put(to, share, problem, share.tile + p * CONV_ACROSS + tx, lows[p], highs[p]);
}
