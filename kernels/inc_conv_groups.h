/* For convolutions in work-groups, with or without tensor cores: a group's share of the sums, its way through the
 * input, and the end of sums, four channels of a pixel at a time, 128 bits wide. */
#ifndef INC_CONV_GROUPS_H
#define INC_CONV_GROUPS_H

#include "inc_conv.h"

/* A group's share: pixels of one phase of an image from `tile` on, of a group of output channels, over the steps of its
 * part. A step is eight input channels of one tap. */
typedef struct conv_share {
    hada_conv_taps rows, cols;
    uint x_row, x_plane; /* of the input, in vectors of four */
    int phase, phase_row, phase_col, width, pixels, tile;
    int part, image, images, group, begin, end;
} conv_share;

static inline conv_share conv_share_of(hada_conv_problem problem, int tile_pixels)
{
    const int step = problem.step, phases = step * step, parts = problem.parts, place = get_global_id(2) / phases;
    conv_share share;
    share.phase = get_global_id(2) % phases;
    share.part = place % parts;
    share.image = place / parts;
    share.images = get_global_size(2) / phases / parts;
    share.group = get_global_id(1);
    share.phase_row = share.phase / step;
    share.phase_col = share.phase % step;
    share.width = (problem.out.cols - share.phase_col + step - 1) / step;
    share.pixels = (problem.out.rows - share.phase_row + step - 1) / step * share.width;
    share.tile = get_group_id(0) * tile_pixels;
    share.rows = hada_conv_taps_of(problem.kernel_rows, problem.pad_rows, step, share.phase_row);
    share.cols = hada_conv_taps_of(problem.kernel_cols, problem.pad_cols, step, share.phase_col);
    share.x_row = (problem.in.cols + 2) * (NET_BLOCK / 4);
    share.x_plane = (problem.in.rows + 2) * share.x_row;
    const int steps = share.pixels > 0 ? problem.in.blocks * share.rows.count * share.cols.count * (NET_BLOCK / 8) : 0;
    share.begin = (int)((long)steps * share.part / parts);
    share.end = (int)((long)steps * (share.part + 1) / parts);
    return share;
}

/* Where the weights of a share begin, in vectors of four; a step has step_vectors of them. */
static inline size_t conv_share_weights(conv_share share, hada_conv_problem problem, int step_vectors)
{
    const int step = problem.step;
    const size_t group_vectors = (size_t)((problem.kernel_rows + step - 1) / step) *
                                 ((problem.kernel_cols + step - 1) / step) * problem.in.blocks * (NET_BLOCK / 8) *
                                 step_vectors;
    return ((size_t)share.phase * get_global_size(1) + share.group) * group_vectors +
           (size_t)share.begin * step_vectors;
}

/* The input of a pixel at the first tap, in vectors; pixels beyond the last one are computed as the last one and not
 * stored. */
static inline uint conv_share_pixel(conv_share share, hada_conv_problem problem, int pixel)
{
    const int inside = max(min(pixel, share.pixels - 1), 0), width = max(share.width, 1);
    return (uint)(inside / width * problem.in_step + share.rows.first + 1) * share.x_row +
           (uint)(inside % width * problem.in_step + share.cols.first + 1) * (NET_BLOCK / 4);
}

/* The current step: tap, eight channels of a block, block; `at`: its place relative to the first one, in vectors of
 * four. The same for all items of a group. */
typedef struct conv_walk {
    int row, col, eight, block;
    uint at;
} conv_walk;

static inline conv_walk conv_walk_of(conv_share share)
{
    /* a phase may have no taps, and then no steps */
    const int eights = NET_BLOCK / 8, wide = max(share.cols.count, 1), taps = max(share.rows.count, 1) * wide;
    const int tap = share.begin / eights % taps;
    conv_walk walk;
    walk.eight = share.begin % eights;
    walk.block = share.begin / eights / taps;
    walk.row = tap / wide;
    walk.col = tap % wide;
    walk.at = walk.block * share.x_plane + walk.row * share.x_row + walk.col * (NET_BLOCK / 4) + walk.eight * 2;
    return walk;
}

static inline conv_walk conv_walk_on(conv_walk walk, conv_share share)
{
    walk.at += 2;
#if NET_BLOCK > 8
    if (++walk.eight < NET_BLOCK / 8)
        return walk;
    walk.eight = 0;
#endif
    if (++walk.col == share.cols.count) { /* from one row of taps to the next, then to the first of the next block */
        walk.at += share.x_row - share.cols.count * (NET_BLOCK / 4);
        walk.col = 0;
        if (++walk.row == share.rows.count) {
            walk.at += share.x_plane - share.rows.count * share.x_row;
            walk.row = 0;
            ++walk.block;
        }
    }
    return walk;
}

/* The biases of four channels, of which `present` are there, zero beyond the last one. */
static inline float4 conv_bias_four(__global const float *bias, int flags, int present)
{
    float4 b = (float4)(0.0f);
    if (flags & HADA_CONV_HAS_BIAS) {
        b.x = present > 0 ? bias[0] : 0.0f;
        b.y = present > 1 ? bias[1] : 0.0f;
        b.z = present > 2 ? bias[2] : 0.0f;
        b.w = present > 3 ? bias[3] : 0.0f;
    }
    return b;
}

/* Four channels of an output: `mask` and `y` are their places. */
static inline void conv_put_four(float4 v, hada_conv_epilogue epilogue, int present, __global const float *mask,
                                 __global float *y)
{
    if (epilogue.activation == HADA_ACTIVATION_SIGMOID)
        v = (float4)(1.0f) / ((float4)(1.0f) + exp(-v));
    else if (epilogue.activation != HADA_ACTIVATION_NONE)
        v = max(v, (float4)(0.0f)) +
            (epilogue.activation == HADA_ACTIVATION_RELU ? 0.0f : epilogue.slope) * min(v, (float4)(0.0f));
    if (epilogue.flags & HADA_CONV_HAS_MASK)
        v = select((float4)(0.0f), v, *(__global const float4 *)mask > (float4)(0.0f));
    if (epilogue.flags & HADA_CONV_ACCUMULATES)
        v += *(__global const float4 *)y;
    *(__global float4 *)y = select((float4)(0.0f), v, (int4)(0, 1, 2, 3) < (int4)(present));
}

/* Where an item puts its sums, those of the eight output channels from `first` on. */
typedef struct conv_target {
    __global float *y;
    __global const float *mask;
    float4 low_bias, high_bias;
    int first, block, present;
} conv_target;

static inline void conv_target_of(conv_target *to, conv_share share, hada_conv_problem problem, int first,
                                  __global const float *bias, __global const float *mask, __global float *y)
{
    to->first = first;
    to->block = first / NET_BLOCK;
    to->present = problem.out.channels - first;
    if (problem.parts > 1) { /* y[part][image][block][pixel][channel] */
        to->y = y + (((size_t)(share.part * share.images + share.image) * problem.out.blocks + to->block) *
                     problem.out.rows * problem.out.cols) *
                        NET_BLOCK;
        to->mask = mask;
        to->low_bias = to->high_bias = (float4)(0.0f);
        return;
    }
    bias += problem.epilogue.bias + first;
    to->low_bias = conv_bias_four(bias, problem.epilogue.flags, to->present);
    to->high_bias = conv_bias_four(bias + 4, problem.epilogue.flags, to->present - 4);
    to->y = y + problem.out.offset + share.image * problem.out.image;
    to->mask = mask + problem.epilogue.mask + share.image * problem.epilogue.mask_image;
}

/* The sums of a pixel, or of a part of them. */
static inline void conv_target_put(conv_target to, conv_share share, hada_conv_problem problem, int pixel, float4 low,
                                   float4 high)
{
    if (pixel >= share.pixels)
        return;
    const int row = pixel / share.width * problem.step + share.phase_row;
    const int col = pixel % share.width * problem.step + share.phase_col;
    if (problem.parts > 1) {
        __global float *y = to.y + ((size_t)row * problem.out.cols + col) * NET_BLOCK + to.first % NET_BLOCK;
        *(__global float4 *)y = low;
        *(__global float4 *)(y + 4) = high;
        return;
    }
    const size_t at =
        ((size_t)(to.block * (problem.out.rows + 2) + row + 1) * (problem.out.cols + 2) + col + 1) * NET_BLOCK +
        to.first % NET_BLOCK;
    conv_put_four(low + to.low_bias, problem.epilogue, to.present, to.mask + at, to.y + at);
    conv_put_four(high + to.high_bias, problem.epilogue, to.present - 4, to.mask + at + 4, to.y + at + 4);
}

#endif
