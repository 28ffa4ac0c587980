/* Shrinkage of cosine transforms of overlapping blocks, an image model that continues beyond edges (L. Yaroslavsky
 * 1996; O. Guleryuz, IEEE TIP 16(12), 2007). Channels are separated into brightness and colours by a cosine transform
 * over them. Blocks of 8 x 8 pixels begin at every second row and column; every coefficient T of a block but the mean
 * becomes T max(0, 1 - t^2 / T^2), the non-negative garrote (H.-Y. Gao, 1998), t the threshold of its channel; a pixel
 * is the mean of the 16 blocks that contain it. Beyond an image its edge is repeated.
 *
 * A work-group makes a tile: vertical transforms of its columns once for each row of blocks, then along rows, shrunk,
 * back along rows and added up; blocks share columns, so vertical transforms go back once, too. Tiles do not wait for
 * each other: blocks across their borders are computed on both sides, in the same order. Images: [channel][rows][cols].
 */
#include "inc_dct.h"
#include "shared_refine.h"

/* Pixels of a tile, even. */
#ifndef DCT_TILE_ROWS
#define DCT_TILE_ROWS 16
#endif
#ifndef DCT_TILE_COLS
#define DCT_TILE_COLS 64
#endif

/* Blocks begin so far before a tile, and there are so many down it. */
#define DCT_BEFORE     6
#define DCT_BLOCK_ROWS ((DCT_TILE_ROWS + DCT_BEFORE) / 2)
/* What the blocks that reach into a tile see of the image. */
#define DCT_SEEN_ROWS (DCT_TILE_ROWS + 2 * DCT_BEFORE)
#define DCT_SEEN_COLS (DCT_TILE_COLS + 2 * DCT_BEFORE)
/* A pixel is in 16 blocks. */
#define DCT_SHARE 0.0625f

/* Vectors of a work-item, for which the basis is computed once. */
#define DCT_RUN (DCT_GROUP == 1 ? HADA_REFINE_DCT_RUN / WIDE_WIDTH : 1)

/* Channels to brightness and colours (back 0), or from them to non-negative channels, with the rows of an orthonormal
 * cosine transform. first: where the image that is read begins. Dimensions: runs of WIDE_WIDTH x DCT_RUN pixels. */
__kernel void refine_dct_colours(__global const float *from, uint first, __global float *out, hada_refine_window window,
                                 int back)
{
    const int area = window.rows * window.cols, channels = window.channels;
    const int i = get_global_id(0) * WIDE_WIDTH * DCT_RUN;
    if (i >= area)
        return;
    for (int k = 0; k < channels; ++k) {
        dct_real sum[DCT_RUN];
        for (int j = 0; j < DCT_RUN; ++j)
            sum[j] = (dct_real)0.0f;
        for (int c = 0; c < channels; ++c) {
            const float weight = dct_basis(back ? c : k, back ? k : c, channels);
            __global const float *in = from + first + (size_t)c * area;
            for (int j = 0; j < DCT_RUN; ++j)
                sum[j] =
                    fma((dct_real)weight, wide_get_some(in + i + j * WIDE_WIDTH, area - i - j * WIDE_WIDTH), sum[j]);
        }
        for (int j = 0; j < DCT_RUN; ++j)
            wide_put_some(back ? max(sum[j], 0.0f) : sum[j], out + (size_t)k * area + i + j * WIDE_WIDTH,
                          area - i - j * WIDE_WIDTH);
    }
}

#if DCT_GROUP == 1
/* Columns of a tile in pairs: even ones and odd ones apart, so that neighbouring blocks are neighbouring lanes. So many
 * blocks side by side are made, in whole vectors, and so many pairs are seen for them; blocks and pairs beyond those
 * that reach into the tile hold anything. */
#define DCT_BLOCKS (DCT_TILE_COLS / 2 + 8)
#define DCT_PAIRS  (DCT_BLOCKS + 8)

/* The rows of an image that a tile's blocks see, pairs of columns apart. */
DCT_INLINE void dct_see(__global const float *image, hada_refine_window window, int row0, int col0,
                        float seen[DCT_SEEN_ROWS][2 * DCT_PAIRS])
{
    const int inside = col0 >= 0 && col0 + 2 * DCT_PAIRS <= window.cols;
    for (int i = 0; i < DCT_SEEN_ROWS; ++i) {
        __global const float *row = image + (size_t)clamp(row0 + i, 0, window.rows - 1) * window.cols;
        if (inside)
            for (int j = 0; j < DCT_PAIRS; j += 8) {
                const float16 v = vload16(0, row + col0 + 2 * j);
                VECTORS_STORE8(__private, v.even, seen[i] + j);
                VECTORS_STORE8(__private, v.odd, seen[i] + DCT_PAIRS + j);
            }
        else
            for (int j = 0; j < 2 * DCT_PAIRS; ++j)
                seen[i][j % 2 * DCT_PAIRS + j / 2] = row[clamp(col0 + j, 0, window.cols - 1)];
    }
}

/* A row of transformed columns becomes that of shrunk blocks, added up. mean: it holds the means of blocks. part: of
 * each place in a block, the values of all blocks, behind eight of 0. */
DCT_INLINE void dct_shrink_row(const float *given, float *shrunk, float part[8][DCT_PAIRS], int mean, float t)
{
    dct_real v[8];
    for (int j = 0; j < DCT_BLOCKS; j += 8) {
        for (int m = 0; m < 8; ++m)
            v[m] = vload8(0, given + m % 2 * DCT_PAIRS + j + m / 2);
        dct_forward(v);
        for (int m = 0; m < 8; ++m)
            v[m] = m || !mean ? dct_garrote(v[m], t) : v[m];
        dct_inverse(v);
        for (int m = 0; m < 8; ++m)
            VECTORS_STORE8(__private, v[m], part[m] + 8 + j);
    }
    for (int j = 0; j < DCT_BLOCKS; j += 8)
        for (int odd = 0; odd < 2; ++odd) {
            dct_real sum = vload8(0, part[odd] + 8 + j);
            for (int m = 1; m < 4; ++m)
                sum += vload8(0, part[odd + 2 * m] + 8 + j - m);
            VECTORS_STORE8(__private, sum, shrunk + odd * DCT_BLOCKS + j);
        }
}

#else
#define DCT_BLOCK_COLS ((DCT_TILE_COLS + DCT_BEFORE) / 2)
/* Odd, so that items of neighbouring rows meet different banks. */
#define DCT_STRIDE     (DCT_SEEN_COLS | 1)

#endif

/* From the first image of `planes` to the second. Dimensions: tiles, channels. */
__kernel __attribute__((reqd_work_group_size(DCT_GROUP, 1, 1))) void
refine_dct_shrink(__global float *planes, hada_refine_window window, float threshold, float colour)
{
    __global const float *in = planes;
    __global float *out = planes + (size_t)window.channels * window.rows * window.cols;
    const int across = (window.cols + DCT_TILE_COLS - 1) / DCT_TILE_COLS, tile = get_group_id(0);
    const int row0 = tile / across * DCT_TILE_ROWS, col0 = tile % across * DCT_TILE_COLS;
    const int channel = get_global_id(1);
    const size_t plane = (size_t)channel * window.rows * window.cols;
    const float t = channel ? threshold * colour : threshold;
#if DCT_GROUP == 1
    float seen[DCT_SEEN_ROWS][2 * DCT_PAIRS], sum[DCT_SEEN_ROWS][2 * DCT_BLOCKS];
    float given[8][2 * DCT_PAIRS], shrunk[8][2 * DCT_BLOCKS], part[8][DCT_PAIRS];
    dct_real v[8];
    dct_see(in + plane, window, row0 - DCT_BEFORE, col0 - DCT_BEFORE, seen);
    for (int i = 0; i < DCT_SEEN_ROWS; ++i)
        for (int j = 0; j < 2 * DCT_BLOCKS; j += 8)
            VECTORS_STORE8(__private, (dct_real)0.0f, sum[i] + j);
    for (int m = 0; m < 8; ++m)
        VECTORS_STORE8(__private, (dct_real)0.0f, part[m]);
    for (int r = 0; r < DCT_BLOCK_ROWS; ++r) {
        for (int j = 0; j < 2 * DCT_PAIRS; j += 8) {
            for (int k = 0; k < 8; ++k)
                v[k] = vload8(0, seen[2 * r + k] + j);
            dct_forward(v);
            for (int k = 0; k < 8; ++k)
                VECTORS_STORE8(__private, v[k], given[k] + j);
        }
        for (int k = 0; k < 8; ++k)
            dct_shrink_row(given[k], shrunk[k], part, !k, t);
        for (int j = 0; j < 2 * DCT_BLOCKS; j += 8) {
            for (int k = 0; k < 8; ++k)
                v[k] = vload8(0, shrunk[k] + j);
            dct_inverse(v);
            for (int k = 0; k < 8; ++k)
                VECTORS_STORE8(__private, vload8(0, sum[2 * r + k] + j) + v[k], sum[2 * r + k] + j);
        }
    }
    for (int i = row0; i < min(row0 + DCT_TILE_ROWS, window.rows); ++i)
        for (int j = col0; j < min(col0 + DCT_TILE_COLS, window.cols); ++j) {
            const int at = j - col0 + DCT_BEFORE;
            out[plane + (size_t)i * window.cols + j] =
                DCT_SHARE * sum[i - row0 + DCT_BEFORE][at % 2 * DCT_BLOCKS + at / 2];
        }
#else
    __local float part[DCT_BLOCK_ROWS * 8][DCT_STRIDE];
    const int item = get_local_id(0);
    for (int i = item; i < DCT_BLOCK_ROWS * DCT_SEEN_COLS; i += DCT_GROUP) {
        const int r = i / DCT_SEEN_COLS, j = i % DCT_SEEN_COLS;
        __global const float *column = in + plane + clamp(col0 - DCT_BEFORE + j, 0, window.cols - 1);
        float v[8];
        for (int k = 0; k < 8; ++k)
            v[k] = column[(size_t)clamp(row0 - DCT_BEFORE + 2 * r + k, 0, window.rows - 1) * window.cols];
        dct_forward(v);
        for (int k = 0; k < 8; ++k)
            part[8 * r + k][j] = v[k];
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    /* an item goes along a row, block after block; what no later block reaches takes the place of what was seen */
    for (int i = item; i < DCT_BLOCK_ROWS * 8; i += DCT_GROUP) {
        __local float *row = part[i];
        float seen[8], sum[8];
        for (int m = 0; m < 6; ++m)
            seen[m + 2] = row[m];
        for (int m = 0; m < 8; ++m)
            sum[m] = 0.0f;
        for (int j = 0; j < DCT_BLOCK_COLS; ++j) {
            float v[8];
            for (int m = 0; m < 6; ++m)
                seen[m] = seen[m + 2];
            seen[6] = row[2 * j + 6];
            seen[7] = row[2 * j + 7];
            for (int m = 0; m < 8; ++m)
                v[m] = seen[m];
            dct_forward(v);
            for (int m = 0; m < 8; ++m)
                v[m] = i % 8 + m ? dct_garrote(v[m], t) : v[m];
            dct_inverse(v);
            for (int m = 0; m < 8; ++m)
                sum[m] += v[m];
            row[2 * j] = sum[0];
            row[2 * j + 1] = sum[1];
            for (int m = 0; m < 6; ++m)
                sum[m] = sum[m + 2];
            sum[6] = sum[7] = 0.0f;
        }
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int i = item; i < DCT_TILE_ROWS * DCT_TILE_COLS; i += DCT_GROUP) {
        const int y = i / DCT_TILE_COLS, x = i % DCT_TILE_COLS;
        float sum = 0.0f;
        /* the four rows of blocks that contain it */
        for (int r = y / 2; r < y / 2 + 4; ++r)
            for (int k = 0; k < 8; ++k)
                sum = fma(dct_basis(k, y + DCT_BEFORE - 2 * r, 8), part[8 * r + k][x + DCT_BEFORE], sum);
        if (row0 + y < window.rows && col0 + x < window.cols)
            out[plane + (size_t)(row0 + y) * window.cols + col0 + x] = DCT_SHARE * sum;
    }
#endif
}
