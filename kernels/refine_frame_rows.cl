/* Where a sensor crops: half spectra of the frame's rows to the pixels of a = Hx + e' there, the data step on these,
 * e' = scale (a - b) (or what a pixel's weight keeps of that), and the half spectra of e', sixteen rows at a time while
 * they are in the cache. rows.pass: HADA_REFINE_TO_PIXELS makes a and e', else `duals` has e' already;
 * HADA_REFINE_TO_SPECTRA makes half spectra of e'.
 *
 * spectra, from complex number now.at on: complex [set * channel][block of eight columns][row of the frame][8]
 * duals: e' as [set * channel][row][column of the frame]; frame: b as [channel][row][column], from now.frame_offset on;
 * weights: as the frame, from the beginning on, NULL where now.has_weights is 0
 * partial: [set * channel][sixteen of rows], sums of e'^2
 * tables, scratch: as in refine_rows.cl. Dimension: sixteens of rows of all frames. */
#include "inc_fft_rows_forward.h"
#include "inc_fft_rows_inverse.h"
#include "inc_refine.h"
#include "shared_local.h"
#include "shared_refine.h"

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
refine_frame_rows(__global float *spectra, __global float *duals, __global const float *frame,
                  __global const float *weights, __global float *partial, hada_refine_data_step now,
                  hada_refine_rows rows, __global const int *tables, __local STATED_SIZE float8 *scratch)
{
    __global const int *table = tables, *back_table = tables + rows.back_table;
    const int groups = (rows.rows + ROWS - 1) / ROWS, plane = get_group_id(0) / groups, n = table[FFT_LENGTH];
    const int row = get_group_id(0) % groups * ROWS, count = min(ROWS, rows.rows - row);
    const int blocks = n / 16 + 1; /* of eight columns of the half spectrum */
    const size_t pixel = (size_t)row * rows.cols, area = (size_t)rows.rows * rows.cols;
    __global float *values = spectra + 2 * now.at + ((size_t)plane * blocks * rows.rows + row) * 16;
    __global float *e = duals + plane * area + pixel;
    const size_t at = plane % (int)now.channels * area + pixel;
    __global const float *b = frame + now.frame_offset + at, *w = weights + (now.has_weights ? at : 0);

    if (rows.pass & HADA_REFINE_TO_PIXELS) {
        fft_rows_inverse_task(values, rows.rows, count, n / 2, e, rows.cols, rows.col0, rows.cols, rows.scale, scratch,
                              back_table, FFT_FLOATS_OF(back_table));
        partial[now.sums + get_group_id(0)] =
            refine_data_step(e, b, 1, w, now.has_weights, 0, count * rows.cols, now.scale, now.mu);
    }
    if (rows.pass & HADA_REFINE_TO_SPECTRA)
        fft_rows_forward_task(e, rows.cols, count, rows.col0, rows.cols, values, rows.rows, blocks, scratch, table,
                              FFT_FLOATS_OF(table));
}
