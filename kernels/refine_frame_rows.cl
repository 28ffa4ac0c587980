/* Where a sensor crops: half spectra of the frame's rows (as refine_columns.cl has them) to the pixels of a = Hx + e'
 * there, the data step of refine_frame on these, e' = scale (a - b), and the half spectra of that again, sixteen rows
 * at a time while they stand in the cache. A work-item takes sixteen rows of one plane of `spectra`, from complex
 * number `at` on; plane p belongs to channel p % channels of the frame. rows.inverse: the data step is done on what the
 * half spectra give, else e' stands in `duals`; rows.forward: its half spectra are made, in place. partial[plane][group
 * of rows]: sum of e'^2. */
#include "inc_fft_rows_forward.h"
#include "inc_fft_rows_inverse.h"
#include "inc_refine.h"
#include "shared_local.h"
#include "shared_refine.h"

/* e' = scale (a - b) in place; the sum of its squares. */
REFINE_INLINE float data_step(__global float *a, __global const float *b, int pixels, float scale)
{
    const int whole = pixels / 8 * 8;
    float8 lanes = 0.0f;
    for (int i = 0; i < whole; i += 8) {
        const float8 v = (vload8(0, a + i) - vload8(0, b + i)) * scale;
        VECTORS_STORE8(__global, v, a + i);
        lanes = fma(v, v, lanes);
    }
    float sum = refine_sum(lanes);
    for (int i = whole; i < pixels; ++i) {
        const float v = (a[i] - b[i]) * scale;
        a[i] = v;
        sum = fma(v, v, sum);
    }
    return sum;
}

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
refine_frame_rows(__global float *spectra, __global float *duals, __global const float *frame, __global float *partial,
                  hada_refine_data_step now, hada_refine_rows rows, __global const int *tables,
                  __local STATED_SIZE float8 *scratch)
{
    __global const int *table = tables, *back_table = tables + rows.back_table;
    const int groups = (rows.rows + ROWS - 1) / ROWS, plane = get_group_id(0) / groups, n = table[FFT_LENGTH];
    const int row = get_group_id(0) % groups * ROWS, count = min(ROWS, rows.rows - row);
    const int blocks = n / 16 + 1; /* of eight columns of the half spectrum */
    const size_t pixel = (size_t)row * rows.cols, area = (size_t)rows.rows * rows.cols;
    __global float *values = spectra + 2 * now.at + ((size_t)plane * blocks * rows.rows + row) * 16;
    __global float *e = duals + plane * area + pixel;
    __global const float *b = frame + now.frame_offset + plane % (int)now.channels * area + pixel;

    if (rows.inverse) {
        fft_rows_inverse_task(values, rows.rows, count, n / 2, e, rows.cols, rows.col0, rows.cols, rows.scale, scratch,
                              back_table, FFT_FLOATS_OF(back_table));
        partial[now.sums + get_group_id(0)] = data_step(e, b, count * rows.cols, now.scale);
    }
    if (rows.forward)
        fft_rows_forward_task(e, rows.cols, count, rows.col0, rows.cols, values, rows.rows, blocks, scratch, table,
                              FFT_FLOATS_OF(table));
}
