/* From the running best to the distance map and the all-in-focus image. */

/* distance[i]: 1/z between the depths' 1/z by the vertex of the parabola through the measures before, at and after the
 * best depth, less `base` (the level of losing depths); NaN where the best measure is not above `threshold` or not
 * more than `margin` above the best of the depths that are not next to it. At the ends of the list nothing is
 * refined. */
__kernel void focus_finish(__global const float *best, __global const int *best_depth, __global const float *before,
                           __global const float *after, __global const float *second,
                           __global const float *inverse_distances, const int depths, const int pixels,
                           const int channels, const float threshold, const float margin, const float base,
                           __global const float *fused, __global float *all_in_focus, const ulong all_in_focus_offset,
                           __global float *distance, const ulong distance_offset)
{
    const int i = get_global_id(0);
    if (i >= pixels)
        return;
    for (int c = 0; c < channels; c++)
        all_in_focus[all_in_focus_offset + (size_t)(c * pixels + i)] = fused[c * pixels + i];

    const int depth = best_depth[i];
    const float peak = best[i] - base, left = max(before[i] - base, 0.0f), right = max(after[i] - base, 0.0f);
    float step = 0.0f;
    if (depth > 0 && depth < depths - 1) {
        const float bend = 2.0f * peak - left - right;
        step = bend > 0.0f ? clamp(0.5f * (right - left) / bend, -0.5f, 0.5f) : 0.0f;
    }
    const int other = clamp(step < 0.0f ? depth - 1 : depth + 1, 0, depths - 1);
    /* without a step the distance itself, which may be 0 (its inverse infinite) */
    const float inverse = step == 0.0f ? inverse_distances[depth]
                                       : mix(inverse_distances[depth], inverse_distances[other], fabs(step));
    const int found = best[i] > threshold && best[i] - second[i] > margin;
    distance[distance_offset + (size_t)i] = found ? 1.0f / inverse : as_float(0x7fc00000);
}
