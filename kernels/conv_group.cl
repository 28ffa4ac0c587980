/* Convolution, transposed or not, for work-groups: an implicit matrix product of tiles. HADA_CONV_GROUP_ITEMS
 * work-items take CONV_HIGH output channels times CONV_TILE pixels of one phase, eight channels times CONV_PIXELS
 * pixels each. A step takes eight input channels of one tap; while its products are added up, the values of the next
 * step are on their way from memory to registers, and go to the other half of local memory, so that a step has one
 * barrier. Weights as conv_pack.cl makes them, in groups of CONV_HIGH; phases and taps: shared_conv.h.
 *
 * Where an image has few tiles, several groups share the steps of one: each writes its sum to
 * y[part][image][block][pixel][channel], and conv_group_finish adds these up in order.
 *
 * All accesses are 128 bits wide: tensors begin at multiples of four floats. Dimensions: tiles of pixels times the
 * items, groups of output channels, images times phases times parts. */
#include "inc_conv_groups.h"

/* Output channels of a tile: 16, 32 or 64; pixels of an item. */
#ifndef CONV_HIGH
#define CONV_HIGH 64
#endif
#ifndef CONV_PIXELS
#define CONV_PIXELS 8
#endif

/* Items stand in CONV_DOWN rows of eight channels by CONV_ACROSS columns of pixels; a warp of 32 (or half a wave of 64)
 * in WARP_DOWN by WARP_ACROSS of them, so that it reads few different values at once. */
#define CONV_DOWN   (CONV_HIGH / 8)
#define CONV_ACROSS (HADA_CONV_GROUP_ITEMS / CONV_DOWN)
#define CONV_TILE   (CONV_PIXELS * CONV_ACROSS)
#define WARP_DOWN   (CONV_DOWN < 4 ? CONV_DOWN : 4)
#define WARP_ACROSS (32 / WARP_DOWN)

/* Of a step: vectors of four input channels that an item loads, and vectors of weights in all. */
#define CONV_LOADS   (2 * CONV_TILE / HADA_CONV_GROUP_ITEMS)
#define CONV_FACTORS (8 * CONV_HIGH / 4)
/* four vectors more shift the second four channels by half of all banks: both are stored at once */
#define CONV_PITCH (CONV_TILE + 4)

/* Where a pass stands: tap, eight channels of a block, block; `at`: their place from the first one's on, in vectors of
 * four. All items of a group have the same. */
typedef struct conv_walk {
    int row, col, eight, block;
    uint at;
} conv_walk;

static inline conv_walk conv_walk_of(int step, hada_conv_taps rows, hada_conv_taps cols, uint x_row, uint x_plane)
{
    /* a phase may have no taps, and then no steps */
    const int eights = NET_BLOCK / 8, wide = max(cols.count, 1), taps = max(rows.count, 1) * wide;
    const int tap = step / eights % taps;
    conv_walk walk;
    walk.eight = step % eights;
    walk.block = step / eights / taps;
    walk.row = tap / wide;
    walk.col = tap % wide;
    walk.at = walk.block * x_plane + walk.row * x_row + walk.col * (NET_BLOCK / 4) + walk.eight * 2;
    return walk;
}

static inline conv_walk conv_walk_on(conv_walk walk, hada_conv_taps rows, hada_conv_taps cols, uint x_row, uint x_plane)
{
    walk.at += 2;
#if NET_BLOCK > 8
    if (++walk.eight < NET_BLOCK / 8)
        return walk;
    walk.eight = 0;
#endif
    if (++walk.col == cols.count) { /* from one row of taps to the next, then to the first of the next block */
        walk.at += x_row - cols.count * (NET_BLOCK / 4);
        walk.col = 0;
        if (++walk.row == rows.count) {
            walk.at += x_plane - rows.count * x_row;
            walk.row = 0;
            ++walk.block;
        }
    }
    return walk;
}

/* A vector of sums for each pixel += channel `c` of four of its values, times the weights of that channel. */
#define CONV_ADD(c, k)                                                                                                 \
    {                                                                                                                  \
        const float4 low = w[(k) * (CONV_HIGH / 4)], high = w[(k) * (CONV_HIGH / 4) + 1];                              \
        _Pragma("unroll") for (int p = 0; p < CONV_PIXELS; ++p)                                                        \
        {                                                                                                              \
            lows[p] = fma((float4)(v[p].c), low, lows[p]);                                                             \
            highs[p] = fma((float4)(v[p].c), high, highs[p]);                                                          \
        }                                                                                                              \
    }

__kernel __attribute__((reqd_work_group_size(HADA_CONV_GROUP_ITEMS, 1, 1))) void
conv_group(__global const float *restrict x, __global const float *restrict weights,
           __global const float *restrict bias, __global float *restrict y, __global const float *restrict mask,
           hada_conv_problem problem)
{
    __local float4 inputs[2][2 * CONV_PITCH], factors[2][CONV_FACTORS];
    const int in_cols = problem.in.cols, out_rows = problem.out.rows, out_cols = problem.out.cols;
    const int step = problem.step, phases = step * step, parts = problem.parts;
    const int phase = get_global_id(2) % phases, part = get_global_id(2) / phases % parts;
    const int image = get_global_id(2) / phases / parts, group = get_global_id(1), item = get_local_id(0);
    const int warp = item / 32, tx = warp % (CONV_ACROSS / WARP_ACROSS) * WARP_ACROSS + item % WARP_ACROSS;
    const int ty = warp / (CONV_ACROSS / WARP_ACROSS) * WARP_DOWN + item % 32 / WARP_ACROSS;
    const int phase_row = phase / step, phase_col = phase % step;
    const int height = (out_rows - phase_row + step - 1) / step, width = (out_cols - phase_col + step - 1) / step;
    const int pixels = height * width, tile = get_group_id(0) * CONV_TILE;
    const hada_conv_taps rows = hada_conv_taps_of(problem.kernel_rows, problem.pad_rows, step, phase_row);
    const hada_conv_taps cols = hada_conv_taps_of(problem.kernel_cols, problem.pad_cols, step, phase_col);
    const uint x_row = (in_cols + 2) * (NET_BLOCK / 4), x_plane = (problem.in.rows + 2) * x_row;
    const int in_blocks = problem.in.blocks;
    const size_t group_vectors = (size_t)((problem.kernel_rows + step - 1) / step) *
                                 ((problem.kernel_cols + step - 1) / step) * in_blocks * (NET_BLOCK / 8) * CONV_FACTORS;
    const int steps = pixels > 0 ? in_blocks * rows.count * cols.count * (NET_BLOCK / 8) : 0;
    const int begin = (int)((long)steps * part / parts), end = (int)((long)steps * (part + 1) / parts);
    __global const float4 *restrict from = (__global const float4 *)(x + problem.in.offset + image * problem.in.image);
    __global const float4 *restrict w_from = (__global const float4 *)weights +
                                             ((size_t)phase * get_global_size(1) + group) * group_vectors +
                                             (size_t)begin * CONV_FACTORS + item % CONV_FACTORS;
    conv_walk walk = conv_walk_of(begin, rows, cols, x_row, x_plane);

    /* what the item brings: every other vector of four channels; pixels beyond the last one are worked out as the last
     * one and not stored */
    uint mine[CONV_LOADS];
#pragma unroll
    for (int i = 0; i < CONV_LOADS; ++i) {
        const int pixel = max(min(tile + item / 2 + i * (HADA_CONV_GROUP_ITEMS / 2), pixels - 1), 0);
        mine[i] = (uint)(pixel / max(width, 1) * problem.in_step + rows.first + 1) * x_row +
                  (uint)(pixel % max(width, 1) * problem.in_step + cols.first + 1) * (NET_BLOCK / 4) + item % 2;
    }
    const int store = item % 2 * CONV_PITCH + item / 2;

    float4 lows[CONV_PIXELS], highs[CONV_PIXELS], next[CONV_LOADS];
#pragma unroll
    for (int p = 0; p < CONV_PIXELS; ++p)
        lows[p] = highs[p] = (float4)(0.0f);
#pragma unroll
    for (int i = 0; i < CONV_LOADS && begin < end; ++i)
        inputs[0][store + i * (HADA_CONV_GROUP_ITEMS / 2)] = from[walk.at + mine[i]];
    if (item < CONV_FACTORS && begin < end)
        factors[0][item] = w_from[0];
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int s = begin; s < end; ++s) {
        const int half_used = (s - begin) % 2, left = problem.in.channels - walk.block * NET_BLOCK - walk.eight * 8;
        if (s + 1 < end) { /* the last step brings its own values once more, for nobody */
            walk = conv_walk_on(walk, rows, cols, x_row, x_plane);
            w_from += CONV_FACTORS;
        }
#pragma unroll
        for (int i = 0; i < CONV_LOADS; ++i)
            next[i] = from[walk.at + mine[i]];
        const float4 next_factor = w_from[0];
        /* four channels that only fill up a block are left out */
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

    const int first = group * CONV_HIGH + ty * 8, block = first / NET_BLOCK;
    if (block >= problem.out.blocks)
        return;
    if (parts > 1) {
        const size_t images = get_global_size(2) / phases / parts;
        y += (((part * images + image) * problem.out.blocks + block) * out_rows * out_cols) * NET_BLOCK +
             first % NET_BLOCK;
#pragma unroll
        for (int p = 0; p < CONV_PIXELS; ++p) {
            const int pixel = tile + p * CONV_ACROSS + tx;
            const size_t at = (size_t)(pixel / width * step + phase_row) * out_cols + pixel % width * step + phase_col;
            if (pixel < pixels) {
                *(__global float4 *)(y + at * NET_BLOCK) = lows[p];
                *(__global float4 *)(y + at * NET_BLOCK + 4) = highs[p];
            }
        }
        return;
    }
    const int present = problem.out.channels - first;
    const float4 low_bias = conv_bias_four(bias + problem.epilogue.bias + first, problem.epilogue.flags, present);
    const float4 high_bias =
        conv_bias_four(bias + problem.epilogue.bias + first + 4, problem.epilogue.flags, present - 4);
    y += problem.out.offset + image * problem.out.image;
    mask += problem.epilogue.mask + image * problem.epilogue.mask_image;
#pragma unroll
    for (int p = 0; p < CONV_PIXELS; ++p) {
        const int pixel = tile + p * CONV_ACROSS + tx;
        if (pixel >= pixels)
            continue;
        const int row = pixel / width * step + phase_row, col = pixel % width * step + phase_col;
        const size_t at =
            ((size_t)(block * (out_rows + 2) + row + 1) * (out_cols + 2) + col + 1) * NET_BLOCK + first % NET_BLOCK;
        conv_put_four(lows[p] + low_bias, problem.epilogue, present, mask + at, y + at);
        conv_put_four(highs[p] + high_bias, problem.epilogue, present - 4, mask + at + 4, y + at + 4);
    }
}

/* The sums of all parts to the output. Dimensions: columns times fours of a block, rows, images times blocks. */
__kernel void conv_group_finish(__global const float *restrict partial, __global const float *restrict bias,
                                __global float *restrict y, __global const float *restrict mask,
                                hada_conv_problem problem)
{
    const int rows = problem.out.rows, cols = problem.out.cols, blocks = problem.out.blocks;
    const int four = get_global_id(0) % (NET_BLOCK / 4) * 4, col = get_global_id(0) / (NET_BLOCK / 4);
    const int row = get_global_id(1), block = get_global_id(2) % blocks, image = get_global_id(2) / blocks;
    const int first = block * NET_BLOCK + four, present = problem.out.channels - first;
    const size_t all = get_global_size(2) * (size_t)rows * cols * NET_BLOCK;
    const size_t at = ((size_t)(block * (rows + 2) + row + 1) * (cols + 2) + col + 1) * NET_BLOCK + four;
    if (col >= cols)
        return;
    partial += ((get_global_id(2) * rows + row) * cols + col) * NET_BLOCK + four;
    float4 sum = *(__global const float4 *)partial;
    for (int part = 1; part < problem.parts; ++part)
        sum += *(__global const float4 *)(partial + part * all);
    sum += conv_bias_four(bias + problem.epilogue.bias + first, problem.epilogue.flags, present);
    conv_put_four(sum, problem.epilogue, present,
                  mask + problem.epilogue.mask + image * problem.epilogue.mask_image + at,
                  y + problem.out.offset + image * problem.out.image + at);
}
