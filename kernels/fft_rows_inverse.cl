/* Half spectra to real rows: a work-item takes sixteen rows of one image. */
#include "inc_fft_rows_inverse.h"

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
