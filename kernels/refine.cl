/* The refinement's steps over frequencies and over pixels, in one program, as a refinement needs nearly all of them.
 * Spectra are half spectra (inc_spectrum.h) of `count` complex numbers, as two floats each. */
#include "inc_refine_step.h"
#include "inc_spectrum.h"

/* The linear step of the refinement at every frequency: all depths of a set jointly (Sherman-Morrison).
 *
 * Per depth z of the set, U = F(u) and W = F(x + d) of the last step are read, W of this step is written in place:
 *     D = keep (W - U),   V = U - D       (keep: the last step's rho over this one's, as the dual is scaled by rho)
 *     X = argmin |Y - sum H X|^2 + prior |X|^2 + rho sum |X - V|^2
 *       = (rho V + conj(H) e) / g,   e = (g Y - rho sum H V) / (g + sum |H|^2),   g = rho + prior
 *     W = X' + D, X' = over X + (1 - over) U
 * The data Y is the frame's spectrum B. Where a sensor crops (padded), it is Y = v - e' of the further split
 * v = sum H X, kept as A = F(Hx + e') and E = F(e'): Y = A - 2 E, and A is written for this step.
 *
 * Dimensions: slices of frequencies, channels, sets. OTFs stand as [depth][channel][count], U and W as
 * [set][place in the set][channel][count], from now.split on A behind W and E behind U as [set][channel][count], B and
 * prior as [channel][count].
 * now.start: cold, the first step from u = d = 0; warm, from U (d = 0); on, a further step.
 * partial[set][channel][slice]: sum of |B - sum H U|^2 over the whole spectrum (of the start's U: not padded, or
 * start). */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_solve(__global const float *otf, __global const int *list, __global const float *frame,
             __global const float *prior, __global const float *now_u, __global float *now_w, __global float *partial,
             hada_refine_step now)
{
    REFINE_LOCAL
    const hada_refine_problem problem = now.problem;
    const uint count = problem.spectrum.count, slice = problem.sums.slice, rows = problem.spectrum.rows;
    const uint block = problem.spectrum.block, cols = problem.spectrum.cols;
    const int padded = now.padded;
    const uint channel = get_global_id(1), channels = get_global_size(1), set = get_global_id(2);
    const uint from = get_group_id(0) * slice, to = min(count, from + slice);
    const size_t plane = (size_t)set * channels + channel;
    const refine_channel at = refine_channel_step(&now, set, channel, channels, otf, list, frame, prior, now_w);
    const refine_held held = {now_u + 2 * at.first * count, now_u + 2 * (now.split + plane * count), at.step};
    refine_real sum = (refine_real)0.0f;
    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH)
        sum += refine_count(refine_step_at(&now, &at, padded, i, held), i, rows, block, cols);
    REFINE_PARTIAL(partial, (problem.sums.first + plane * get_num_groups(0) + get_group_id(0)), refine_sum(sum))
}

/* The residual of a set: residual[set][channel] = B - sum over its depths of H U, at every frequency, and as
 * partial[set][channel][slice] the sum over the whole spectrum of |residual|^2. Arguments as in refine_solve; residual:
 * NULL where has_residual is 0. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_explain(__global const float *otf, __global const int *list, __global const float *frame,
               __global const float *now_u, __global float *residual, int has_residual, __global float *partial,
               hada_refine_problem problem)
{
    REFINE_LOCAL
    const uint count = problem.spectrum.count, slice = problem.sums.slice, rows = problem.spectrum.rows;
    const uint block = problem.spectrum.block, cols = problem.spectrum.cols;
    const int depths = problem.depths;
    const uint channel = get_global_id(1), channels = get_global_size(1), set = get_global_id(2);
    const uint from = get_group_id(0) * slice, to = min(count, from + slice);
    const size_t plane = (size_t)set * channels + channel;
    const refine_channel at = refine_channel_of(&problem, set, channel, channels, otf, list, frame);
    __global const float *u = now_u + 2 * at.first * count;
    refine_real sum = (refine_real)0.0f;

    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        refine_real r_re, r_im;
        refine_get(at.b, i, &r_re, &r_im);
        for (int s = 0; s < depths; ++s) {
            refine_real h_re, h_im, u_re, u_im;
            refine_get(at.h + (size_t)at.z[s] * at.step, i, &h_re, &h_im);
            refine_get(u + (size_t)s * at.step, i, &u_re, &u_im);
            refine_take_off(&r_re, &r_im, h_re, h_im, u_re, u_im);
        }
        sum += refine_count(fma(r_re, r_re, r_im * r_im), i, rows, block, cols);
        if (has_residual)
            refine_put(residual + 2 * plane * count, i, r_re, r_im);
    }
    REFINE_PARTIAL(partial, (problem.sums.first + plane * get_num_groups(0) + get_group_id(0)), refine_sum(sum))
}

/* How badly a set explains what the channels have in common, within a band: partial[set][slice] is the sum, over the
 * frequencies of the whole spectrum with 2 |ky| < band_rows and 2 |kx| < band_cols, of
 *     (|mean residual|^2 + mean(prior sum |U|^2) / channels) / (1 + mean(sum variance |U|^2)),
 *     residual = B - sum H U,
 * means over channels, sums over the set's depths; prior and variance are 0 where they are not given. With depths 0 it
 * is the energy of the frame's own mean. Dimensions: slices of frequencies, sets. Arrays as in refine_solve; variance
 * as the OTFs, real. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_score(__global const float *otf, __global const int *list, __global const float *frame,
             __global const float *now_u, __global const float *prior, __global const float *variance,
             __global float *partial, hada_refine_problem problem, hada_refine_band band)
{
    REFINE_LOCAL
    const uint count = problem.spectrum.count, slice = problem.sums.slice, channels = problem.channels;
    const uint rows = problem.spectrum.rows, block = problem.spectrum.block, cols = problem.spectrum.cols;
    const int depths = problem.depths;
    const uint set = get_global_id(1);
    const uint from = get_group_id(0) * slice, to = min(count, from + slice);
    __global const int *z = list + set * (uint)depths;
    const refine_real none = (refine_real)0.0f;
    refine_real sum = none;

    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        const uint ky = i / block % rows; /* the same for all lanes: vectors need blocks of eight columns */
        if (2 * min(ky, rows - ky) >= band.rows || 2 * (i / (rows * block) * block + i % block) >= band.cols)
            continue;
        refine_left left = {none, none, none, none};
        for (uint c = 0; c < channels; ++c) {
            const refine_held held = {now_u + 2 * ((size_t)set * (uint)depths * channels + c) * count, now_u,
                                      2 * (size_t)channels * count};
            refine_add_channel(&left, &problem, band, z, c, i, otf, frame, prior, variance, held);
        }
        const refine_real energy = refine_badness(&left, channels);
        sum += refine_count(refine_band(energy, i, rows, block, band.cols), i, rows, block, cols);
    }
    REFINE_PARTIAL(partial, (problem.sums.first + (size_t)set * get_num_groups(0) + get_group_id(0)), refine_sum(sum))
}

/* The data step where a sensor crops: a (the split variable plus its dual, within the frame) becomes the dual
 *     e = (a - b) w / (w + mu),
 * in place; b is the frame (use_frame 0: b is taken as 0, for plain energies), w a pixel's weight (inc_refine.h),
 * without weights 1. partial[plane][slice]: sum of e^2. Dimensions: slices of pixels, planes; plane p belongs to
 * channel p % channels of the frame and of the weights. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_frame(__global float *a, __global const float *frame, __global const float *weights, __global float *partial,
             hada_refine_frame_step now)
{
    REFINE_LOCAL
    const uint slice = now.sums.slice, pixels = now.pixels;
    const uint plane = get_global_id(1);
    const uint from = get_group_id(0) * slice, to = min(pixels, from + slice);
    __global float *e = a + (size_t)plane * pixels;
    const size_t channel = (size_t)(plane % now.channels) * pixels;
    __global const float *b = frame + (now.use_frame ? now.frame_offset + channel : 0);
    __global const float *w = weights + (now.has_weights ? channel : 0);
    const float sum = refine_data_step(e, b, now.use_frame, w, now.has_weights, from, to, now.scale, now.mu);
    REFINE_PARTIAL(partial, (now.sums.first + (size_t)plane * get_num_groups(0) + get_group_id(0)), sum)
}

/* The proximal step, over an array of vectors: the planes, one after the other, padded at the end. u = max(0, w) in
 * place: w = x + d in the window. Outside it u is 0 and nothing is stored. */
__kernel void refine_prox(__global float *w)
{
    const size_t i = get_global_id(0);
    VECTORS_STORE8(__global, max(vload8(i, w), 0.0f), w + 8 * i);
}

/* Part of images of rows x cols: what begins at (row0, col0) and has to_cols columns. Dimensions: columns of the part
 * or more, its rows, images. */
__kernel void refine_part(__global const float *in, __global float *out, int rows, int cols, int row0, int col0,
                          int to_cols)
{
    const int col = get_global_id(0), row = get_global_id(1), image = get_global_id(2);
    if (col < to_cols)
        out[((size_t)image * get_global_size(1) + row) * to_cols + col] =
            in[((size_t)image * rows + row0 + row) * cols + col0 + col];
}

/* From spectra of the whole grid to those of a coarse grid, channels averaged: out[image] = factor * mean over its
 * channels of in[image][channel], at the frequencies that both grids have. A Gaussian window over the frequencies,
 * 2^-(fy^2 + fx^2) with f = 1 at the coarse grid's last frequency, is applied `tapers` times (negative: divided out).
 * The coarse grid's Nyquist row and column and its padding become 0. Dimensions: columns of all blocks, rows, images.
 */
__kernel void refine_crop(__global const float *in, ulong in_offset, hada_spectrum_shape in_shape, __global float *out,
                          uint out_offset, hada_spectrum_shape out_shape, hada_refine_crop crop)
{
    const int rows = out_shape.rows, cols = out_shape.cols, block = out_shape.block;
    const int in_rows = in_shape.rows, in_block = in_shape.block, parts = crop.parts, channels = crop.channels;
    const int kx = get_global_id(0), ky = get_global_id(1), image = get_global_id(2);
    if (kx >= (cols / 2 + block) / block * block)
        return;
    const int sy = 2 * ky < rows ? ky : ky - rows;
    const int known = 2 * kx < cols && 2 * sy > -rows;
    const float fy = 2.0f * (float)sy / (float)rows, fx = 2.0f * (float)kx / (float)cols;
    const float scale = crop.factor / (float)channels * exp2(-crop.tapers * (fy * fy + fx * fx));
    const size_t from = known ? spectrum_index(in_rows, in_block, sy < 0 ? sy + in_rows : sy, kx) : 0;
    const size_t to = spectrum_index(rows, block, ky, kx);
    for (int part = 0; part < parts; ++part) {
        float sum = 0.0f;
        for (int c = 0; c < channels; ++c)
            sum += in[(in_offset + (size_t)(image * channels + c) * in_shape.count + from) * parts + part];
        sum *= scale;
        if (crop.invert)
            sum = sum > 0.0f ? 1.0f / sum : 0.0f;
        out[((size_t)out_offset + (size_t)image * out_shape.count + to) * parts + part] = known ? sum : 0.0f;
    }
}
