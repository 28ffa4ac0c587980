/* Half spectra to real images, both passes in one work-item: it takes an image, which stays in local memory between the
 * passes, that is in the nearest caches of a CPU. For images small enough, in batches that occupy the device. Bit for
 * bit what fft_cols and fft_rows_inverse make. */
#define FFT_COLS_OUT __local
#define FFT_ROWS_IN  __local
#include "inc_fft_cols.h"
#include "inc_fft_rows_inverse.h"
#include "shared_fft.h"
#include "shared_local.h"

/* Arguments as those of fft_cols and fft_rows_inverse. `local_memory`: scratch for the longer of both transforms, then
 * the rows' half spectra. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
fft_image_inverse(__global const float *in, hada_fft_columns_in from, __global const void *filter, __global float *out,
                  hada_fft_real real, __global const int *row_table, __global const int *column_table,
                  __local STATED_SIZE float8 *local_memory)
{
    const int rows = column_table[FFT_LENGTH], rows_out = real.rows, band = from.band;
    __local float8 *scratch = local_memory;
    __local float *between = (__local float *)(local_memory + 2 * max(row_table[FFT_POINTS], column_table[FFT_POINTS]));
    for (int image = get_group_id(0); image < real.images; image += get_num_groups(0)) {
        for (int block = 0; block <= band / HADA_FFT_BLOCK; ++block) {
            const fft_columns columns = fft_columns_of(in, from, filter, image, block, rows,
                                                       between + block * rows_out * 16, real.row0, rows_out);
            fft_columns_block(&columns, scratch, column_table, FFT_FLOATS_OF(column_table));
        }
        for (int first = 0; first < rows_out; first += ROWS)
            fft_rows_inverse_task(between + first * 16, rows_out, min(ROWS, rows_out - first), band,
                                  out + real.offset + (ulong)image * real.distance + (ulong)first * real.pitch,
                                  real.pitch, real.col0, real.cols, real.scale, scratch, row_table,
                                  FFT_FLOATS_OF(row_table));
    }
}
