/* Gradients of weights by partial sums, for work-groups: arguments and partial sums as in conv_weights.cl. 64
 * work-items take 32 coarse times 32 fine channels of one kernel place: 16 pixels of a row at a time go to local
 * memory, each work-item adds to its 4 x 4 sums. Dimensions: 64 times groups of fine channels times kernel places,
 * groups of coarse channels, parts. */
#include "inc_conv.h"

#define CONV_SLICE 16
#define CONV_FOURS (HADA_CONV_GRADIENT_LANES / 4)

/* Four channels of a pixel, 128 bits, or zeros. */
static inline float4 conv_four(__global const float *p, int here)
{
    return here ? *(__global const float4 *)p : (float4)(0.0f);
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
    __local float4 a[CONV_SLICE][CONV_FOURS], b[CONV_SLICE][CONV_FOURS];
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
#pragma unroll
    for (int i = 0; i < 4; ++i)
        sums[i] = (float4)(0.0f);
    for (int strip = first; strip < end; ++strip) {
        const int image = strip / strips, row_begin = strip % strips * strip_rows;
        const int row_end = min(row_begin + strip_rows, coarse_rows);
        float4 strip_sums[4];
#pragma unroll
        for (int i = 0; i < 4; ++i)
            strip_sums[i] = (float4)(0.0f);
        for (int row = row_begin; row < row_end; ++row)
            for (int col = 0; col < coarse_cols; col += CONV_SLICE) {
                const int c = col + pixel, inside = c < coarse_cols;
                __global const float *from_coarse =
                    coarse + image * coarse_image + (size_t)(row + 1) * coarse_row + (c + 1) * NET_BLOCK;
                __global const float *from_fine =
                    fine + image * fine_image + (size_t)(row * stride + place / kernel_cols - pad_rows + 1) * fine_row +
                    (c * stride + place % kernel_cols - pad_cols + 1) * NET_BLOCK;
                barrier(CLK_LOCAL_MEM_FENCE);
#pragma unroll
                for (int half_eight = 0; half_eight < 2; ++half_eight) {
                    a[pixel][eight / 4 + half_eight] = conv_four(from_coarse + 4 * half_eight, coarse_here && inside);
                    b[pixel][eight / 4 + half_eight] = conv_four(from_fine + 4 * half_eight, fine_here && inside);
                }
                barrier(CLK_LOCAL_MEM_FENCE);
#pragma unroll
                for (int p = 0; p < CONV_SLICE; ++p) {
                    const float4 u = a[p][tx], v = b[p][ty];
                    strip_sums[0] = fma((float4)(v.x), u, strip_sums[0]);
                    strip_sums[1] = fma((float4)(v.y), u, strip_sums[1]);
                    strip_sums[2] = fma((float4)(v.z), u, strip_sums[2]);
                    strip_sums[3] = fma((float4)(v.w), u, strip_sums[3]);
                }
            }
#pragma unroll
        for (int i = 0; i < 4; ++i)
            sums[i] += strip_sums[i];
    }
    const int my_lane = get_global_id(1) * HADA_CONV_GRADIENT_LANES + tx * 4;
    partial += (((size_t)part * get_global_size(1) * HADA_CONV_GRADIENT_LANES + my_lane / NET_BLOCK * NET_BLOCK) *
                    fine_filled +
                (fine_group * HADA_CONV_GRADIENT_LANES + ty * 4) * NET_BLOCK) *
                   places +
               place * NET_BLOCK + my_lane % NET_BLOCK;
#pragma unroll
    for (int i = 0; i < 4; ++i)
        *(__global float4 *)(partial + i * places * NET_BLOCK) = sums[i];
}
