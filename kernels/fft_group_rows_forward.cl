/* Real rows to half spectra, by work-groups: a group takes 2 width rows of one image as `width` complex transforms. As
 * fft_rows_cols.cl otherwise. */
#include "inc_fft_groups.h"
#include "shared_fft.h"

__kernel void fft_group_rows_forward(__global const float *in, hada_fft_real real, __global float *out,
                                     hada_fft_spectra spectra, __global const int *table, __global const float *floats,
                                     int width, FFT_MEM float2 *scratches)
{
    const int n = table[FFT_LENGTH], points = table[FFT_POINTS], chirped = table[FFT_CHIRP] != 0;
    const int rows_in = real.rows, groups = (rows_in + 2 * width - 1) / (2 * width), tasks = groups * real.images;
    const int blocks = spectra.band / HADA_FFT_BLOCK + 1;
    __global const int *place = table + table[FFT_PLACE];
    __global const float *chirp = floats + table[FFT_CHIRP];
#if FFT_SCRATCH_GLOBAL
    __global float2 *scratch = scratches + get_group_id(0) * (size_t)(points * width * (table[FFT_ODD] ? 2 : 1));
#else
    __local float2 *scratch = scratches;
#endif
    for (int task = get_group_id(0); task < tasks; task += get_num_groups(0)) {
        const int image = task / groups, first = task % groups * 2 * width, count = min(2 * width, rows_in - first);
        __global const float *p = in + real.offset + (ulong)image * real.distance + (ulong)first * real.pitch;
        FFT_SHARE (i, (chirped ? points * width : 0))
            scratch[i] = (float2)0.0f;
        FFT_WAIT();
        FFT_SHARE (i, n * width) {
            const int x = i % n, w = i / n, c = x - real.col0;
            float2 v = (float2)0.0f;
            if ((uint)c < (uint)real.cols) {
                if (w < count)
                    v.x = p[(ulong)w * real.pitch + c];
                if (width + w < count)
                    v.y = p[(ulong)(width + w) * real.pitch + c];
            }
            fft_put_in(scratch, width, w, place[x], x, v, chirped, chirp);
        }
        FFT_MEM const float2 *result = fft_transform(scratch, width, table, floats);
        __global float *q =
            out + 2 * (spectra.offset + (ulong)image * spectra.distance + (ulong)(real.row0 + first) * 8);
        FFT_SHARE (i, blocks * count * 8) {
            const int block = i / 8 / count, row = i / 8 % count, k = 8 * block + i % 8;
            const int w = row % width, mirror = k ? n - k : 0;
            float2 v = (float2)0.0f;
            if (k <= n / 2) {
                const float2 z = fft_take_out(result, width, w, place[k], k, chirped, chirp);
                const float2 u = fft_take_out(result, width, w, place[mirror], mirror, chirped, chirp);
                v = row < width ? 0.5f * (float2)(z.x + u.x, z.y - u.y) : 0.5f * (float2)(z.y + u.y, u.x - z.x);
            }
            vstore2(v, 0, q + 2 * ((ulong)block * (ulong)spectra.rows * 8 + (ulong)row * 8 + (ulong)(i % 8)));
        }
        FFT_WAIT();
    }
}
