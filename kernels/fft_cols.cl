/* Transforms along the columns of half spectra: a work-item takes one block of eight columns of one image. */
#include "inc_fft_cols.h"

/* The work-items (column block, image) count images fastest, so that a spectrum's block is still in cache when the
 * next filter is applied to it. Distances and offsets are in complex numbers. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
fft_cols(__global const float *in, ulong in_offset, ulong in_distance, int in_count, int first,
         __global const void *filter, ulong filter_offset, ulong filter_distance, int first_row, int rows_in, int last_row,
         __global float *out, ulong out_offset, ulong out_distance, int row0, int rows_out, int images, int tasks,
         __global const int *table, __global const float *floats, FFT_MEM float8 *scratches)
{
#if FFT_SCRATCH_GLOBAL
    __global float8 *scratch = scratches + get_group_id(0) * (size_t)(2 * table[FFT_POINTS]);
#else
    __local float8 *scratch = scratches;
#endif
    for (int task = get_group_id(0); task < tasks; task += get_num_groups(0)) {
        const int block = task / images, image = task % images;
        const int n = table[FFT_LENGTH];
        fft_columns columns;
        columns.in =
            in + 2 * (in_offset + (ulong)((first + image) % in_count) * in_distance + (ulong)block * (ulong)n * 8);
        columns.out = out + 2 * (out_offset + (ulong)image * out_distance + (ulong)block * (ulong)rows_out * 8);
        columns.first = first_row;
        columns.count = rows_in;
        columns.last = last_row;
        columns.row0 = row0;
        columns.rows_out = rows_out;
        columns.filter = (__global const filter_value *)filter;
#if FFT_PRODUCT
        columns.filter += 2 * (filter_offset + (ulong)image * filter_distance + (ulong)block * (ulong)n * 8);
#endif
        fft_columns_block(&columns, scratch, table, floats);
    }
}
