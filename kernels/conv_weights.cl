/* Gradients of weights by partial sums: dw[a][b][u][v] = sum over images and pixels of coarse[a][r][c] times
 * fine[b][stride r + u - pad][stride c + v - pad]. The rows of all images are cut into strips, the strips shared out to
 * `parts` partial sums; conv_reduce.cl adds those in order. Reads stay within the halo of one. Shape lanes.
 *
 * A work-item takes CONV_BLOCKS blocks of coarse channels, CONV_FINE fine channels, CONV_COLS neighbouring places of
 * CONV_ROWS kernel rows (more than one: all of them): partial[part][coarse block][fine][u][v][coarse], channels filled
 * up to whole tiles. Dimensions: kernel places over CONV_ROWS * CONV_COLS times groups of fine channels, groups of
 * coarse blocks, parts. */
#include "inc_conv.h"

#ifndef CONV_BLOCKS
#define CONV_BLOCKS 2
#endif
#ifndef CONV_FINE
#define CONV_FINE 2
#endif
#ifndef CONV_COLS
#define CONV_COLS 3
#endif
#ifndef CONV_ROWS
#define CONV_ROWS 1
#endif

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void conv_weights(__global const float *restrict coarse,
                                                                          __global const float *restrict fine,
                                                                          __global float *restrict partial,
                                                                          hada_conv_correlation sizes)
{
    const int coarse_rows = sizes.coarse.rows, coarse_cols = sizes.coarse.cols;
    const int fine_rows = sizes.fine.rows, fine_cols = sizes.fine.cols;
    const int images = sizes.images, kernel_cols = sizes.kernel_cols, stride = sizes.stride;
    const int pad_rows = sizes.pad_rows, pad_cols = sizes.pad_cols;
    const int strip_rows = sizes.strip_rows, fine_groups = sizes.fine_groups;
    const ulong coarse_image = sizes.coarse.image, fine_image = sizes.fine.image;
    const int fine_group = get_global_id(0) % fine_groups;
    const int place = get_global_id(0) / fine_groups * CONV_ROWS * CONV_COLS;
    const int group = get_global_id(1), part = get_global_id(2), parts = get_global_size(2);
    const int places = get_global_size(0) / fine_groups * CONV_ROWS * CONV_COLS;
    const int coarse_row = (coarse_cols + 2) * NET_BLOCK, fine_row = (fine_cols + 2) * NET_BLOCK;
    const size_t coarse_plane = (size_t)(coarse_rows + 2) * coarse_row, fine_plane = (size_t)(fine_rows + 2) * fine_row;
    const int strips = (coarse_rows + strip_rows - 1) / strip_rows, first_fine = fine_group * CONV_FINE;
    const int end = (part + 1) * (images * strips) / parts;
    const size_t block_floats = (size_t)fine_groups * CONV_FINE * places * NET_BLOCK;
    coarse += sizes.coarse.offset + group * CONV_BLOCKS * coarse_plane + coarse_row + NET_BLOCK;
    fine += sizes.fine.offset + first_fine / NET_BLOCK * fine_plane + first_fine % NET_BLOCK +
            (place / kernel_cols - pad_rows + 1) * fine_row + (place % kernel_cols - pad_cols + 1) * NET_BLOCK;
    partial += ((size_t)part * get_global_size(1) + group) * CONV_BLOCKS * block_floats +
               ((size_t)first_fine * places + place) * NET_BLOCK;

    int first = 1;
    for (int strip = part * (images * strips) / parts; strip < end; ++strip, first = 0) {
        const int image = strip / strips, row_begin = strip % strips * strip_rows;
        const int row_end = min(row_begin + strip_rows, coarse_rows);
        conv_v sums[CONV_BLOCKS][CONV_ROWS * CONV_COLS][CONV_FINE];
#pragma unroll
        for (int o = 0; o < CONV_BLOCKS; ++o)
#pragma unroll
            for (int k = 0; k < CONV_ROWS * CONV_COLS; ++k)
#pragma unroll
                for (int i = 0; i < CONV_FINE; ++i)
                    sums[o][k][i] = (conv_v)(0.0f);
        for (int row = row_begin; row < row_end; ++row) {
            __global const float *restrict cp = coarse + image * coarse_image + (size_t)row * coarse_row;
            __global const float *restrict fp = fine + image * fine_image + (size_t)row * stride * fine_row;
#pragma nounroll
            for (int col = 0; col < coarse_cols; ++col) {
                conv_v c[CONV_BLOCKS];
#pragma unroll
                for (int o = 0; o < CONV_BLOCKS; ++o)
                    c[o] = CONV_LOAD(cp + o * coarse_plane + col * NET_BLOCK);
#pragma unroll
                for (int k = 0; k < CONV_ROWS * CONV_COLS; ++k)
#pragma unroll
                    for (int i = 0; i < CONV_FINE; ++i) {
                        const conv_v f =
                            (conv_v)(fp[k / CONV_COLS * fine_row + (col * stride + k % CONV_COLS) * NET_BLOCK + i]);
#pragma unroll
                        for (int o = 0; o < CONV_BLOCKS; ++o)
                            sums[o][k][i] = fma(f, c[o], sums[o][k][i]);
                    }
            }
        }
#pragma unroll
        for (int o = 0; o < CONV_BLOCKS; ++o)
#pragma unroll
            for (int i = 0; i < CONV_FINE; ++i)
#pragma unroll
                for (int k = 0; k < CONV_ROWS * CONV_COLS; ++k) {
                    __global float *restrict to = partial + o * block_floats + (i * places + k) * NET_BLOCK;
                    CONV_STORE(first ? sums[o][k][i] : CONV_LOAD(to) + sums[o][k][i], to);
                }
    }
}
