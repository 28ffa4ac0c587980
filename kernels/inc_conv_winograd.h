/* Winograd's minimal filtering F(4 x 4, 3 x 3) on blocks of channels (Lavin and Gray, CVPR 2016): tiles of 4 x 4 output
 * pixels and their 6 x 6 inputs are transformed, multiplied place by place, and transformed back. */
#ifndef INC_CONV_WINOGRAD_H
#define INC_CONV_WINOGRAD_H

#include "inc_conv.h"

#define CONV_TILE   4
#define CONV_REACH  (CONV_TILE + 2)
#define CONV_PLACES (CONV_REACH * CONV_REACH)

/* Distance from one place to the next: chosen so that the places of a tile do not all fall on one set of a cache. */
#define CONV_APART(floats) ((floats) + NET_BLOCK)

/* One dimension of the transforms: o = B^T i and o = A^T i. */
static inline void conv_in_1d(const conv_v *i, conv_v *o)
{
    const conv_v t0 = fma((conv_v)(-4.0f), i[2], i[4]), t1 = fma((conv_v)(-4.0f), i[1], i[3]);
    const conv_v t2 = i[4] - i[2], t3 = (i[3] - i[1]) * 2.0f;
    o[0] = fma((conv_v)(4.0f), i[0], fma((conv_v)(-5.0f), i[2], i[4]));
    o[1] = t0 + t1;
    o[2] = t0 - t1;
    o[3] = t2 + t3;
    o[4] = t2 - t3;
    o[5] = fma((conv_v)(4.0f), i[1], fma((conv_v)(-5.0f), i[3], i[5]));
}

static inline void conv_out_1d(const conv_v *i, conv_v *o)
{
    const conv_v s = i[1] + i[2], d = i[1] - i[2], u = i[3] + i[4], v = i[3] - i[4];
    o[0] = i[0] + s + u;
    o[1] = fma((conv_v)(2.0f), v, d);
    o[2] = fma((conv_v)(4.0f), u, s);
    o[3] = fma((conv_v)(8.0f), v, d) + i[5];
}

/* Values transformed down their columns to values transformed across their rows, to places `pitch` floats apart. */
static inline void conv_tile_across(conv_v down[CONV_REACH][CONV_REACH], CONV_MEM float *restrict to, size_t pitch)
{
#pragma unroll
    for (int r = 0; r < CONV_REACH; ++r) {
        conv_v o[CONV_REACH];
        conv_in_1d(down[r], o);
#pragma unroll
        for (int c = 0; c < CONV_REACH; ++c)
            CONV_STORE_IN(CONV_MEM, o[c], to + (r * CONV_REACH + c) * pitch);
    }
}

/* The inputs at x (top left), rows x_row floats apart, to places `pitch` floats apart. */
static inline void conv_tile_in(__global const float *restrict x, size_t x_row, CONV_MEM float *restrict to,
                                size_t pitch)
{
    conv_v down[CONV_REACH][CONV_REACH];
#pragma unroll
    for (int c = 0; c < CONV_REACH; ++c) {
        conv_v i[CONV_REACH], o[CONV_REACH];
#pragma unroll
        for (int r = 0; r < CONV_REACH; ++r)
            i[r] = CONV_LOAD(x + r * x_row + c * NET_BLOCK);
        conv_in_1d(i, o);
#pragma unroll
        for (int r = 0; r < CONV_REACH; ++r)
            down[r][c] = o[r];
    }
    conv_tile_across(down, to, pitch);
}

/* The products at `from` back to m x m sums. */
static inline void conv_tile_out(CONV_MEM const float *restrict from, size_t pitch, conv_v bias,
                                 conv_v out[CONV_TILE][CONV_TILE])
{
    conv_v down[CONV_TILE][CONV_REACH];
#pragma unroll
    for (int c = 0; c < CONV_REACH; ++c) {
        conv_v i[CONV_REACH], o[CONV_TILE];
#pragma unroll
        for (int r = 0; r < CONV_REACH; ++r)
            i[r] = CONV_LOAD(from + (r * CONV_REACH + c) * pitch);
        conv_out_1d(i, o);
#pragma unroll
        for (int r = 0; r < CONV_TILE; ++r)
            down[r][c] = o[r];
    }
#pragma unroll
    for (int r = 0; r < CONV_TILE; ++r) {
        conv_out_1d(down[r], out[r]);
#pragma unroll
        for (int c = 0; c < CONV_TILE; ++c)
            out[r][c] += bias;
    }
}

/* An image's tiles, and the floats of a row and of a plane with their halo; the same of an image of half its size. */
typedef struct conv_grid {
    int tiles;
    size_t row, plane, half_row, half_plane;
} conv_grid;

static inline conv_grid conv_grid_of(int rows, int cols)
{
    conv_grid grid;
    grid.tiles = (cols + CONV_TILE - 1) / CONV_TILE * ((rows + CONV_TILE - 1) / CONV_TILE);
    grid.row = (size_t)(cols + 2) * NET_BLOCK;
    grid.plane = (rows + 2) * grid.row;
    grid.half_row = (size_t)(cols / 2 + 2) * NET_BLOCK;
    grid.half_plane = (rows / 2 + 2) * grid.half_row;
    return grid;
}

/* A tile: its first output pixel, moved back at the far edges, and how many of its rows and columns earlier tiles have
 * done. */
typedef struct conv_place {
    int row, col, done_rows, done_cols;
} conv_place;

static inline conv_place conv_place_of(int tile, int rows, int cols)
{
    const int across = (cols + CONV_TILE - 1) / CONV_TILE;
    const int row = tile / across * CONV_TILE, col = tile % across * CONV_TILE;
    conv_place place = {min(row, rows - CONV_TILE), min(col, cols - CONV_TILE), 0, 0};
    place.done_rows = row - place.row;
    place.done_cols = col - place.col;
    return place;
}

/* The sums of a tile to y, and their 2 x 2 maxima to pooled (for even sizes). Pointers at the tile's first pixel. */
static inline void conv_tile_put(conv_v out[CONV_TILE][CONV_TILE], conv_place place, int flags, int activation,
                                 float slope, int present, __global const float *restrict mask,
                                 __global float *restrict y, size_t row_floats, __global float *restrict pooled,
                                 size_t pooled_row)
{
#pragma unroll
    for (int r = 0; r < CONV_TILE; ++r) {
        if (r < place.done_rows)
            continue;
#pragma unroll
        for (int c = 0; c < CONV_TILE; ++c)
            if (c >= place.done_cols)
                out[r][c] = conv_put(out[r][c], flags, activation, slope, present,
                                     mask + r * row_floats + c * NET_BLOCK, y + r * row_floats + c * NET_BLOCK);
        if (flags & HADA_CONV_POOLS && r % 2) {
#pragma unroll
            for (int c = 0; c < CONV_TILE; c += 2)
                if (c >= place.done_cols)
                    CONV_STORE(max(max(out[r - 1][c], out[r - 1][c + 1]), max(out[r][c], out[r][c + 1])),
                               pooled + r / 2 * pooled_row + c / 2 * NET_BLOCK);
        }
    }
}

#endif
