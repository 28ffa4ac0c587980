/* Winograd's tiles of 4 x 4 where the input is a tensor of half the size, doubled bilinearly (net_resize.cl, its rule
 * HADA_RESIZE_HALF): the 6 x 6 pixels of a tile are computed from 4 x 4 and never written. The arithmetic is that of
 * net_resize_linear, so the bits are those of resizing first. */
#ifndef INC_CONV_DOUBLED_H
#define INC_CONV_DOUBLED_H

#include "inc_conv_winograd.h"

/* How far pixels at odd and at even places are from the input value before them, on an axis of so many `values`. */
typedef struct conv_parts {
    float near, far;
} conv_parts;

static inline conv_parts conv_parts_of(int values)
{
    const float unit = 1.0f / (4 * values);
    conv_parts parts = {values * unit, 3 * values * unit};
    return parts;
}

/* Six values of an axis, the first at an odd place, from four. */
static inline void conv_double_1d(const conv_v *i, conv_parts parts, conv_v *o)
{
#pragma unroll
    for (int k = 0; k < 3; ++k) {
        const conv_v step = i[k + 1] - i[k];
        o[2 * k] = fma((conv_v)(parts.near), step, i[k]);
        o[2 * k + 1] = fma((conv_v)(parts.far), step, i[k]);
    }
}

/* As conv_tile_in, of the tile at `place` of rows x cols pixels, both even; x: the plane at half the size, halo and
 * all. */
static inline void conv_tile_in_doubled(__global const float *restrict x, conv_place place, int rows, int cols,
                                        CONV_MEM float *restrict to, size_t pitch)
{
    const int half_rows = rows / 2, half_cols = cols / 2, x_row = (half_cols + 2) * NET_BLOCK;
    const conv_parts down_parts = conv_parts_of(half_rows), across_parts = conv_parts_of(half_cols);
    const int first = place.row == 0, last = place.row + CONV_TILE == rows;
    const conv_v zero = (conv_v)(0.0f);
    conv_v down[CONV_REACH][CONV_REACH];
    x += NET_BLOCK + x_row;
#pragma unroll
    for (int k = 0; k < 3; ++k) {
        conv_v left[4], step[4];
#pragma unroll
        for (int r = 0; r < 4; ++r) { /* outside values are those of the edge */
            __global const float *line = x + clamp(place.row / 2 - 1 + r, 0, half_rows - 1) * x_row;
            left[r] = CONV_LOAD(line + clamp(place.col / 2 - 1 + k, 0, half_cols - 1) * NET_BLOCK);
            step[r] = CONV_LOAD(line + clamp(place.col / 2 + k, 0, half_cols - 1) * NET_BLOCK) - left[r];
        }
#pragma unroll
        for (int c = 2 * k; c < 2 * k + 2; ++c) {
            conv_v i[4], doubled[CONV_REACH], o[CONV_REACH];
#pragma unroll
            for (int r = 0; r < 4; ++r)
                i[r] = fma((conv_v)(c % 2 ? across_parts.far : across_parts.near), step[r], left[r]);
            conv_double_1d(i, down_parts, doubled);
            doubled[0] = first ? zero : doubled[0]; /* the convolution's padding */
            doubled[CONV_REACH - 1] = last ? zero : doubled[CONV_REACH - 1];
            conv_in_1d(doubled, o);
            const int outside = (c == 0 && place.col == 0) || (c == CONV_REACH - 1 && place.col + CONV_TILE == cols);
#pragma unroll
            for (int r = 0; r < CONV_REACH; ++r)
                down[r][c] = outside ? zero : o[r];
        }
    }
    conv_tile_across(down, to, pitch);
}

#endif
