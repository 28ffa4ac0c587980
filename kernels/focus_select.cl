/* The running best over depths, near to far, and the all-in-focus sums. */

/* State images of rows x cols: best measure and its depth, the measures of the depths before and after it (0 where
 * these do not compete), the largest measure of a depth that is not next to it, and the measure of the depth pushed
 * last. Of every push but the first, each pixel has one loser: the smaller of the new measure and the best so far; its
 * measure is counted in loser_bins by the upper bits of its float pattern.
 *
 * depth: of this push; adjacent: the push before was depth - 1; seen: pushes of this frame before (0: state is not
 * read). weighted: all-in-focus is the mean weighted by the measures, kept up to date push by push, which holds at every
 * scale; where every measure so far is 0, the plain mean. Otherwise the sum. */
__kernel void focus_select(__global const float *measure, const int measure_pitch, __global const float *planes,
                           const ulong offset, const int channels, const int rows, const int cols, const int depth,
                           const int adjacent, const int seen, const int weighted, __global float *best,
                           __global int *best_depth, __global float *before, __global float *after,
                           __global float *second, __global float *last, __global float *fused,
                           __global float *weight_sum, __global int *loser_bins)
{
    const int x = get_global_id(0), row = get_global_id(1);
    if (x >= cols)
        return;
    const int i = row * cols + x, pixels = rows * cols;
    const float value = measure[row * measure_pitch + x];
    if (!seen) {
        best[i] = value;
        best_depth[i] = depth;
        before[i] = after[i] = second[i] = 0.0f;
    } else {
        const float old = best[i];
        const int next = best_depth[i] == depth - 1;
        atomic_inc(loser_bins + (as_uint(max(min(value, old), 0.0f)) >> 16));
        if (value > old) { /* strictly: ties go to the nearer depth */
            second[i] = next ? max(second[i], before[i]) : old;
            before[i] = adjacent ? last[i] : 0.0f;
            after[i] = 0.0f;
            best[i] = value;
            best_depth[i] = depth;
        } else if (next)
            after[i] = value;
        else
            second[i] = max(second[i], value);
    }
    last[i] = value;
    float share = 1.0f;
    if (weighted) {
        const float total = seen ? weight_sum[i] + value : value;
        share = total > 0.0f ? value / total : 1.0f / (float)(seen + 1);
        weight_sum[i] = total;
    }
    for (int c = 0; c < channels; c++) {
        const float light = planes[offset + (size_t)(c * pixels + i)], old = seen ? fused[c * pixels + i] : 0.0f;
        fused[c * pixels + i] = !seen ? light : weighted ? old + share * (light - old) : old + light;
    }
}
