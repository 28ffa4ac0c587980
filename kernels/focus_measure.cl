/* How much a refocused plane has to say at each pixel: the response that a window then averages. */

#ifndef FOCUS_MEASURE
#define FOCUS_MEASURE 1 /* 1: squared edge response (contrast), 2: intensity (energy) */
#endif

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

/* response[i][8 x ..] from light[i + 1][8 + 8 x ..] and its neighbours, eight columns at a time, `vectors` to a row.
 * With `count`, noise_bins counts the absolute response of Immerkaer's noise operator at the image's inner pixels by the
 * upper bits of its float pattern (integer counts: the order of the additions does not matter). */
__kernel void focus_measure(__global const float *light, const int rows, const int cols, const int border_rows,
                            const int halo, const int vectors, const int count, __global float *response,
                            __global int *noise_bins)
{
    const int x = get_global_id(0), i = get_global_id(1), pitch = 8 * vectors + 16;
    if (x >= vectors)
        return;
    __global const float *up = light + (size_t)i * pitch + 8 + 8 * x, *here = up + pitch, *down = here + pitch;
    const float8 e = vload8(0, here);
#if FOCUS_MEASURE == 1
    const float8 across = (vload8(0, up + 1) - vload8(0, up - 1) + 2.0f * (vload8(0, here + 1) - vload8(0, here - 1)) +
                           vload8(0, down + 1) - vload8(0, down - 1)) *
                          0.125f;
    const float8 along = (vload8(0, down - 1) - vload8(0, up - 1) + 2.0f * (vload8(0, down) - vload8(0, up)) +
                          vload8(0, down + 1) - vload8(0, up + 1)) *
                         0.125f;
    vstore8(fma(across, across, along * along), (size_t)i * vectors + x, response);
#else
    vstore8(max(e, (float8)(0.0f)), (size_t)i * vectors + x, response);
#endif
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
