/* Wave optics of a whole mask (lib/optics/wave_whole.c): the field behind the mask, its propagation, and its light on
 * each pixel. A field is stored as its real and imaginary part, two real images. */
#include "inc_vectors.h"
#include "shared_optics.h"

/* Both parts, n x n values each, of open * exp(2 pi i waves path). Items: eights of columns, rows. */
__kernel void optics_wave_mask(__global float *field, __global const float *path, __global const float *open,
                               const int n, const float waves)
{
    const int col = 8 * get_global_id(0), row = get_global_id(1);
    if (col >= n || row >= n)
        return;
    const size_t at = (size_t)row * (size_t)n + (size_t)col, all = (size_t)n * (size_t)n;
    const int count = min(n - col, 8);
    float list[8] = {0};
    if (count < 8)
        for (int i = 0; i < count; i++)
            list[i] = path[at + i];
    const float8 turns = (count < 8 ? vload8(0, list) : vload8(0, path + at)) * waves;
    /* without whole turns, which is exact: a large angle would lose its last digits */
    const float8 angle = 6.28318530717958648f * (turns - rint(turns)), real = cos(angle), imaginary = sin(angle);
    if (count == 8) {
        const float8 share = vload8(0, open + at);
        VECTORS_STORE8(__global, share * real, field + at);
        VECTORS_STORE8(__global, share * imaginary, field + all + at);
        return;
    }
    float other[8];
    vstore8(real, 0, list);
    vstore8(imaginary, 0, other);
    for (int i = 0; i < count; i++) {
        field[at + i] = open[at + i] * list[i];
        field[all + at + i] = open[at + i] * other[i];
    }
}

/* Free space: both half spectra times across[column] down[row], complex numbers that are even in the frequency, so that
 * the parts stay real images: real' = real Re - imaginary Im, imaginary' = real Im + imaginary Re. In place; columns in
 * blocks of 8, of which an item does one row. `spectrum`: the two spectra, `count` complex values each. */
__kernel void optics_wave_travel(__global float *spectrum, __global const float *across, __global const float *down,
                                 const int rows, const int blocks)
{
    const int row = get_global_id(0), block = get_global_id(1);
    if (row >= rows || block >= blocks)
        return;
    const size_t count = (size_t)blocks * (size_t)rows * 8, at = (size_t)block * (size_t)rows + (size_t)row;
    __global float *other = spectrum + 2 * count;
    const float2 d = vload2(row, down);
    const float16 a = vload16(block, across);
    const float8 re = fma(a.even, (float8)(d.x), -(a.odd * d.y)), im = fma(a.even, (float8)(d.y), a.odd * d.x);
    const float16 real = vload16(at, spectrum), imaginary = vload16(at, other);
    float16 first, second;
    first.even = fma(real.even, re, -(imaginary.even * im));
    first.odd = fma(real.odd, re, -(imaginary.odd * im));
    second.even = fma(real.even, im, imaginary.even * re);
    second.odd = fma(real.odd, im, imaginary.odd * re);
    VECTORS_STORE16(__global, first, spectrum + 16 * at);
    VECTORS_STORE16(__global, second, other + 16 * at);
}

/* Across: part[row][pixel] of |real + i imaginary|^2, rows x cols samples each, one after the other. Items: pixels,
 * rows. */
__kernel void optics_wave_sensor_rows(__global float *part, __global const float *field,
                                      __global const hada_wave_pixel *table, const int rows, const int cols,
                                      const int pixels)
{
    const int pixel = get_global_id(0), row = get_global_id(1);
    if (pixel >= pixels || row >= rows)
        return;
    const hada_wave_pixel p = table[pixel];
    __global const float *real = field + (size_t)row * (size_t)cols + p.first,
                         *imaginary = real + (size_t)rows * (size_t)cols;
    float sum = 0.0f;
    for (int i = 0; i < p.count; i++) {
        const float weight = i == 0 ? p.begin : i == p.count - 1 ? p.end : 1.0f;
        sum = fma(weight, fma(real[i], real[i], imaginary[i] * imaginary[i]), sum);
    }
    part[(size_t)row * (size_t)pixels + (size_t)pixel] = sum;
}

/* Down: image[pixel row][pixel] of part. Items: pixels, rows of pixels. */
__kernel void optics_wave_sensor_cols(__global float *image, __global const float *part,
                                      __global const hada_wave_pixel *table, const int pixels, const int pixel_rows)
{
    const int pixel = get_global_id(0), row = get_global_id(1);
    if (pixel >= pixels || row >= pixel_rows)
        return;
    const hada_wave_pixel p = table[row];
    __global const float *line = part + (size_t)p.first * (size_t)pixels + (size_t)pixel;
    float sum = 0.0f;
    for (int i = 0; i < p.count; i++) {
        const float weight = i == 0 ? p.begin : i == p.count - 1 ? p.end : 1.0f;
        sum = fma(weight, line[(size_t)i * (size_t)pixels], sum);
    }
    image[(size_t)row * (size_t)pixels + (size_t)pixel] = sum;
}
