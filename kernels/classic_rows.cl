/* Half spectra of columns (as classic_columns.cl has them) to pixels, a step on the pixels, and their half spectra
 * again, sixteen rows at a time while they stand in the cache. A work-item takes sixteen rows of one image.
 * `inverse`: the pixels come from the half spectra, else they are as they stand in `images`; `forward`: their half
 * spectra are made, in place.
 *     step 1: y = max(b, 0) / max(y, number)                            Richardson-Lucy; b is `first`
 *     step 3: y = b - y                                                 what is left of the frame
 *     step 4: z = max(0, v + alpha[channel] g), v = z + number (z - x), x = z    FISTA; g: from the half spectra,
 *             not kept; x is `first`, v is `images`
 * partial: step 4's sums of (z - x)^2, then those of z^2, of each work-item. */
#include "inc_fft_rows_forward.h"
#include "inc_fft_rows_inverse.h"

#include "inc_classic.h"

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
classic_rows(__global float *spectra, int blocks, int inverse, int forward, __global float *images,
             __global float *first, __global float *work, int step, float number, __global const float *alpha,
             int channels, int rows, int pitch, int col0, int cols, float scale, __global const int *back_table,
             __global const float *back_floats, __global const int *table, __global const float *floats,
             __global float *partial, __local float8 *scratch)
{
    const int groups = (rows + ROWS - 1) / ROWS, image = get_group_id(0) / groups;
    const int row = get_group_id(0) % groups * ROWS, count = min(ROWS, rows - row);
    const size_t pixels = ((size_t)image * rows + row) * pitch;
    __global float *values = spectra + ((size_t)image * blocks * rows + row) * 16;
    __global float *y = images + pixels, *x = first + pixels, *g = step == 4 ? work + pixels : y;

    if (inverse)
        fft_rows_inverse_task(values, rows, count, table[FFT_LENGTH] / 2, g, pitch, col0, cols, scale, scratch,
                              back_table, back_floats);
    if (step == 4) {
        const float8 a = alpha[image % channels];
        float8 change = 0.0f, size = 0.0f;
        for (int i = 0; i < count * pitch; i += 8) {
            const float8 z = max(fma(a, image_get(g, i), image_get(y, i)), 0.0f), move = z - image_get(x, i);
            change = fma(move, move, change);
            size = fma(z, z, size);
            image_put(x, i, z);
            image_put(y, i, fma((float8)number, move, z));
        }
        partial[get_group_id(0)] = refine_sum(change);
        partial[get_num_groups(0) + get_group_id(0)] = refine_sum(size);
    } else if (step == 3) {
        for (int i = 0; i < count * pitch; i += 8)
            image_put(y, i, image_get(x, i) - image_get(y, i));
    } else if (step == 1) {
        for (int i = 0; i < count * pitch; i += 8)
            image_put(y, i, max(image_get(x, i), 0.0f) / max(image_get(y, i), number));
    }
    if (forward)
        fft_rows_forward_task(y, pitch, count, col0, cols, values, rows, blocks, scratch, table, floats);
}
