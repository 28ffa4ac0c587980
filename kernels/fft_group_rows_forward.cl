/* Real rows to half spectra, by work-groups: a group takes 2 width rows of one image as `width` complex transforms. As
 * fft_rows_cols.cl otherwise. */
#include "inc_fft_groups.h"

__kernel void fft_group_rows_forward(__global const float *in, ulong in_offset, ulong in_distance, ulong in_pitch,
                                     int col0, int cols_in, int rows_in, __global float *out, ulong out_offset,
                                     ulong out_distance, int row0, int rows, int blocks, int tasks,
                                     __global const int *table, __global const float *floats, int width,
                                     FFT_MEM float2 *scratches)
{
    const int n = table[FFT_LENGTH], points = table[FFT_POINTS], chirped = table[FFT_CHIRP] != 0;
    const int groups = (rows_in + 2 * width - 1) / (2 * width);
    __global const int *place = table + table[FFT_PLACE];
    __global const float *chirp = floats + table[FFT_CHIRP];
#if FFT_SCRATCH_GLOBAL
    __global float2 *scratch = scratches + get_group_id(0) * (size_t)(points * width * (table[FFT_ODD] ? 2 : 1));
#else
    __local float2 *scratch = scratches;
#endif
    for (int task = get_group_id(0); task < tasks; task += get_num_groups(0)) {
        const int image = task / groups, first = task % groups * 2 * width, count = min(2 * width, rows_in - first);
        __global const float *p = in + in_offset + (ulong)image * in_distance + (ulong)first * in_pitch;
        FFT_SHARE (i, (chirped ? points * width : 0))
            scratch[i] = (float2)0.0f;
        FFT_WAIT();
        FFT_SHARE (i, n * width) {
            const int x = i % n, w = i / n, c = x - col0;
            float2 v = (float2)0.0f;
            if ((uint)c < (uint)cols_in) {
                if (w < count)
                    v.x = p[(ulong)w * in_pitch + c];
                if (width + w < count)
                    v.y = p[(ulong)(width + w) * in_pitch + c];
            }
            fft_put_in(scratch, width, w, place[x], x, v, chirped, chirp);
        }
        FFT_MEM const float2 *result = fft_transform(scratch, width, table, floats);
        __global float *q = out + 2 * (out_offset + (ulong)image * out_distance + (ulong)(row0 + first) * 8);
        FFT_SHARE (i, blocks * count * 8) {
            const int block = i / 8 / count, row = i / 8 % count, k = 8 * block + i % 8;
            const int w = row % width, mirror = k ? n - k : 0;
            float2 v = (float2)0.0f;
            if (k <= n / 2) {
                const float2 z = fft_take_out(result, width, w, place[k], k, chirped, chirp);
                const float2 u = fft_take_out(result, width, w, place[mirror], mirror, chirped, chirp);
                v = row < width ? 0.5f * (float2)(z.x + u.x, z.y - u.y) : 0.5f * (float2)(z.y + u.y, u.x - z.x);
            }
            vstore2(v, 0, q + 2 * ((ulong)block * (ulong)rows * 8 + (ulong)row * 8 + (ulong)(i % 8)));
        }
        FFT_WAIT();
    }
}
