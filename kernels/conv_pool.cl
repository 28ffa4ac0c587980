/* The 2 x 2 maxima of a convolution's output, odd last rows and columns dropped. A work-item takes `each` pooled pixels
 * of a row: a whole row on CPUs, one on GPUs. Dimensions: columns over each, pooled rows, blocks times images. */
#include "inc_conv.h"

__kernel void conv_pool(__global const float *restrict y, ulong y_offset, ulong y_image, int rows, int cols,
                        __global float *restrict pooled, ulong pooled_offset, ulong pooled_image, int pooled_rows,
                        int pooled_cols, int blocks, int each)
{
    const int row = get_global_id(1), block = get_global_id(2) % blocks, image = get_global_id(2) / blocks;
    const int first = get_global_id(0) * each, last = min(first + each, pooled_cols), pitch = (cols + 2) * NET_BLOCK;
    y += y_offset + image * y_image + ((size_t)block * (rows + 2) + 2 * row + 1) * pitch + NET_BLOCK;
    pooled += pooled_offset + image * pooled_image +
              (((size_t)block * (pooled_rows + 2) + row + 1) * (pooled_cols + 2) + 1) * NET_BLOCK;
    for (int col = first; col < last; ++col) {
        __global const float *restrict p = y + 2 * col * NET_BLOCK;
        CONV_STORE(max(max(CONV_LOAD(p), CONV_LOAD(p + NET_BLOCK)),
                       max(CONV_LOAD(p + pitch), CONV_LOAD(p + pitch + NET_BLOCK))),
                   pooled + col * NET_BLOCK);
    }
}
