/* Around a transform library without pruning, bands and products: images of a rectangle to whole images and back,
 * spectra times filters. Row-major half spectra. One element a work-item. */
#include "inc_fft_product.h"
#include "shared_fft.h"

/* out (images, rows, cols) = the rectangle's images within zeros. */
__kernel void fft_plain_pad(__global const float *in, hada_fft_real real, __global float *out, int rows, int cols,
                            ulong count)
{
    const ulong i = get_global_id(0);
    if (i >= count)
        return;
    const ulong line = i / (ulong)cols, image = line / (ulong)rows;
    const int y = (int)(line % (ulong)rows) - real.row0, x = (int)(i % (ulong)cols) - real.col0;
    const int inside = (uint)y < (uint)real.rows && (uint)x < (uint)real.cols;
    out[i] = inside ? in[real.offset + image * real.distance + (ulong)y * real.pitch + (ulong)x] : 0.0f;
}

/* The rectangle's images = in (images, rows, cols). count: of the rectangles' pixels. */
__kernel void fft_plain_crop(__global const float *in, int rows, int cols, __global float *out, hada_fft_real real,
                             ulong count)
{
    const ulong i = get_global_id(0);
    if (i >= count)
        return;
    const ulong line = i / (ulong)real.cols, image = line / (ulong)real.rows, y = line % (ulong)real.rows;
    const ulong x = i % (ulong)real.cols;
    out[real.offset + image * real.distance + y * real.pitch + x] =
        in[(image * (ulong)rows + y + (ulong)real.row0) * (ulong)cols + x + (ulong)real.col0];
}

/* out (images, rows, half) = spectra within the band, times every filter_step-th filter. Values that stand for
 * themselves (ky, kx) and their mirror image (-ky, kx), in the columns 0 and cols/2, are made to fit a real image. */
__kernel void fft_plain_product(__global const float *in, ulong in_offset, int in_count, __global const void *filter,
                                ulong filter_offset, int filter_step, __global float *out, hada_fft_band band,
                                ulong count)
{
    const ulong i = get_global_id(0);
    if (i >= count)
        return;
    const int rows = band.rows, cols = band.cols, half_cols = cols / 2 + 1, x = (int)(i % (ulong)half_cols);
    const ulong line = i / (ulong)half_cols, image = line / (ulong)rows;
    const int y = (int)(line % (ulong)rows), mirror = y ? rows - y : 0, own = x == 0 || 2 * x == cols;
    const ulong one = (ulong)rows * (ulong)half_cols;
    float2 sum = (float2)0.0f;
    for (int part = 0; part < (own ? 2 : 1); ++part) {
        const ulong at = (ulong)(part ? mirror : y) * (ulong)half_cols + (ulong)x;
        float2 v = vload2(0, in + 2 * (in_offset + image % (ulong)in_count * one + at));
#if FFT_PRODUCT
        v = filter_product(v, load_filter_value((__global const filter_value *)filter +
                                                2 * (filter_offset + image * (ulong)filter_step * one + at)));
#endif
        sum += part ? (float2)(v.x, -v.y) : v;
    }
    if (own)
        sum *= 0.5f;
    if (x > band.band_cols || min(y, rows - y) > band.band_rows)
        sum = (float2)0.0f;
    vstore2(sum, i, out);
}
