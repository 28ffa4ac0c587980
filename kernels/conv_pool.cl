/* The 2 x 2 maxima of a convolution's output, odd last rows and columns dropped. A work-item takes `each` pooled pixels
 * of a row: a whole row on CPUs, one on GPUs. Dimensions: columns over each, pooled rows, blocks times images. */
#include "inc_conv.h"

__kernel void conv_pool(__global const float *restrict y, __global float *restrict pooled, hada_tensor_layout at_y,
                        hada_tensor_layout at_pooled, int each)
{
    const int rows = at_y.rows, cols = at_y.cols, blocks = at_y.blocks;
    const int pooled_rows = at_pooled.rows, pooled_cols = at_pooled.cols;
    const int row = get_global_id(1), block = get_global_id(2) % blocks, image = get_global_id(2) / blocks;
    const int first = get_global_id(0) * each, last = min(first + each, pooled_cols), pitch = (cols + 2) * NET_BLOCK;
    y += at_y.offset + image * at_y.image + ((size_t)block * (rows + 2) + 2 * row + 1) * pitch + NET_BLOCK;
    pooled += at_pooled.offset + image * at_pooled.image +
              (((size_t)block * (pooled_rows + 2) + row + 1) * (pooled_cols + 2) + 1) * NET_BLOCK;
    for (int col = first; col < last; ++col) {
        __global const float *restrict p = y + 2 * col * NET_BLOCK;
        CONV_STORE(max(max(CONV_LOAD(p), CONV_LOAD(p + NET_BLOCK)),
                       max(CONV_LOAD(p + pitch), CONV_LOAD(p + pitch + NET_BLOCK))),
                   pooled + col * NET_BLOCK);
    }
}
