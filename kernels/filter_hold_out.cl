/* Leaves blocks of a frame's values out of its data: their weights become 0, and what they count as held-out values is
 * written beside them. A work-item a value.
 *
 * blocks: a byte for each block of side x side values, row by row; 0: it stays
 * weights, held: as large as the frame; without `weighted` all weights are 1, whatever stands in `weights`
 * by_weight: a held-out value counts by its weight v, as hada_refine_data.score_mu has it: r / (1 - r) with r the root
 * of v; else each of them counts 1. Values of weight 0 or less are no data, and stay what they are.
 * Dimensions: columns, rows of all channels. */
#define WHOLE 1e30f /* of which w / (w + 1) is 1 */

__kernel void filter_hold_out(__global const uchar *blocks, int side, int cols, int by_weight, int weighted,
                              __global float *weights, __global float *held)
{
    const int col = (int)get_global_id(0), row = (int)get_global_id(1), across = (cols + side - 1) / side;
    if (col < cols) {
        const ulong i = (ulong)row * (ulong)cols + (ulong)col;
        const float weight = weighted ? weights[i] : 1.0f, root = sqrt(fmax(weight, 0.0f));
        const int out = blocks[(ulong)(row / side) * (ulong)across + (ulong)(col / side)] && weight > 0.0f;
        const float score = !by_weight ? 1.0f : root < 1.0f ? root / (1.0f - root) : WHOLE;
        weights[i] = out ? 0.0f : weight;
        held[i] = out ? score : 0.0f;
    }
}

/* Takes the mean of a block's held-out values, which are those with held > 0, off each of them. A work-item a block;
 * dimensions: columns and rows of blocks. */
__kernel void filter_level_blocks(int side, int rows, int cols, __global const float *held, __global float *values)
{
    const int row0 = (int)get_global_id(1) * side, col0 = (int)get_global_id(0) * side;
    const int row1 = min(row0 + side, rows), col1 = min(col0 + side, cols);
    float sum = 0.0f, count = 0.0f, mean = 0.0f;
    for (int pass = 0; pass < 2; pass++, mean = sum / fmax(count, 1.0f))
        for (int row = row0; row < row1; row++)
            for (int col = col0; col < col1; col++) {
                const ulong i = (ulong)row * (ulong)cols + (ulong)col;
                if (!(held[i] > 0.0f))
                    continue;
                if (pass)
                    values[i] -= mean;
                sum += values[i];
                count += 1.0f;
            }
}
