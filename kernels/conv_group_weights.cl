/* Gradients of weights by partial sums, for work-groups: arguments and partial sums as in conv_weights.cl. 64
 * work-items take 32 coarse times 32 fine channels of one kernel place: 16 pixels of a row at a time go to local
 * memory, each work-item adds to its 4 x 4 sums. Dimensions: 64 times groups of fine channels times kernel places,
 * groups of coarse channels, parts. */
#include "inc_conv.h"

#define CONV_SLICE 16

/* Eight channels of a pixel, or zeros. */
static inline float8 conv_eight(__global const float *p, int here)
{
    return here ? vload8(0, p) : (float8)(0.0f);
}

__kernel __attribute__((reqd_work_group_size(HADA_CONV_GRADIENT_ITEMS, 1, 1))) void
conv_group_weights(__global const float *restrict coarse, __global const float *restrict fine,
                   __global float *restrict partial, hada_conv_correlation sizes)
{
    const int coarse_rows = sizes.coarse.rows, coarse_cols = sizes.coarse.cols;
    const int fine_rows = sizes.fine.rows, fine_cols = sizes.fine.cols;
    const int coarse_channels = sizes.coarse.channels, fine_channels = sizes.fine.channels;
    const int images = sizes.images, kernel_cols = sizes.kernel_cols, stride = sizes.stride;
    const int pad_rows = sizes.pad_rows, pad_cols = sizes.pad_cols;
    const int strip_rows = sizes.strip_rows, fine_groups = sizes.fine_groups;
    const ulong coarse_image = sizes.coarse.image, fine_image = sizes.fine.image;
    __local float a[CONV_SLICE][HADA_CONV_GRADIENT_LANES], b[CONV_SLICE][HADA_CONV_GRADIENT_LANES];
    const int item = get_local_id(0), tx = item % 8, ty = item / 8, pixel = item / 4, eight = item % 4 * 8;
    const int fine_group = get_group_id(0) % fine_groups, place = get_group_id(0) / fine_groups;
    const int places = get_num_groups(0) / fine_groups, part = get_global_id(2), parts = get_global_size(2);
    const int strips = (coarse_rows + strip_rows - 1) / strip_rows, first = part * (images * strips) / parts;
    const int end = (part + 1) * (images * strips) / parts, fine_filled = fine_groups * HADA_CONV_GRADIENT_LANES;
    const int coarse_row = (coarse_cols + 2) * NET_BLOCK, fine_row = (fine_cols + 2) * NET_BLOCK;
    const int my_coarse = get_global_id(1) * HADA_CONV_GRADIENT_LANES + eight,
              my_fine = fine_group * HADA_CONV_GRADIENT_LANES + eight;
    /* channels that fill up the last block are zero; beyond it there is nothing */
    const int coarse_here = my_coarse / NET_BLOCK * NET_BLOCK < coarse_channels;
    const int fine_here = my_fine / NET_BLOCK * NET_BLOCK < fine_channels;
    coarse +=
        sizes.coarse.offset + (size_t)(my_coarse / NET_BLOCK) * (coarse_rows + 2) * coarse_row + my_coarse % NET_BLOCK;
    fine += sizes.fine.offset + (size_t)(my_fine / NET_BLOCK) * (fine_rows + 2) * fine_row + my_fine % NET_BLOCK;

    float4 sums[4];
    for (int i = 0; i < 4; ++i)
        sums[i] = (float4)(0.0f);
    for (int strip = first; strip < end; ++strip) {
        const int image = strip / strips, row_begin = strip % strips * strip_rows;
        const int row_end = min(row_begin + strip_rows, coarse_rows);
        float4 strip_sums[4];
        for (int i = 0; i < 4; ++i)
            strip_sums[i] = (float4)(0.0f);
        for (int row = row_begin; row < row_end; ++row)
            for (int col = 0; col < coarse_cols; col += CONV_SLICE) {
                const int c = col + pixel, inside = c < coarse_cols;
                barrier(CLK_LOCAL_MEM_FENCE);
                vstore8(conv_eight(coarse + image * coarse_image + (size_t)(row + 1) * coarse_row + (c + 1) * NET_BLOCK,
                                   coarse_here && inside),
                        0, a[pixel] + eight);
                vstore8(conv_eight(fine + image * fine_image +
                                       (size_t)(row * stride + place / kernel_cols - pad_rows + 1) * fine_row +
                                       (c * stride + place % kernel_cols - pad_cols + 1) * NET_BLOCK,
                                   fine_here && inside),
                        0, b[pixel] + eight);
                barrier(CLK_LOCAL_MEM_FENCE);
                for (int p = 0; p < CONV_SLICE; ++p) {
                    const float4 u = vload4(0, a[p] + tx * 4);
                    for (int i = 0; i < 4; ++i)
                        strip_sums[i] = fma((float4)(b[p][ty * 4 + i]), u, strip_sums[i]);
                }
            }
        for (int i = 0; i < 4; ++i)
            sums[i] += strip_sums[i];
    }
    const int my_lane = get_global_id(1) * HADA_CONV_GRADIENT_LANES + tx * 4;
    partial += (((size_t)part * get_global_size(1) * HADA_CONV_GRADIENT_LANES + my_lane / NET_BLOCK * NET_BLOCK) *
                    fine_filled +
                (fine_group * HADA_CONV_GRADIENT_LANES + ty * 4) * NET_BLOCK) *
                   places +
               place * NET_BLOCK + my_lane % NET_BLOCK;
    for (int i = 0; i < 4; ++i)
        vstore4(sums[i], 0, partial + i * places * NET_BLOCK);
}
