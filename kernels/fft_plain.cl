/* What a transform library without pruning, bands and products needs around it: images of a rectangle to whole images
 * and back, spectra times filters. Row-major half spectra. One element a work-item. */
#include "inc_fft_product.h"

/* out (images, rows, cols) = the rectangle's images within zeros. */
__kernel void fft_plain_pad(__global const float *in, ulong in_offset, ulong in_distance, ulong in_pitch, int row0,
                            int col0, int rows_in, int cols_in, __global float *out, int rows, int cols, ulong count)
{
    const ulong i = get_global_id(0);
    if (i >= count)
        return;
    const ulong line = i / (ulong)cols, image = line / (ulong)rows;
    const int y = (int)(line % (ulong)rows) - row0, x = (int)(i % (ulong)cols) - col0;
    const int inside = (uint)y < (uint)rows_in && (uint)x < (uint)cols_in;
    out[i] = inside ? in[in_offset + image * in_distance + (ulong)y * in_pitch + (ulong)x] : 0.0f;
}

/* The rectangle's images = in (images, rows, cols). count: of the rectangles' pixels. */
__kernel void fft_plain_crop(__global const float *in, int rows, int cols, __global float *out, ulong out_offset,
                             ulong out_distance, ulong out_pitch, int row0, int col0, int rows_out, int cols_out,
                             ulong count)
{
    const ulong i = get_global_id(0);
    if (i >= count)
        return;
    const ulong line = i / (ulong)cols_out, image = line / (ulong)rows_out, y = line % (ulong)rows_out;
    const ulong x = i % (ulong)cols_out;
    out[out_offset + image * out_distance + y * out_pitch + x] =
        in[(image * (ulong)rows + y + (ulong)row0) * (ulong)cols + x + (ulong)col0];
}

/* out (images, rows, half) = spectra within the band, times every filter_step-th filter. Values that stand for
 * themselves (ky, kx) and their mirror image (-ky, kx), in the columns 0 and cols/2, are made to fit a real image. */
__kernel void fft_plain_product(__global const float *in, ulong in_offset, int in_count, __global const void *filter,
                                ulong filter_offset, int filter_step, int rows, int cols, int band_rows, int band_cols,
                                __global float *out, ulong count)
{
    const ulong i = get_global_id(0);
    if (i >= count)
        return;
    const int half_cols = cols / 2 + 1, x = (int)(i % (ulong)half_cols);
    const ulong line = i / (ulong)half_cols, image = line / (ulong)rows;
    const int y = (int)(line % (ulong)rows), mirror = y ? rows - y : 0, own = x == 0 || 2 * x == cols;
    const ulong one = (ulong)rows * (ulong)half_cols;
    float2 sum = (float2)0.0f;
    for (int part = 0; part < (own ? 2 : 1); ++part) {
        const ulong at = (ulong)(part ? mirror : y) * (ulong)half_cols + (ulong)x;
        float2 v = vload2(0, in + 2 * (in_offset + image % (ulong)in_count * one + at));
#if FFT_PRODUCT
        const float2 w = load_filter_value((__global const filter_value *)filter +
                                           2 * (filter_offset + image * (ulong)filter_step * one + at));
#if FFT_PRODUCT == 1
        v = (float2)(fma(v.x, w.x, -(v.y * w.y)), fma(v.x, w.y, v.y * w.x));
#else
        v *= w;
#endif
#endif
        sum += part ? (float2)(v.x, -v.y) : v;
    }
    if (own)
        sum *= 0.5f;
    if (x > band_cols || min(y, rows - y) > band_rows)
        sum = (float2)0.0f;
    vstore2(sum, i, out);
}
