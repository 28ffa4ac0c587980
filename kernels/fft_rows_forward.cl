/* Real rows to half spectra: a work-item takes sixteen rows of one image. */
#include "inc_fft_rows_forward.h"

/* Offsets and distances of the real images count floats, those of spectra complex numbers. The image's columns
 * col0..col0+cols_in-1 are in memory, the others are zero; its rows go to the spectrum's rows row0 and on. */
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
