/* The energy of filtered spectra in tiles: the sum of gain |B|^2 over strips of rows by eight columns, each value
 * counted as often as it occurs in the whole spectrum (the columns 0 and cols/2 once, the others twice). Strip s has
 * the rows with last[s-1] < |ky| <= last[s], strip 0 those with |ky| <= last[0]. */
#include "inc_spectrum.h"
#include "shared_spectrum.h"

/* Sums up eight columns of the rows from..to. */
static inline float8 add_rows(__global const float *in, __global const float *gain, int rows, int block, int column,
                              int cols, int from, int to, float8 sum)
{
    if (block == 8) {
        __global const float *p = in + 2 * spectrum_index(rows, block, from, column);
        __global const float *g = gain + spectrum_index(rows, block, from, column);
        for (int row = from; row <= to; ++row, p += 16, g += 8) {
            const float8 a = vload8(0, p) * vload8(0, p), b = vload8(1, p) * vload8(1, p);
            sum = fma((float8)(a.even + a.odd, b.even + b.odd), vload8(0, g), sum);
        }
        return sum;
    }
    for (int row = from; row <= to; ++row) {
        float line[8];
        for (int c = 0; c < 8; ++c) {
            const size_t at = spectrum_index(rows, block, row, min(column + c, cols / 2));
            const float2 v = vload2(at, in);
            line[c] = (v.x * v.x + v.y * v.y) * gain[at];
        }
        sum += vload8(0, line);
    }
    return sum;
}

/* out[channel][strip][group of eight columns]; a work-item makes one of `count` values. Padding, which may hold
 * anything, is left out. */
__kernel void filter_tiles(__global const float *in, __global const float *gains, hada_spectrum_shape shape, int strips,
                           int groups, __global const int *last, __global float *out, uint count)
{
    const uint i = get_global_id(0);
    if (i >= count)
        return;
    const int rows = shape.rows, cols = shape.cols, block = shape.block;
    const int group = (int)(i % (uint)groups), strip = (int)(i / (uint)groups % (uint)strips), column = 8 * group;
    const ulong first = (ulong)shape.count * (ulong)(i / (uint)groups / (uint)strips);
    __global const float *spectrum = in + 2 * first, *gain = gains + first;
    const int from = strip ? last[strip - 1] + 1 : 0, to = last[strip];
    float8 sum = add_rows(spectrum, gain, rows, block, column, cols, from, to, (float8)0.0f);
    /* the negative frequencies; row 0, and the Nyquist row of an even height, have none */
    const int mirror_from = max(from, 1), mirror_to = 2 * to == rows ? to - 1 : to;
    sum = add_rows(spectrum, gain, rows, block, column, cols, rows - mirror_to, rows - mirror_from, sum);
    float part[8], total = 0.0f;
    vstore8(sum, 0, part);
    for (int c = 0; c < 8; ++c) {
        const int kx = column + c, once = kx == 0 || 2 * kx == cols;
        if (2 * kx <= cols)
            total += once ? part[c] : 2.0f * part[c];
    }
    out[i] = total;
}
