/* Transforms along rows and along columns of images of any size, for devices with vectors in a work-item. */
#include "inc_fft_cols.h"
#include "inc_fft_rows_forward.h"
#include "inc_fft_rows_inverse.h"

#if !FFT_PRODUCT /* products are for columns alone */

/* Real rows to half spectra: a work-item takes sixteen rows of one image. Offsets and distances of the real images
 * count floats, those of spectra complex numbers. The image's columns col0..col0+cols_in-1 are in memory, the others
 * are zero; its rows go to the spectrum's rows row0 and on. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
fft_rows_forward(__global const float *in, ulong in_offset, ulong in_distance, ulong in_pitch, int col0, int cols_in,
                 int rows_in, __global float *out, ulong out_offset, ulong out_distance, int row0, int rows, int blocks,
                 int tasks, __global const int *table, __global const float *floats, FFT_MEM float8 *scratches)
{
#if FFT_SCRATCH_GLOBAL
    __global float8 *scratch = scratches + get_group_id(0) * (size_t)(2 * table[FFT_POINTS]);
#else
    __local float8 *scratch = scratches;
#endif
    const int groups = (rows_in + ROWS - 1) / ROWS;
    for (int task = get_group_id(0); task < tasks; task += get_num_groups(0)) {
        const int image = task / groups, first = task % groups * ROWS;
        fft_rows_forward_task(in + in_offset + (ulong)image * in_distance + (ulong)first * in_pitch, in_pitch,
                              min(ROWS, rows_in - first), col0, cols_in,
                              out + 2 * (out_offset + (ulong)image * out_distance + (ulong)(row0 + first) * 8), rows,
                              blocks, scratch, table, floats);
    }
}

/* Half spectra to real rows: a work-item takes sixteen rows of one image. */

/* Offsets and distances of the real images count floats, those of spectra complex numbers. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
fft_rows_inverse(__global const float *in, ulong in_offset, ulong in_distance, int rows_in, int band,
                 __global float *out, ulong out_offset, ulong out_distance, ulong out_pitch, int col0, int cols_out,
                 float scale, int tasks, __global const int *table, __global const float *floats,
                 FFT_MEM float8 *scratches)
{
#if FFT_SCRATCH_GLOBAL
    __global float8 *scratch = scratches + get_group_id(0) * (size_t)(2 * table[FFT_POINTS]);
#else
    __local float8 *scratch = scratches;
#endif
    const int groups = (rows_in + ROWS - 1) / ROWS;
    for (int task = get_group_id(0); task < tasks; task += get_num_groups(0)) {
        const int image = task / groups, first = task % groups * ROWS;
        fft_rows_inverse_task(in + 2 * (in_offset + (ulong)image * in_distance + (ulong)first * 8), rows_in,
                              min(ROWS, rows_in - first), band,
                              out + out_offset + (ulong)image * out_distance + (ulong)first * out_pitch, out_pitch,
                              col0, cols_out, scale, scratch, table, floats);
    }
}

#endif

/* Transforms along the columns of half spectra: a work-item takes one block of eight columns of one image. */

/* The work-items (column block, image) count images fastest, so that a spectrum's block is still in cache when the
 * next filter is applied to it. Distances and offsets are in complex numbers. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
fft_cols(__global const float *in, ulong in_offset, ulong in_distance, int in_count, int first,
         __global const void *filter, ulong filter_offset, ulong filter_distance, int first_row, int rows_in,
         int last_row, __global float *out, ulong out_offset, ulong out_distance, int row0, int rows_out, int images,
         int tasks, __global const int *table, __global const float *floats, FFT_MEM float8 *scratches)
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
