/* Depth from focus: how much a refocused plane has to say at each pixel, averaged by a window, the running best over the
 * planes, and what follows from it. */

/* light[i][x]: luminance (Rec. 709) at row i - border_rows, column x - border_cols; beyond the image its edge pixels are
 * repeated. `pitch` columns. */
__kernel void focus_luminance(__global const float *planes, const ulong offset, const int channels, const int rows,
                              const int cols, const int border_rows, const int border_cols, const int pitch,
                              __global float *light)
{
    const int x = get_global_id(0), i = get_global_id(1);
    if (x >= pitch)
        return;
    const int pixels = rows * cols,
              at = clamp(i - border_rows, 0, rows - 1) * cols + clamp(x - border_cols, 0, cols - 1);
    __global const float *plane = planes + offset;
    light[(size_t)i * pitch + x] =
        channels == 3 ? 0.2126f * plane[at] + 0.7152f * plane[at + pixels] + 0.0722f * plane[at + 2 * pixels] : plane[at];
}

/* How much a refocused plane has to say at each pixel, which a window then averages: response[i][8 x ..] from
 * light[i + 1][8 + 8 x ..] and its neighbours, eight columns at a time, `vectors` to a row. energy 0: the squared edge
 * response (contrast), 1: intensity. With `count`, noise_bins counts the absolute response of Immerkaer's noise operator
 * at the image's inner pixels by the upper bits of its float pattern (integer counts: the order of the additions does
 * not matter). */
__kernel void focus_measure(__global const float *light, const int rows, const int cols, const int border_rows,
                            const int halo, const int vectors, const int energy, const int count,
                            __global float *response, __global int *noise_bins)
{
    const int x = get_global_id(0), i = get_global_id(1), pitch = 8 * vectors + 16;
    if (x >= vectors)
        return;
    __global const float *up = light + (size_t)i * pitch + 8 + 8 * x, *here = up + pitch, *down = here + pitch;
    const float8 e = vload8(0, here);
    const float8 across = (vload8(0, up + 1) - vload8(0, up - 1) + 2.0f * (vload8(0, here + 1) - vload8(0, here - 1)) +
                           vload8(0, down + 1) - vload8(0, down - 1)) *
                          0.125f;
    const float8 along = (vload8(0, down - 1) - vload8(0, up - 1) + 2.0f * (vload8(0, down) - vload8(0, up)) +
                          vload8(0, down + 1) - vload8(0, up + 1)) *
                         0.125f;
    vstore8(energy ? max(e, (float8)(0.0f)) : fma(across, across, along * along), (size_t)i * vectors + x, response);
    const int row = i + 1 - border_rows;
    if (count && row > 0 && row < rows - 1) {
        const float8 second = vload8(0, up - 1) + vload8(0, up + 1) + vload8(0, down - 1) + vload8(0, down + 1) -
                              2.0f * (vload8(0, up) + vload8(0, down) + vload8(0, here - 1) + vload8(0, here + 1)) +
                              4.0f * e;
        uint bins[8];
        vstore8(as_uint8(fabs(second)) >> 16, 0, bins);
        for (int k = 0; k < 8; k++) {
            const int col = 8 * x + k - halo;
            if (col > 0 && col < cols - 1)
                atomic_inc(noise_bins + bins[k]);
        }
    }
}

/* Local mean with a separable window, eight columns at a time. */

/* out[row][x] = sum of weights[k] in[row + k][x]; `vectors` of eight columns, 2 radius more rows in `in`. */
__kernel void focus_window_down(__global const float *in, __global const float *weights, const int radius,
                                const int vectors, __global float *out)
{
    const int x = get_global_id(0), row = get_global_id(1);
    if (x >= vectors)
        return;
    float8 sum = (float8)(0.0f);
    for (int k = 0; k <= 2 * radius; k++)
        sum = fma((float8)(weights[k]), vload8((size_t)(row + k) * vectors + x, in), sum);
    vstore8(sum, (size_t)row * vectors + x, out);
}

/* out[row][8 x ..] = sum of weights[k] in[row][halo + 8 x + k - radius ..]; `in` has `pitch` columns, with a halo of at
 * least `radius`, `out` has 8 * vectors. multiply: the root of the sum is multiplied into what stands in `out`. */
__kernel void focus_window_across(__global const float *in, __global const float *weights, const int radius,
                                  const int halo, const int pitch, const int vectors, const int multiply,
                                  __global float *out)
{
    const int x = get_global_id(0), row = get_global_id(1);
    if (x >= vectors)
        return;
    __global const float *from = in + (size_t)row * pitch + halo + 8 * x - radius;
    float8 sum = (float8)(0.0f);
    for (int k = 0; k <= 2 * radius; k++)
        sum = fma((float8)(weights[k]), vload8(0, from + k), sum);
    if (multiply)
        sum = sqrt(sum) * vload8((size_t)row * vectors + x, out);
    vstore8(sum, (size_t)row * vectors + x, out);
}

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
