/* Half spectra to real images, both passes in one work-item: it takes an image, which stays in local memory between the
 * passes, that is in the nearest caches of a CPU. For images small enough, in batches that occupy the device. Bit for
 * bit what fft_cols and fft_rows_inverse make. */
#define FFT_COLS_OUT __local
#define FFT_ROWS_IN  __local
#include "inc_fft_cols.h"
#include "inc_fft_rows_inverse.h"

/* Arguments as those of fft_cols and fft_rows_inverse. `local_memory`: scratch for the longer of both transforms, then
 * the rows' half spectra. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
fft_image_inverse(__global const float *in, ulong in_offset, ulong in_distance, int in_count,
                  __global const void *filter, ulong filter_offset, ulong filter_distance, int row0, int rows_out,
                  int band_rows, int band, __global float *out, ulong out_offset, ulong out_distance, ulong out_pitch,
                  int col0, int cols_out, float scale, int images, __global const int *row_table,
                  __global const float *row_floats, __global const int *column_table,
                  __global const float *column_floats, __local float8 *local_memory)
{
    const int rows = column_table[FFT_LENGTH];
    __local float8 *scratch = local_memory;
    __local float *between = (__local float *)(local_memory + 2 * max(row_table[FFT_POINTS], column_table[FFT_POINTS]));
    for (int image = get_group_id(0); image < images; image += get_num_groups(0)) {
        for (int block = 0; block <= band / 8; ++block) {
            fft_columns columns;
            columns.in =
                in + 2 * (in_offset + (ulong)(image % in_count) * in_distance + (ulong)block * (ulong)rows * 8);
            columns.out = between + block * rows_out * 16;
            columns.first = 0;
            columns.count = band_rows + 1;
            columns.last = rows - band_rows;
            columns.row0 = row0;
            columns.rows_out = rows_out;
            columns.filter = (__global const filter_value *)filter;
#if FFT_PRODUCT
            columns.filter += 2 * (filter_offset + (ulong)image * filter_distance + (ulong)block * (ulong)rows * 8);
#endif
            fft_columns_block(&columns, scratch, column_table, column_floats);
        }
        for (int first = 0; first < rows_out; first += ROWS)
            fft_rows_inverse_task(between + first * 16, rows_out, min(ROWS, rows_out - first), band,
                                  out + out_offset + (ulong)image * out_distance + (ulong)first * out_pitch, out_pitch,
                                  col0, cols_out, scale, scratch, row_table, row_floats);
    }
}
