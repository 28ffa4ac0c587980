/* Transforms along rows and along columns of images of any size, for devices with vectors in a work-item. */
#include "inc_fft_cols.h"
#include "inc_fft_rows_forward.h"
#include "inc_fft_rows_inverse.h"
#include "shared_fft.h"

#if !FFT_PRODUCT /* products are for columns alone */

/* Real rows to half spectra: a work-item takes sixteen rows of one image. What is outside the rectangle is zero; the
 * rows go to the spectrum's rows row0 and on. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
fft_rows_forward(__global const float *in, hada_fft_real real, __global float *out, hada_fft_spectra spectra,
                 __global const int *table, FFT_MEM FFT_STATED_SIZE float8 *scratches)
{
    FFT_MEM float8 *scratch = fft_own_scratch(scratches, table[FFT_POINTS]);
    const int groups = (real.rows + ROWS - 1) / ROWS, tasks = groups * real.images;
    for (int task = get_group_id(0); task < tasks; task += get_num_groups(0)) {
        const int image = task / groups, first = task % groups * ROWS;
        const ulong to = spectra.offset + (ulong)image * spectra.distance + (ulong)(real.row0 + first) * 8;
        fft_rows_forward_task(in + real.offset + (ulong)image * real.distance + (ulong)first * real.pitch, real.pitch,
                              min(ROWS, real.rows - first), real.col0, real.cols, out + 2 * to, spectra.rows,
                              spectra.band / HADA_FFT_BLOCK + 1, scratch, table, FFT_FLOATS_OF(table));
    }
}

/* Half spectra to real rows: a work-item takes sixteen rows of one image. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
fft_rows_inverse(__global const float *in, hada_fft_spectra spectra, __global float *out, hada_fft_real real,
                 __global const int *table, FFT_MEM FFT_STATED_SIZE float8 *scratches)
{
    FFT_MEM float8 *scratch = fft_own_scratch(scratches, table[FFT_POINTS]);
    const int groups = (spectra.rows + ROWS - 1) / ROWS, tasks = groups * real.images;
    for (int task = get_group_id(0); task < tasks; task += get_num_groups(0)) {
        const int image = task / groups, first = task % groups * ROWS;
        fft_rows_inverse_task(in + 2 * (spectra.offset + (ulong)image * spectra.distance + (ulong)first * 8),
                              spectra.rows, min(ROWS, spectra.rows - first), spectra.band,
                              out + real.offset + (ulong)image * real.distance + (ulong)first * real.pitch, real.pitch,
                              real.col0, real.cols, real.scale, scratch, table, FFT_FLOATS_OF(table));
    }
}

#endif

/* Transforms along the columns of half spectra: a work-item takes one block of eight columns of one image. The
 * work-items (column block, image) count images fastest, so that a spectrum's block is still in cache when the next
 * filter is applied to it. */
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
fft_cols(__global const float *in, hada_fft_columns_in from, __global const void *filter, __global float *out,
         hada_fft_columns_out to, __global const int *table, FFT_MEM FFT_STATED_SIZE float8 *scratches)
{
    FFT_MEM float8 *scratch = fft_own_scratch(scratches, table[FFT_POINTS]);
    const int images = to.images, tasks = (from.band / HADA_FFT_BLOCK + 1) * images;
    for (int task = get_group_id(0); task < tasks; task += get_num_groups(0)) {
        const int block = task / images, image = task % images;
        __global float *to_block =
            out + 2 * (to.offset + (ulong)image * to.distance + (ulong)block * (ulong)to.rows * 8);
        const fft_columns columns =
            fft_columns_of(in, from, filter, image, block, table[FFT_LENGTH], to_block, to.row0, to.rows);
        fft_columns_block(&columns, scratch, table, FFT_FLOATS_OF(table));
    }
}
