/* How much a refocused plane has to say at each pixel: the response that a window then averages. */

#ifndef FOCUS_MEASURE
#define FOCUS_MEASURE 1 /* 1: squared edge response (contrast), 2: intensity (energy) */
#endif

float focus_luminance(__global const float *plane, const int channels, const int pixels, const int at)
{
    return channels == 3 ? 0.2126f * plane[at] + 0.7152f * plane[at + pixels] + 0.0722f * plane[at + 2 * pixels]
                         : plane[at];
}

/* response[row][x] for a pitch of cols and a halo on either side, in which the edge pixels are repeated; noise_bins
 * counts the absolute response of Immerkaer's noise operator by the upper bits of its float pattern (integer counts:
 * the order of the additions does not matter), away from the edges. */
__kernel void focus_measure(__global const float *planes, const ulong offset, const int channels, const int rows,
                            const int cols, const int halo, const int pitch, __global float *response,
                            __global int *noise_bins)
{
    const int x = get_global_id(0), row = get_global_id(1);
    if (x >= pitch)
        return;
    __global const float *plane = planes + offset;
    const int col = clamp(x - halo, 0, cols - 1), pixels = rows * cols;
    const int up = max(row - 1, 0) * cols, here = row * cols, down = min(row + 1, rows - 1) * cols;
    const int left = max(col - 1, 0), right = min(col + 1, cols - 1);
    const float a = focus_luminance(plane, channels, pixels, up + left),
                b = focus_luminance(plane, channels, pixels, up + col),
                c = focus_luminance(plane, channels, pixels, up + right),
                d = focus_luminance(plane, channels, pixels, here + left),
                e = focus_luminance(plane, channels, pixels, here + col),
                f = focus_luminance(plane, channels, pixels, here + right),
                g = focus_luminance(plane, channels, pixels, down + left),
                h = focus_luminance(plane, channels, pixels, down + col),
                i = focus_luminance(plane, channels, pixels, down + right);
#if FOCUS_MEASURE == 1
    const float across = (c + 2.0f * f + i - a - 2.0f * d - g) * 0.125f,
                along = (g + 2.0f * h + i - a - 2.0f * b - c) * 0.125f;
    response[row * pitch + x] = fma(across, across, along * along);
#else
    response[row * pitch + x] = max(e, 0.0f);
#endif
    if (x > halo && x < halo + cols - 1 && row > 0 && row < rows - 1) {
        const float second = (a - 2.0f * b + c) - 2.0f * (d - 2.0f * e + f) + (g - 2.0f * h + i);
        atomic_inc(noise_bins + (as_uint(fabs(second)) >> 16));
    }
}
