/* Convolution, transposed or not, for work-groups with tensor cores: the implicit matrix product of conv_group.cl, each
 * float split into two values of TF32, of whose four products the three largest are added up (error:
 * docs/explanation/speed-and-accuracy.md). Arguments, dimensions, packed weights, steps, parts and local memory are
 * those of conv_group.cl.
 *
 * A warp takes 64 pixels times 32 output channels. Pixels are the rows of A. Input channels 2 k and 2 k + 1 of a step
 * are its columns k and k + 4, so that an item reads both at once; output channels 4 n + j of the warp are the columns
 * n of its j-th matrix B, so that an item reads four weights at once and ends with eight neighbouring channels of a
 * pixel: accesses to local memory are of 64 and 128 bits, to global memory of 128. */
#include "inc_conv_groups.h"
#include "inc_conv_mma.h"

/* Output channels of a tile: 32 or 64. */
#ifndef CONV_HIGH
#define CONV_HIGH 64
#endif

/* Of a warp, and of the group. */
#define WARP_PIXELS 64
#define WARP_HIGH   32
#define CONV_WARPS  (HADA_CONV_GROUP_ITEMS / 32)
#define CONV_BESIDE (CONV_HIGH / WARP_HIGH)
#define CONV_TILE   (WARP_PIXELS * CONV_WARPS / CONV_BESIDE)
/* Matrices A and B of a warp. */
#define CONV_A (WARP_PIXELS / 16)
#define CONV_B (WARP_HIGH / 8)

/* Of a step: vectors of four input channels that an item loads, and vectors of weights in all. */
#define CONV_LOADS   (2 * CONV_TILE / HADA_CONV_GROUP_ITEMS)
#define CONV_FACTORS (8 * CONV_HIGH / 4)
/* one vector more, so that the items of a warp read from different banks */
#define CONV_PITCH (CONV_HIGH / 4 + 1)

__kernel __attribute__((reqd_work_group_size(HADA_CONV_GROUP_ITEMS, 1, 1))) void
conv_tf32(__global const float *restrict x, __global const float *restrict weights, __global const float *restrict bias,
          __global float *restrict y, __global const float *restrict mask, hada_conv_problem problem)
{
    __local float4 inputs[2][2 * CONV_TILE], factors[2][8 * CONV_PITCH];
    CONV_EXCHANGE
    const int item = get_local_id(0), row = item % 32 / 4, col = item % 4;
    const int pixel = item / 32 / CONV_BESIDE * WARP_PIXELS + row, beside = item / 32 % CONV_BESIDE * (WARP_HIGH / 4);
    const conv_share share = conv_share_of(problem, CONV_TILE);
    __global const float4 *restrict from =
        (__global const float4 *)(x + problem.in.offset + share.image * problem.in.image);
    __global const float4 *restrict w_from =
        (__global const float4 *)weights + conv_share_weights(share, problem, CONV_FACTORS) + item % CONV_FACTORS;
    const int w_to = item / (CONV_HIGH / 4) * CONV_PITCH + item % (CONV_HIGH / 4);
    conv_walk walk = conv_walk_of(share);

    /* what the item loads: every other vector of four channels */
    uint mine[CONV_LOADS];
#pragma unroll
    for (int i = 0; i < CONV_LOADS; ++i)
        mine[i] = conv_share_pixel(share, problem, share.tile + item / 2 + i * (HADA_CONV_GROUP_ITEMS / 2)) + item % 2;

    float4 sums[CONV_A][CONV_B], next[CONV_LOADS];
    for (int m = 0; m < CONV_A; ++m)
        for (int j = 0; j < CONV_B; ++j)
            sums[m][j] = (float4)(0.0f);
#pragma unroll
    for (int i = 0; i < CONV_LOADS && share.begin < share.end; ++i)
        inputs[0][item + i * HADA_CONV_GROUP_ITEMS] = from[walk.at + mine[i]];
    if (item < CONV_FACTORS && share.begin < share.end)
        factors[0][w_to] = w_from[0];
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int s = share.begin; s < share.end; ++s) {
        const int half_used = (s - share.begin) % 2;
        if (s + 1 < share.end) { /* the last step loads its own values again, unused */
            walk = conv_walk_on(walk, share);
            w_from += CONV_FACTORS;
        }
#pragma unroll
        for (int i = 0; i < CONV_LOADS; ++i)
            next[i] = from[walk.at + mine[i]];
        const float4 next_factor = w_from[0];

        uint2 b_large[CONV_B], b_small[CONV_B];
        {
            __local const float *w = (__local const float *)(factors[half_used] + 2 * col * CONV_PITCH + beside + row);
            const float4 even = vload4(0, w), odd = vload4(CONV_PITCH, w);
            const float evens[CONV_B] = {even.x, even.y, even.z, even.w}, odds[CONV_B] = {odd.x, odd.y, odd.z, odd.w};
#pragma unroll
            for (int j = 0; j < CONV_B; ++j) {
                b_large[j] = (uint2)(conv_tf32_large(evens[j]), conv_tf32_large(odds[j]));
                b_small[j] = (uint2)(conv_tf32_small(evens[j], b_large[j].x), conv_tf32_small(odds[j], b_large[j].y));
            }
        }
        __local const float2 *pairs = (__local const float2 *)inputs[half_used] + pixel * 4 + col;
        CONV_UNROLL
        for (int m = 0; m < CONV_A; ++m) {
            const float2 upper = pairs[m * 64], lower = pairs[m * 64 + 32];
            const float4 v = (float4)(upper.x, lower.x, upper.y, lower.y);
            const uint4 large =
                (uint4)(conv_tf32_large(v.x), conv_tf32_large(v.y), conv_tf32_large(v.z), conv_tf32_large(v.w));
            const uint4 small = (uint4)(conv_tf32_small(v.x, large.x), conv_tf32_small(v.y, large.y),
                                        conv_tf32_small(v.z, large.z), conv_tf32_small(v.w, large.w));
            /* tensor cores truncate their sums: those of a step begin at zero, smallest products first, and are rounded
             * as they are added up */
            float4 d[CONV_B];
            CONV_UNROLL
            for (int j = 0; j < CONV_B; ++j)
                d[j] = conv_mma((float4)(0.0f), small, b_large[j], CONV_EXCHANGED);
            CONV_UNROLL
            for (int j = 0; j < CONV_B; ++j)
                d[j] = conv_mma(d[j], large, b_small[j], CONV_EXCHANGED);
            CONV_UNROLL
            for (int j = 0; j < CONV_B; ++j)
                sums[m][j] += conv_mma(d[j], large, b_large[j], CONV_EXCHANGED);
        }
#pragma unroll
        for (int i = 0; i < CONV_LOADS; ++i)
            inputs[1 - half_used][item + i * HADA_CONV_GROUP_ITEMS] = next[i];
        if (item < CONV_FACTORS)
            factors[1 - half_used][w_to] = next_factor;
        barrier(CLK_LOCAL_MEM_FENCE);
    }

    const int first = share.group * CONV_HIGH + beside * 4 + col * 8;
    if (first / NET_BLOCK >= problem.out.blocks)
        return;
    conv_target to;
    conv_target_of(&to, share, problem, first, bias, mask, y);
#pragma unroll
    for (int m = 0; m < CONV_A; ++m) {
        const int at = share.tile + pixel + m * 16;
        conv_target_put(to, share, problem, at, (float4)(sums[m][0].x, sums[m][1].x, sums[m][2].x, sums[m][3].x),
                        (float4)(sums[m][0].y, sums[m][1].y, sums[m][2].y, sums[m][3].y));
        conv_target_put(to, share, problem, at + 8, (float4)(sums[m][0].z, sums[m][1].z, sums[m][2].z, sums[m][3].z),
                        (float4)(sums[m][0].w, sums[m][1].w, sums[m][2].w, sums[m][3].w));
    }
}
