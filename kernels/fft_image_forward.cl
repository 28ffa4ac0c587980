/* Real images to half spectra, both passes in one work-item: it takes an image, which stays in local memory between the
 * passes, that is in the nearest caches of a CPU. For images small enough, in batches that occupy the device. Bit for
 * bit what fft_rows_forward and fft_cols make. */
#define FFT_ROWS_OUT __local
#define FFT_COLS_IN  __local
#include "inc_fft_cols.h"
#include "inc_fft_rows_forward.h"
#include "shared_fft.h"
#include "shared_local.h"

/* Arguments as those of fft_rows_forward and fft_cols. `local_memory`: scratch for the longer of both transforms, then
 * the rows' half spectra. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
fft_image_forward(__global const float *in, hada_fft_real real, __global float *out, hada_fft_spectra spectra,
                  __global const int *row_table, __global const int *column_table,
                  __local STATED_SIZE float8 *local_memory)
{
    const int rows = column_table[FFT_LENGTH], rows_in = real.rows, blocks = spectra.band / HADA_FFT_BLOCK + 1;
    __local float8 *scratch = local_memory;
    __local float *between = (__local float *)(local_memory + 2 * max(row_table[FFT_POINTS], column_table[FFT_POINTS]));
    for (int image = get_group_id(0); image < real.images; image += get_num_groups(0)) {
        for (int first = 0; first < rows_in; first += ROWS)
            fft_rows_forward_task(in + real.offset + (ulong)image * real.distance + (ulong)first * real.pitch,
                                  real.pitch, min(ROWS, rows_in - first), real.col0, real.cols,
                                  between + (real.row0 + first) * 16, rows, blocks, scratch, row_table,
                                  FFT_FLOATS_OF(row_table));
        for (int block = 0; block < blocks; ++block) {
            fft_columns columns;
            columns.in = between + block * rows * 16;
            columns.out = out + 2 * (spectra.offset + (ulong)image * spectra.distance + (ulong)block * (ulong)rows * 8);
            columns.first = real.row0;
            columns.count = rows_in;
            columns.last = rows;
            columns.row0 = 0;
            columns.rows_out = rows;
            columns.swapped = 0;
            fft_columns_block(&columns, scratch, column_table, FFT_FLOATS_OF(column_table));
        }
    }
}
