/* Half spectra of rows to the planes' pixels, the proximal step of non-negativity on these, and their half spectra
 * again, sixteen rows at a time while they are in the cache; rows.pass says which of these steps are done.
 *
 * spectra: complex [plane][block of eight columns][row of the window][8], in place; planes: [plane][row][column of the
 * window]; tables: the forward transform along rows, from rows.back_table on the inverse one (shared_fft_table.h);
 * scratch: sixteen rows of the grid. Dimension: sixteens of rows of all planes. */
#include "inc_fft_rows_forward.h"
#include "inc_fft_rows_inverse.h"
#include "shared_local.h"
#include "shared_refine.h"

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void refine_rows(__global float *spectra,
                                                                         __global float *planes, hada_refine_rows rows,
                                                                         __global const int *tables,
                                                                         __local STATED_SIZE float8 *scratch)
{
    __global const int *table = tables, *back_table = tables + rows.back_table;
    const int groups = (rows.rows + ROWS - 1) / ROWS, plane = get_group_id(0) / groups, n = table[FFT_LENGTH];
    const int row = get_group_id(0) % groups * ROWS, count = min(ROWS, rows.rows - row), pixels = count * rows.cols;
    const int blocks = n / 16 + 1; /* of eight columns of the half spectrum */
    __global float *values = spectra + ((size_t)plane * blocks * rows.rows + row) * 16;
    __global float *u = planes + ((size_t)plane * rows.rows + row) * rows.cols;

    if (rows.pass & HADA_REFINE_TO_PIXELS)
        fft_rows_inverse_task(values, rows.rows, count, n / 2, u, rows.cols, rows.col0, rows.cols, rows.scale, scratch,
                              back_table, FFT_FLOATS_OF(back_table));
    if (rows.pass & HADA_REFINE_CLIP) {
        const int whole = pixels / 8 * 8;
        for (int i = 0; i < whole; i += 8)
            VECTORS_STORE8(__global, max(vload8(0, u + i), 0.0f), u + i);
        for (int i = whole; i < pixels; ++i)
            u[i] = max(u[i], 0.0f);
    }
    if (rows.pass & HADA_REFINE_TO_SPECTRA)
        fft_rows_forward_task(u, rows.cols, count, rows.col0, rows.cols, values, rows.rows, blocks, scratch, table,
                              FFT_FLOATS_OF(table));
}
