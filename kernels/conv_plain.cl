/* Convolutions of any size, by their definition, with tests at the edges: what serves where nothing faster does.
 * Weights as w[coarse][fine][kernel row][kernel column]; coarse pixel r and kernel place u meet fine pixel stride * r +
 * u - pad. */
#include "inc_conv.h"

/* One work-item takes one pixel of one block of output channels. Dimensions: columns, rows, blocks times images. */
__kernel void conv_plain(__global const float *x, ulong x_offset, ulong x_image, int in_channels, int in_rows,
                         int in_cols, __global const float *w, __global const float *bias, ulong bias_offset,
                         __global float *y, ulong y_offset, ulong y_image, int out_channels, int out_rows, int out_cols,
                         int to_coarse, int kernel_rows, int kernel_cols, int pad_rows, int pad_cols, int stride,
                         int flags, int activation, float slope, __global const float *mask, ulong mask_offset,
                         ulong mask_image)
{
    const int col = get_global_id(0), row = get_global_id(1);
    const int blocks = (out_channels + NET_BLOCK - 1) / NET_BLOCK, block = get_global_id(2) % blocks;
    const int image = get_global_id(2) / blocks, places = kernel_rows * kernel_cols;
    if (col >= out_cols)
        return;
    const size_t at = (((size_t)block * (out_rows + 2) + row + 1) * (out_cols + 2) + col + 1) * NET_BLOCK;
    y += y_offset + image * y_image + at;
    for (int k = 0; k < NET_BLOCK; ++k) {
        const int out = block * NET_BLOCK + k;
        float sum = 0.0f;
        for (int in = 0; in < in_channels && out < out_channels; ++in) {
            __global const float *wk =
                w + (to_coarse ? (size_t)out * in_channels + in : (size_t)in * out_channels + out) * places;
            __global const float *plane = x + x_offset + image * x_image +
                                          (size_t)(in / NET_BLOCK) * (in_rows + 2) * (in_cols + 2) * NET_BLOCK +
                                          in % NET_BLOCK;
            for (int u = 0; u < kernel_rows; ++u)
                for (int v = 0; v < kernel_cols; ++v) {
                    /* to_fine: only where the stride divides */
                    const int r = to_coarse ? row * stride + u - pad_rows : row + pad_rows - u;
                    const int c = to_coarse ? col * stride + v - pad_cols : col + pad_cols - v;
                    const int div = to_coarse ? 1 : stride;
                    if (r >= 0 && c >= 0 && r % div == 0 && c % div == 0 && r / div < in_rows && c / div < in_cols)
                        sum = fma(wk[u * kernel_cols + v],
                                  plane[((size_t)(r / div + 1) * (in_cols + 2) + c / div + 1) * NET_BLOCK], sum);
                }
        }
        if (flags & CONV_HAS_BIAS && out < out_channels)
            sum += bias[bias_offset + out];
        if (activation == CONV_SIGMOID)
            sum = 1.0f / (1.0f + exp(-sum));
        else if (activation != CONV_NONE && sum < 0.0f)
            sum = activation == CONV_RELU ? 0.0f : sum * slope;
        if (flags & CONV_HAS_MASK && !(mask[mask_offset + image * mask_image + at + k] > 0.0f))
            sum = 0.0f;
        if (flags & CONV_ACCUMULATES)
            sum += y[k];
        y[k] = out < out_channels ? sum : 0.0f;
    }
}

/* One work-item takes one weight's gradient: the sum over images and pixels of coarse times fine, row by row.
 * Dimensions: fine channels times places of the kernel, coarse channels. */
__kernel void conv_plain_weights(__global const float *coarse, ulong coarse_offset, ulong coarse_image, int coarse_rows,
                                 int coarse_cols, __global const float *fine, ulong fine_offset, ulong fine_image,
                                 int fine_channels, int fine_rows, int fine_cols, int images, int places,
                                 int kernel_cols, int pad_rows, int pad_cols, int stride, __global float *dw,
                                 ulong dw_offset, int accumulate)
{
    const int b = get_global_id(0) / places, place = get_global_id(0) % places, a = get_global_id(1);
    if (b >= fine_channels)
        return;
    const int u = place / kernel_cols - pad_rows, v = place % kernel_cols - pad_cols;
    coarse +=
        coarse_offset + (size_t)(a / NET_BLOCK) * (coarse_rows + 2) * (coarse_cols + 2) * NET_BLOCK + a % NET_BLOCK;
    fine += fine_offset + (size_t)(b / NET_BLOCK) * (fine_rows + 2) * (fine_cols + 2) * NET_BLOCK + b % NET_BLOCK;
    float sum = 0.0f;
    for (int image = 0; image < images; ++image)
        for (int r = 0; r < coarse_rows; ++r) {
            const int row = r * stride + u;
            float row_sum = 0.0f;
            for (int c = 0; c < coarse_cols && row >= 0 && row < fine_rows; ++c) {
                const int col = c * stride + v;
                if (col >= 0 && col < fine_cols)
                    row_sum =
                        fma(coarse[image * coarse_image + ((size_t)(r + 1) * (coarse_cols + 2) + c + 1) * NET_BLOCK],
                            fine[image * fine_image + ((size_t)(row + 1) * (fine_cols + 2) + col + 1) * NET_BLOCK],
                            row_sum);
            }
            sum += row_sum;
        }
    const size_t to = dw_offset + ((size_t)a * fine_channels + b) * places + place;
    dw[to] = accumulate ? dw[to] + sum : sum;
}
