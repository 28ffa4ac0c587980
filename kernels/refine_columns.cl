/* A step of the refinement along columns: the planes' half spectra of rows, which stand as [plane][block of eight
 * columns][row of the window][8], become U by a forward transform, U and the last W the next W by the linear step of
 * refine.cl, and that half spectra of rows again, while a block of columns of all depths of a set stands in the cache.
 * Spectra U stand nowhere. Where a sensor crops, E and A go the same way: E comes from half spectra of the frame's
 * rows, which stand from now.split_e on as those of planes do, and A goes there.
 *
 * Arguments as in refine_solve; cold: nothing is read of the planes. Dimensions: blocks of columns, channels, sets.
 * `scratch`: a column block for each depth of a set, and one where a sensor crops. partial[set][channel][block]: as
 * there. */
#include "inc_fft_convolve.h"
#include "inc_refine_step.h"
#include "shared_local.h"

/* The linear step at eight frequencies, number i of a spectrum. `scratch`: U of the first depth there, those of the
 * others every `each` values on, and behind them E; it takes the next W and A, real and imaginary parts changed over.
 */
REFINE_INLINE float8 solve(const hada_refine_step *now, __global const float *h, size_t h_step, __global const int *z,
                           __global const float *b, __global float *a, __global const float *prior, __global float *w,
                           size_t w_step, size_t i, __local float8 *scratch, int each)
{
    const int depths = now->problem.depths, cold = now->start == HADA_REFINE_COLD;
    const int further = now->start == HADA_REFINE_CONTINUE;
    refine_joint joint = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    float8 y_re, y_im, e_re = 0.0f, e_im = 0.0f, f_re, f_im;
    for (int s = 0; s < depths; ++s) {
        float8 h_re, h_im, u_re = 0.0f, u_im = 0.0f, w_re = 0.0f, w_im = 0.0f;
        refine_get(h + z[s] * h_step, i, &h_re, &h_im);
        if (!cold) {
            u_re = scratch[s * each];
            u_im = scratch[s * each + 1];
        }
        if (further)
            refine_get(w + s * w_step, i, &w_re, &w_im);
        refine_add_depth(&joint, now, h_re, h_im, u_re, u_im, w_re, w_im);
    }
    if (now->padded && further) {
        e_re = scratch[depths * each];
        e_im = scratch[depths * each + 1];
    }
    refine_data(now, b, a, i, e_re, e_im, &y_re, &y_im);
    const float8 r_re = y_re - joint.hu_re, r_im = y_im - joint.hu_im;
    const float8 g = now->has_prior ? now->rho + refine_get_real(prior, i) : (float8)now->rho;
    const float8 per_g = refine_share_out(&joint, now, g, y_re, y_im, &f_re, &f_im);
    if (now->padded) {
        float8 a_re, a_im;
        refine_next_split(now, y_re, y_im, e_re, e_im, f_re, f_im, &a_re, &a_im);
        refine_put(a, i, a_re, a_im);
        scratch[depths * each] = a_im;
        scratch[depths * each + 1] = a_re;
    }
    for (int s = 0; s < depths; ++s) {
        float8 h_re, h_im, u_re = 0.0f, u_im = 0.0f, w_re = 0.0f, w_im = 0.0f;
        refine_get(h + z[s] * h_step, i, &h_re, &h_im);
        if (!cold) {
            u_re = scratch[s * each];
            u_im = scratch[s * each + 1];
        }
        if (further)
            refine_get(w + s * w_step, i, &w_re, &w_im);
        refine_next(now, per_g, f_re, f_im, h_re, h_im, u_re, u_im, &w_re, &w_im);
        refine_put(w + s * w_step, i, w_re, w_im);
        scratch[s * each] = w_im;
        scratch[s * each + 1] = w_re;
    }
    return fma(r_re, r_re, r_im * r_im);
}

__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void
refine_columns(__global float *planes, __global const float *otf, __global const int *list, __global const float *frame,
               __global const float *prior, __global float *now_w, __global float *split, __global float *partial,
               hada_refine_step now, hada_refine_rows rows, hada_refine_rows frame_rows, __global const int *table,
               __local STATED_SIZE float8 *scratch)
{
    const int depths = now.problem.depths, padded = now.padded, n = table[FFT_LENGTH];
    __global const int *place = table + table[FFT_PLACE];
    __global const float *floats = FFT_FLOATS_OF(table);
    const uint block = get_group_id(0), blocks = get_num_groups(0), cols = now.problem.spectrum.cols;
    const uint channel = get_group_id(1), channels = get_num_groups(1), set = get_group_id(2);
    const size_t count = now.problem.spectrum.count, step = 2 * (size_t)channels * count;
    const size_t first = (size_t)set * depths * channels + channel;
    __global const float *h = otf + 2 * (now.problem.otf_offset + channel * count);
    __global const float *b = frame + 2 * (now.problem.frame_offset + channel * count);
    __global const float *p = prior + (now.has_prior ? channel * count : 0);
    __global float *w = now_w + 2 * first * count, *a = split + (padded ? 2 * (set * channels + channel) * count : 0);
    __global float *half_a = split + (padded ? 2 * now.split_e : 0);
    const fft_columns cropped =
        fft_window_block(half_a, (set * channels + channel) * blocks + block, frame_rows.row0, frame_rows.rows);
    __global const int *z = list + set * (uint)depths;
    float8 sum = 0.0f;
    if (now.start != HADA_REFINE_COLD)
        for (int s = 0; s < depths; ++s) {
            const fft_columns plane =
                fft_window_block(planes, (first + s * channels) * blocks + block, rows.row0, rows.rows);
            fft_enter(&plane, scratch + s * 2 * n, table, floats);
        }
    if (padded && now.start == HADA_REFINE_CONTINUE)
        fft_enter(&cropped, scratch + depths * 2 * n, table, floats);
    for (int row = 0; row < n; ++row) {
        const uint i = (block * (uint)n + row) * 8;
        sum +=
            refine_count(solve(&now, h, step, z, b, a, p, w, step, i, scratch + 2 * place[row], 2 * n), i, n, 8, cols);
    }
    for (int s = 0; s < depths; ++s) {
        const fft_columns plane =
            fft_window_block(planes, (first + s * channels) * blocks + block, rows.row0, rows.rows);
        fft_leave(&plane, scratch + s * 2 * n, table, floats);
    }
    if (padded)
        fft_leave(&cropped, scratch + depths * 2 * n, table, floats);
    partial[now.problem.sums.first + (set * channels + channel) * blocks + block] = refine_sum(sum);
}
