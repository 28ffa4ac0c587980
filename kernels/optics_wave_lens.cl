/* Wave optics lens by lens (lib/optics/wave_lens.c): the field behind each lens, about its own centre, and, after its
 * transform to the sensor, the light of its spot on each pixel. */
#include "inc_vectors.h"
#include "shared_optics.h"

/* Real and imaginary parts of lens `first + get_global_id(2)`, one after the other, n x n values with rows `pitch`
 * apart (a multiple of 8): at (column, row), (column - middle) `step` from the centre, `phase` across times `phase`
 * down (n complex values each, for every lens) times the share of the sample that is open. The values between n and
 * `pitch` are 0. A plane of the lens holds what is nearer to another: c - (a u + b v) is a point's distance to the line
 * between the two. An item does rows, in pieces of 8. */
__kernel void optics_wave_pupil(__global float *field, __global const float *phase,
                                __global const hada_wave_lens *lenses, __global const float4 *planes, const int first,
                                const hada_optics_field lens_field)
{
    const int row = get_global_id(1), which = get_global_id(2), n = lens_field.n, pitch = lens_field.pitch;
    const float step = lens_field.step, radius = lens_field.radius, aperture = lens_field.aperture;
    if (row >= n)
        return;
    const hada_wave_lens lens = lenses[first + which];
    __global const float *across = phase + 4 * (size_t)which * (size_t)pitch, *down = across + 2 * pitch;
    __global float *real = field + (2 * (size_t)which * (size_t)n + (size_t)row) * (size_t)pitch,
                   *imaginary = real + (size_t)n * (size_t)pitch;
    const float middle = 0.5f * (float)(n - 1), y = ((float)row - middle) * step;
    const float2 turn = vload2(row, down);
    const float8 ramp = (float8)(0.0f, 1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f, 7.0f);
    for (int col = 8 * get_global_id(0); col < pitch; col += 8 * get_global_size(0)) {
        const float8 index = ramp + (float)col, x = (index - middle) * step;
        const float8 from_x = x + lens.x, from_y = (float8)(y + lens.y);
        float8 edge =
            fmin(radius - sqrt(fma(x, x, (float8)(y * y))), aperture - sqrt(fma(from_x, from_x, from_y * from_y)));
        for (int p = 0; p < lens.planes; p++) {
            const float4 plane = planes[lens.first + p];
            edge = fmin(edge, plane.z - fma((float8)(plane.x), x, (float8)(plane.y * y)));
        }
        float8 open = clamp(0.5f + edge / step, 0.0f, 1.0f);
        open = select(open, (float8)(0.0f), index >= (float8)((float)n));
        const float16 other = vload16(0, across + 2 * col);
        VECTORS_STORE8(__global, open * fma(other.even, (float8)(turn.x), -(other.odd * turn.y)), real + col);
        VECTORS_STORE8(__global, open * fma(other.even, (float8)(turn.y), other.odd * turn.x), imaginary + col);
    }
}

/* The transform of a complex field comes as the half spectra A and B of its real and imaginary parts, U(k) = A(k) + i
 * B(k), U(-k) = conj(A(k)) + i conj(B(k)). Columns in blocks of 8, as the library's own transforms keep them
 * (inc_spectrum.h). A pixel is `samples` x `samples` frequencies: pixel t = 0 .. pixels - 1 begins at (t - pixels / 2)
 * samples; n = pixels samples. */

/* Sums down the samples of each row of pixels, for 8 columns k and their mirror images: part[spot][row][2][width],
 * width = 8 blocks: the columns k, then the columns -k. Items: blocks, rows of pixels, spots. */
__kernel void optics_wave_spot_rows(__global float *part, __global const float *spectra, const int pixels,
                                    const int samples, const int blocks)
{
    const int block = get_global_id(0), row = get_global_id(1), spot = get_global_id(2);
    if (block >= blocks || row >= pixels)
        return;
    const int n = pixels * samples, begin = (row - pixels / 2) * samples;
    const size_t count = (size_t)blocks * (size_t)n * 8;
    __global const float *a = spectra + 4 * (size_t)spot * count + 16 * (size_t)block * (size_t)n, *b = a + 2 * count;
    float8 plus = (float8)(0.0f), minus = (float8)(0.0f);
    for (int k = begin; k < begin + samples; k++) {
        const int up = k < 0 ? k + n : k, mirror = k > 0 ? n - k : -k;
        float16 real = vload16(up, a), imaginary = vload16(up, b);
        float8 x = real.even - imaginary.odd, y = real.odd + imaginary.even;
        plus = fma(x, x, fma(y, y, plus));
        real = vload16(mirror, a);
        imaginary = vload16(mirror, b);
        x = real.even + imaginary.odd;
        y = imaginary.even - real.odd;
        minus = fma(x, x, fma(y, y, minus));
    }
    part += ((size_t)spot * (size_t)pixels + (size_t)row) * 2 * 8 * (size_t)blocks;
    VECTORS_STORE8(__global, plus, part + 8 * block);
    VECTORS_STORE8(__global, minus, part + 8 * (blocks + block));
}

/* Then across: image[spot][row][column] of pixels x pixels. Items: columns, rows, spots. */
__kernel void optics_wave_spot_cols(__global float *image, __global const float *part, const int pixels,
                                    const int samples, const int blocks)
{
    const int col = get_global_id(0), row = get_global_id(1), spot = get_global_id(2);
    if (col >= pixels || row >= pixels)
        return;
    const int begin = (col - pixels / 2) * samples;
    const size_t at = (size_t)spot * (size_t)pixels + (size_t)row;
    __global const float *plus = part + at * 16 * (size_t)blocks, *minus = plus + 8 * (size_t)blocks;
    float sum = 0.0f;
    for (int k = begin; k < begin + samples; k++)
        sum += k < 0 ? minus[-k] : plus[k];
    image[at * (size_t)pixels + (size_t)col] = sum;
}
