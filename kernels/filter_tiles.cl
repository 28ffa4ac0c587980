/* The energy of spectra in tiles: the sum of |B|^2 over strips of rows by eight columns, each value counted as often as
 * it stands in the whole spectrum (the columns 0 and cols/2 once, the others twice). Strip s holds the rows with
 * last[s-1] < |ky| <= last[s], strip 0 those with |ky| <= last[0]. */
#include "inc_spectrum.h"

/* Sums up eight columns of the rows from..to: as (re^2, im^2) of the columns 0..3 and 4..7. */
static inline void add_rows(__global const float *in, int rows, int block, int column, int cols, int from, int to,
                            float8 *low, float8 *high)
{
    if (block == 8) {
        __global const float *p = in + 2 * spectrum_index(rows, block, from, column);
        for (int row = from; row <= to; ++row, p += 16) {
            const float8 a = vload8(0, p), b = vload8(1, p);
            *low = fma(a, a, *low);
            *high = fma(b, b, *high);
        }
        return;
    }
    for (int row = from; row <= to; ++row) {
        float line[16];
        for (int c = 0; c < 8; ++c) {
            const int there = column + c <= cols / 2;
            const float2 v = there ? vload2(spectrum_index(rows, block, row, column + c), in) : (float2)0.0f;
            line[2 * c] = v.x;
            line[2 * c + 1] = v.y;
        }
        const float8 a = vload8(0, line), b = vload8(1, line);
        *low = fma(a, a, *low);
        *high = fma(b, b, *high);
    }
}

/* out[channel][strip][group of eight columns]; a work-item makes one of `count` values. Padding, which may hold
 * anything, is left out. */
__kernel void filter_tiles(__global const float *in, ulong channel_count, int rows, int cols, int block, int strips,
                           int groups, __global const int *last, uint count, __global float *out)
{
    const uint i = get_global_id(0);
    if (i >= count)
        return;
    const int group = (int)(i % (uint)groups), strip = (int)(i / (uint)groups % (uint)strips), column = 8 * group;
    __global const float *spectrum = in + 2 * channel_count * (ulong)(i / (uint)groups / (uint)strips);
    const int from = strip ? last[strip - 1] + 1 : 0, to = last[strip];
    float8 low = (float8)0.0f, high = (float8)0.0f;
    add_rows(spectrum, rows, block, column, cols, from, to, &low, &high);
    /* the negative frequencies; row 0, and the Nyquist row of an even height, stand for themselves */
    const int mirror_from = max(from, 1), mirror_to = 2 * to == rows ? to - 1 : to;
    add_rows(spectrum, rows, block, column, cols, rows - mirror_to, rows - mirror_from, &low, &high);
    float part[16], sum = 0.0f;
    vstore8(low, 0, part);
    vstore8(high, 1, part);
    for (int c = 0; c < 8; ++c) {
        const int kx = column + c, once = kx == 0 || 2 * kx == cols;
        if (2 * kx <= cols)
            sum += (once ? 1.0f : 2.0f) * (part[2 * c] + part[2 * c + 1]);
    }
    out[i] = sum;
}
