/* Transforms along the columns of half spectra, by work-groups: a group takes `width` columns of one block of one image
 * (width: 1, 2, 4 or 8). As fft_rows_cols.cl otherwise. */
#include "inc_fft_groups.h"
#include "inc_fft_product.h"
#include "shared_fft.h"

__kernel void fft_group_cols(__global const float *in, hada_fft_columns_in from, __global const void *filter,
                             __global float *out, hada_fft_columns_out to, __global const int *table, int width,
                             FFT_MEM float2 *scratches)
{
    const int n = table[FFT_LENGTH], points = table[FFT_POINTS], chirped = table[FFT_CHIRP] != 0;
    const int parts = HADA_FFT_BLOCK / width, images = to.images;
    const fft_side side = fft_side_of(width);
    const int w = side.w, tasks = (from.band / HADA_FFT_BLOCK + 1) * images * parts;
    __global const int *source = table + table[FFT_SOURCE], *place = table + table[FFT_PLACE];
    __global const float *chirp = FFT_FLOATS_OF(table) + table[FFT_CHIRP];
    FFT_MEM float2 *scratch = fft_own_scratch(scratches, table, width);
    for (int task = get_group_id(0); task < tasks; task += get_num_groups(0)) {
        const int image = task % images, part = task / images % parts, block = task / images / parts;
        __global const float *p = in + 2 * (from.offset + (ulong)((from.first + image) % from.count) * from.distance +
                                            (ulong)block * (ulong)n * 8 + part * width);
        __global float *q =
            out + 2 * (to.offset + (ulong)image * to.distance + (ulong)block * (ulong)to.rows * 8 + part * width);
#if FFT_PRODUCT
        __global const filter_value *f =
            (__global const filter_value *)filter +
            2 * (from.filter_offset + (ulong)image * from.filter_distance + (ulong)block * (ulong)n * 8 + part * width);
#endif
        FFT_SHARE (i, (chirped ? points * width : 0))
            scratch[i] = (float2)0.0f;
        FFT_WAIT();
        FFT_SHARE_SIDE(y, n, side)
        {
            const int row = source[y];
            float2 v = (float2)0.0f;
            if ((uint)(row - from.first_row) < (uint)from.rows || row >= from.last_row) {
                v = *(__global const float2 *)(p + 16 * (size_t)row + 2 * w);
#if FFT_PRODUCT
                v = filter_product(v, load_filter_value(f + 16 * (size_t)row + 2 * w));
#endif
            }
            fft_put_in(scratch, width, w, place[y], y, v, chirped, chirp);
        }
        FFT_MEM const float2 *result = fft_transform(scratch, side, table, FFT_FLOATS_OF(table));
        FFT_SHARE_SIDE(i, to.rows, side)
        {
            const int y = to.row0 + i;
            *(__global float2 *)(q + 16 * (size_t)i + 2 * w) =
                fft_take_out(result, width, w, place[y], y, chirped, chirp);
        }
        FFT_WAIT();
    }
}
