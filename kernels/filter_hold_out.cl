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
