/* Real rows to half spectra and back, by work-groups: a group takes 2 width rows of one image as `width` complex
 * transforms. As fft_rows_cols.cl otherwise. */
#include "inc_fft_groups.h"
#include "shared_fft.h"

__kernel void fft_group_rows_forward(__global const float *in, hada_fft_real real, __global float *out,
                                     hada_fft_spectra spectra, __global const int *table, int width,
                                     FFT_MEM float2 *scratches)
{
    const int n = table[FFT_LENGTH], points = table[FFT_POINTS], chirped = table[FFT_CHIRP] != 0;
    const int rows_in = real.rows, groups = (rows_in + 2 * width - 1) / (2 * width), tasks = groups * real.images;
    const int blocks = spectra.band / HADA_FFT_BLOCK + 1;
    const fft_side side = fft_side_of(width);
    __global const int *place = table + table[FFT_PLACE];
    __global const float *chirp = FFT_FLOATS_OF(table) + table[FFT_CHIRP];
    FFT_MEM float2 *scratch = fft_own_scratch(scratches, table, width);
    for (int task = get_group_id(0); task < tasks; task += get_num_groups(0)) {
        const int image = task / groups, first = task % groups * 2 * width, count = min(2 * width, rows_in - first);
        __global const float *p = in + real.offset + (ulong)image * real.distance + (ulong)first * real.pitch;
        FFT_SHARE (i, (chirped ? points * width : 0))
            scratch[i] = (float2)0.0f;
        FFT_WAIT();
        for (int w = 0; w < width; ++w)
            FFT_SHARE (x, n) {
                const int c = x - real.col0;
                float2 v = (float2)0.0f;
                if ((uint)c < (uint)real.cols) {
                    if (w < count)
                        v.x = p[(ulong)w * real.pitch + c];
                    if (width + w < count)
                        v.y = p[(ulong)(width + w) * real.pitch + c];
                }
                fft_put_in(scratch, width, w, place[x], x, v, chirped, chirp);
            }
        FFT_MEM const float2 *result = fft_transform(scratch, side, table, FFT_FLOATS_OF(table));
        __global float *q =
            out + 2 * (spectra.offset + (ulong)image * spectra.distance + (ulong)(real.row0 + first) * 8);
        for (int w = 0; w < min(width, count); ++w)
            FFT_SHARE (k, blocks * 8) {
                const int mirror = k ? n - k : 0;
                __global float2 *to =
                    (__global float2 *)q + ((ulong)(k / 8) * (ulong)spectra.rows + (ulong)w) * 8 + k % 8;
                float2 z = (float2)0.0f, u = z;
                if (k <= n / 2) {
                    z = 0.5f * fft_take_out(result, width, w, place[k], k, chirped, chirp);
                    u = 0.5f * fft_take_out(result, width, w, place[mirror], mirror, chirped, chirp);
                }
                to[0] = (float2)(z.x + u.x, z.y - u.y);
                if (width + w < count)
                    to[8 * width] = (float2)(z.y + u.y, u.x - z.x);
            }
        FFT_WAIT();
    }
}

__kernel void fft_group_rows_inverse(__global const float *in, hada_fft_spectra spectra, __global float *out,
                                     hada_fft_real real, __global const int *table, int width,
                                     FFT_MEM float2 *scratches)
{
    const int n = table[FFT_LENGTH], points = table[FFT_POINTS], chirped = table[FFT_CHIRP] != 0;
    const int band = spectra.band, rows_in = spectra.rows;
    const int groups = (rows_in + 2 * width - 1) / (2 * width), tasks = groups * real.images, cols_out = real.cols;
    const fft_side side = fft_side_of(width);
    __global const int *place = table + table[FFT_PLACE];
    __global const float *chirp = FFT_FLOATS_OF(table) + table[FFT_CHIRP];
    FFT_MEM float2 *scratch = fft_own_scratch(scratches, table, width);
    for (int task = get_group_id(0); task < tasks; task += get_num_groups(0)) {
        const int image = task / groups, first = task % groups * 2 * width, count = min(2 * width, rows_in - first);
        __global const float *p = in + 2 * (spectra.offset + (ulong)image * spectra.distance + (ulong)first * 8);
        FFT_SHARE (i, (chirped || band < n / 2 ? points * width : 0))
            scratch[i] = (float2)0.0f;
        FFT_WAIT();
        for (int w = 0; w < width; ++w)
            FFT_SHARE (k, band + 1) {
                __global const float2 *q =
                    (__global const float2 *)p + ((ulong)(k / 8) * (ulong)rows_in + (ulong)w) * 8 + k % 8;
                float2 x = (float2)0.0f, y = (float2)0.0f;
                if (w < count)
                    x = q[0];
                if (width + w < count)
                    y = q[8 * width];
                /* frequency k is input number n - k of a forward transform; the list of places knows that */
                if (k == 0 || 2 * k == n) {
                    fft_put_in(scratch, width, w, place[k], k, (float2)(x.x, y.x), chirped, chirp);
                } else {
                    fft_put_in(scratch, width, w, place[k], n - k, (float2)(x.x - y.y, x.y + y.x), chirped, chirp);
                    fft_put_in(scratch, width, w, place[n - k], k, (float2)(x.x + y.y, y.x - x.y), chirped, chirp);
                }
            }
        FFT_MEM const float2 *result = fft_transform(scratch, side, table, FFT_FLOATS_OF(table));
        __global float *q = out + real.offset + (ulong)image * real.distance + (ulong)first * real.pitch;
        for (int w = 0; w < width; ++w)
            FFT_SHARE (c, cols_out) {
                const int x = real.col0 + c;
                const float2 v = fft_take_out(result, width, w, place[x ? n - x : 0], x, chirped, chirp) * real.scale;
                if (w < count)
                    q[(ulong)w * real.pitch + c] = v.x;
                if (width + w < count)
                    q[(ulong)(width + w) * real.pitch + c] = v.y;
            }
        FFT_WAIT();
    }
}
