/* A scene that moves as a whole (docs/explanation/refinement.md): images at another place, and cells of planes by which
 * is found how far. Images: [image][rows][cols] floats. */
#ifndef MOVE_WIDTH
#define MOVE_WIDTH 8
#endif
#ifndef MOVE_GROUP
#define MOVE_GROUP 1
#endif

#define WIDE_WIDTH MOVE_WIDTH
#include "inc_wide.h"
#include "shared_refine.h"

/* out[image](i, j) = sum over a, b of down[a] across[b] in[image](i + row + a, j + col + b), of images that are
 * continued by their borders; at least `least`. Dimensions: work-items of a group, rows, images. */
__kernel __attribute__((reqd_work_group_size(MOVE_GROUP, 1, 1))) void
refine_move_images(__global const float *in, __global float *out, hada_refine_move move)
{
    const int rows = move.rows, cols = move.cols, row = get_global_id(1);
    const size_t first = get_global_id(2) * (size_t)rows * (size_t)cols;
    __global const float *image = in + first;
    __global float *to = out + first + (size_t)row * cols;
    for (int col = get_local_id(0) * MOVE_WIDTH; col < cols; col += MOVE_GROUP * MOVE_WIDTH) {
        const int from = col + move.col;
        if (from >= 0 && from + HADA_REFINE_MOVE_TAPS + MOVE_WIDTH <= cols && col + MOVE_WIDTH <= cols) {
            wide_real sum = (wide_real)0.0f;
            for (int a = 0; a < HADA_REFINE_MOVE_TAPS; ++a) {
                __global const float *line = image + (size_t)clamp(row + move.row + a, 0, rows - 1) * cols + from;
                wide_real along = (wide_real)0.0f;
                for (int b = 0; b < HADA_REFINE_MOVE_TAPS; ++b)
                    along = fma((wide_real)move.across[b], wide_get(line + b), along);
                sum = fma((wide_real)move.down[a], along, sum);
            }
            wide_put(max(sum, move.least), to + col);
            continue;
        }
        for (int j = col; j < min(col + MOVE_WIDTH, cols); ++j) {
            float sum = 0.0f;
            for (int a = 0; a < HADA_REFINE_MOVE_TAPS; ++a) {
                __global const float *line = image + (size_t)clamp(row + move.row + a, 0, rows - 1) * cols;
                float along = 0.0f;
                for (int b = 0; b < HADA_REFINE_MOVE_TAPS; ++b)
                    along = fma(move.across[b], line[clamp(j + move.col + b, 0, cols - 1)], along);
                sum = fma(move.down[a], along, sum);
            }
            to[j] = max(sum, move.least);
        }
    }
}

/* cells[row][col]: sums over channels and over scale x scale pixels of a plane, [channel][rows][cols] floats; what is
 * left of rows and columns is left out. Dimensions: work-items of a group, rows of cells, planes. */
__kernel __attribute__((reqd_work_group_size(MOVE_GROUP, 1, 1))) void refine_move_cells(__global const float *planes,
                                                                                        __global float *cells,
                                                                                        uint first, int channels,
                                                                                        int rows, int cols, int scale)
{
    const int wide = cols / scale, i = get_global_id(1);
    const size_t area = (size_t)rows * (size_t)cols, plane = get_global_id(2);
    __global const float *from = planes + plane * channels * area + (size_t)i * scale * cols;
    __global float *to = cells + first + (plane * get_global_size(1) + i) * wide;
    for (int j = get_local_id(0); j < wide; j += MOVE_GROUP) {
        float sum = 0.0f;
        for (int c = 0; c < channels; ++c)
            for (int a = 0; a < scale; ++a)
                for (int b = 0; b < scale; ++b)
                    sum += from[c * area + (size_t)a * cols + j * scale + b];
        to[j] = sum;
    }
}

/* A plane's light at a pixel, of all channels, and a little of the light around it, which decides where it is dark. */
float move_light(__global const float *plane, int channels, int rows, int cols, int row, int col)
{
    float here = 0.0f, around = 0.0f;
    for (int c = 0; c < channels; ++c, plane += (size_t)rows * cols) {
        here += plane[(size_t)row * cols + col];
        for (int a = -2; a <= 2; ++a)
            for (int b = -2; b <= 2; ++b)
                around += plane[(size_t)clamp(row + a, 0, rows - 1) * cols + clamp(col + b, 0, cols - 1)];
    }
    return fma(HADA_REFINE_MOVE_AROUND, around, here);
}

/* Light that moved, where its depths did not: the light of all planes at a pixel is divided among them in proportion to
 * what they had there before. [depth][channel][rows][cols] floats. Dimensions: columns, rows. */
__kernel void refine_move_share(__global const float *before, __global float *planes, int depths, int channels,
                                int rows, int cols)
{
    const int col = get_global_id(0), row = get_global_id(1);
    const size_t area = (size_t)rows * cols, each = channels * area, at = (size_t)row * cols + col;
    float all = 1e-30f;
    if (col >= cols)
        return;
    for (int z = 0; z < depths; ++z)
        all += move_light(before + z * each, channels, rows, cols, row, col);
    for (int c = 0; c < channels; ++c) {
        float sum = 0.0f;
        for (int z = 0; z < depths; ++z)
            sum += planes[z * each + c * area + at];
        for (int z = 0; z < depths; ++z)
            planes[z * each + c * area + at] =
                sum * (move_light(before + z * each, channels, rows, cols, row, col) / all);
    }
}

/* out = a - part b, which may be the same values. Dimensions: numbers. */
__kernel void refine_move_rest(__global const float *a, __global const float *b, __global float *out, ulong a_at,
                               ulong b_at, ulong out_at, uint count, float part)
{
    const size_t i = get_global_id(0);
    if (i < count)
        out[out_at + i] = fma(-part, b[b_at + i], a[a_at + i]);
}
