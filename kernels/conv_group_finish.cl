/* The sums of all parts of convolutions in work-groups (conv_group.cl, conv_tf32.cl) to the output. Dimensions: columns
 * times fours of a block, rows, images times blocks. */
#include "inc_conv_groups.h"

__kernel void conv_group_finish(__global const float *restrict partial, __global const float *restrict bias,
                                __global float *restrict y, __global const float *restrict mask,
                                hada_conv_problem problem)
{
    const int rows = problem.out.rows, cols = problem.out.cols, blocks = problem.out.blocks;
    const int four = get_global_id(0) % (NET_BLOCK / 4) * 4, col = get_global_id(0) / (NET_BLOCK / 4);
    const int row = get_global_id(1), block = get_global_id(2) % blocks, image = get_global_id(2) / blocks;
    const int first = block * NET_BLOCK + four, present = problem.out.channels - first;
    const size_t all = get_global_size(2) * (size_t)rows * cols * NET_BLOCK;
    const size_t at = ((size_t)(block * (rows + 2) + row + 1) * (cols + 2) + col + 1) * NET_BLOCK + four;
    if (col >= cols)
        return;
    partial += ((get_global_id(2) * rows + row) * cols + col) * NET_BLOCK + four;
    float4 sum = *(__global const float4 *)partial;
    for (int part = 1; part < problem.parts; ++part)
        sum += *(__global const float4 *)(partial + part * all);
    sum += conv_bias_four(bias + problem.epilogue.bias + first, problem.epilogue.flags, present);
    conv_put_four(sum, problem.epilogue, present,
                  mask + problem.epilogue.mask + image * problem.epilogue.mask_image + at,
                  y + problem.out.offset + image * problem.out.image + at);
}
