/* Convolutions of any size, by their definition, with tests at the edges: used where no faster kernel applies. Weights:
 * w[coarse][fine][kernel row][kernel column]; coarse pixel r and kernel place u meet fine pixel stride * r + u - pad.
 * Tensors in blocks of channels (lib/net/tensor.h). */
#include "inc_conv.h"

/* One work-item takes one pixel of one block of output channels. Dimensions: columns, rows, blocks times images. */
__kernel void conv_plain(__global const float *x, __global const float *w, __global const float *bias,
                         __global float *y, __global const float *mask, hada_conv_problem problem)
{
    const int in_channels = problem.in.channels, in_rows = problem.in.rows, in_cols = problem.in.cols;
    const int out_channels = problem.out.channels, out_rows = problem.out.rows, out_cols = problem.out.cols;
    const int to_coarse = problem.to_coarse, stride = to_coarse ? problem.in_step : problem.step;
    const int kernel_rows = problem.kernel_rows, kernel_cols = problem.kernel_cols;
    const int pad_rows = problem.pad_rows, pad_cols = problem.pad_cols;
    const int flags = problem.epilogue.flags, activation = problem.epilogue.activation;
    const float slope = problem.epilogue.slope;
    const int col = get_global_id(0), row = get_global_id(1);
    const int blocks = (out_channels + NET_BLOCK - 1) / NET_BLOCK, block = get_global_id(2) % blocks;
    const int image = get_global_id(2) / blocks, places = kernel_rows * kernel_cols;
    if (col >= out_cols)
        return;
    const size_t at = (((size_t)block * (out_rows + 2) + row + 1) * (out_cols + 2) + col + 1) * NET_BLOCK;
    y += problem.out.offset + image * problem.out.image + at;
    for (int k = 0; k < NET_BLOCK; ++k) {
        const int out = block * NET_BLOCK + k;
        float sum = 0.0f;
        for (int in = 0; in < in_channels && out < out_channels; ++in) {
            __global const float *wk =
                w + (to_coarse ? (size_t)out * in_channels + in : (size_t)in * out_channels + out) * places;
            __global const float *plane = x + problem.in.offset + image * problem.in.image +
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
        if (flags & HADA_CONV_HAS_BIAS && out < out_channels)
            sum += bias[problem.epilogue.bias + out];
        if (activation == HADA_ACTIVATION_SIGMOID)
            sum = 1.0f / (1.0f + exp(-sum));
        else if (activation != HADA_ACTIVATION_NONE && sum < 0.0f)
            sum = activation == HADA_ACTIVATION_RELU ? 0.0f : sum * slope;
        if (flags & HADA_CONV_HAS_MASK &&
            !(mask[problem.epilogue.mask + image * problem.epilogue.mask_image + at + k] > 0.0f))
            sum = 0.0f;
        if (flags & HADA_CONV_ACCUMULATES)
            sum += y[k];
        y[k] = out < out_channels ? sum : 0.0f;
    }
}

/* One work-item takes one weight's gradient: the sum over images and pixels of coarse times fine, row by row.
 * Dimensions: fine channels times places of the kernel, coarse channels. */
__kernel void conv_plain_weights(__global const float *coarse, __global const float *fine, __global float *dw,
                                 hada_conv_correlation sizes, ulong dw_offset, int accumulate)
{
    const int coarse_rows = sizes.coarse.rows, coarse_cols = sizes.coarse.cols;
    const int fine_rows = sizes.fine.rows, fine_cols = sizes.fine.cols;
    const int fine_channels = sizes.fine.channels, images = sizes.images, places = sizes.places;
    const int kernel_cols = sizes.kernel_cols, pad_rows = sizes.pad_rows, pad_cols = sizes.pad_cols;
    const int stride = sizes.stride;
    const ulong coarse_image = sizes.coarse.image, fine_image = sizes.fine.image;
    const int b = get_global_id(0) / places, place = get_global_id(0) % places, a = get_global_id(1);
    if (b >= fine_channels)
        return;
    const int u = place / kernel_cols - pad_rows, v = place % kernel_cols - pad_cols;
    coarse += sizes.coarse.offset + (size_t)(a / NET_BLOCK) * (coarse_rows + 2) * (coarse_cols + 2) * NET_BLOCK +
              a % NET_BLOCK;
    fine += sizes.fine.offset + (size_t)(b / NET_BLOCK) * (fine_rows + 2) * (fine_cols + 2) * NET_BLOCK + b % NET_BLOCK;
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
