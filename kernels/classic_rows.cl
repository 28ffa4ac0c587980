/* Half spectra (as classic_columns.cl leaves them) to pixels, a step on the pixels, and their half spectra again,
 * sixteen rows at a time while they are in the cache. A work-item takes sixteen rows of one image. `inverse`: the
 * pixels come from the half spectra, else they are read from `images`; `forward`: half spectra are made, in place.
 *     ratio:    y = max(b, 0) / max(y, number)                            Richardson-Lucy; b is `first`
 *     residual: y = b - y
 *     momentum: z = max(0, v + alpha[channel] g), v = z + number (z - x), x = z    FISTA; g: from the half spectra,
 *     not kept; x is `first`, v is `images`
 * factors: of the momentum step alpha, by channel; of the others, where job.weighted, the weights of the frame's
 * values, as the frame (image_weighed() of inc_classic.h); else not read. partial: the momentum step's sums of (z -
 * x)^2, then those of z^2, of each work-item. */
#include "inc_fft_rows_forward.h"
#include "inc_fft_rows_inverse.h"

#include "inc_classic.h"
#include "shared_classic.h"
#include "shared_local.h"

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
classic_rows(__global float *spectra, __global float *images, __global float *first, __global float *work,
             __global const float *factors, hada_classic_rows job, __global const int *tables, __global float *partial,
             __local STATED_SIZE float8 *scratch)
{
    __global const int *table = tables, *back_table = tables + job.back_table;
    const int blocks = job.blocks, step = job.step, rows = job.rows, pitch = job.pitch, col0 = job.col0;
    const int cols = job.cols;
    const float number = job.number;
    const int groups = (rows + ROWS - 1) / ROWS, image = get_group_id(0) / groups;
    const int row = get_group_id(0) % groups * ROWS, count = min(ROWS, rows - row);
    const size_t pixels = ((size_t)image * rows + row) * pitch;
    __global float *values = spectra + ((size_t)image * blocks * rows + row) * 16;
    __global float *y = images + pixels, *x = first + pixels, *g = step == HADA_CLASSIC_MOMENTUM ? work + pixels : y;

    if (job.inverse)
        fft_rows_inverse_task(values, rows, count, table[FFT_LENGTH] / 2, g, pitch, col0, cols, job.scale, scratch,
                              back_table, FFT_FLOATS_OF(back_table));
    if (step == HADA_CLASSIC_MOMENTUM) {
        const float8 a = factors[image % job.channels];
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
    } else if (step && job.weighted) {
        __global const float *w = factors + pixels;
        for (int i = 0; i < count * pitch; i += 8)
            image_put(y, i, image_weighed(step, image_get(x, i), image_get(y, i), image_get(w, i), number));
    } else if (step == HADA_CLASSIC_RESIDUAL || step == HADA_CLASSIC_LEFT) {
        for (int i = 0; i < count * pitch; i += 8)
            image_put(y, i, image_get(x, i) - image_get(y, i));
    } else if (step == HADA_CLASSIC_RATIO) {
        for (int i = 0; i < count * pitch; i += 8)
            image_put(y, i, image_ratio(image_get(x, i), image_get(y, i), number));
    }
    if (job.forward)
        fft_rows_forward_task(y, pitch, count, col0, cols, values, rows, blocks, scratch, table, FFT_FLOATS_OF(table));
}
