/* Steps of the classic methods on half spectra. Transfer functions: complex [depth][channel][count], planes: [place in
 * the list][channel][count], all else [channel][count]. Dimensions: slices of frequencies, channels. */
#include "inc_refine.h"
#include "shared_classic.h"

/* The least-squares step of ADMM, and the Wiener filter, for all depths jointly (Sherman-Morrison): per frequency
 *     X = argmin m |P/m - sum H X|^2 + D |X - Q/D|^2 = (Q + conj(H) f) / D,   f = (D P - m sum H Q) / (D + m sum |H|^2)
 * with D = mu2 (G_row + G_col) + mu3, G the gradient's transfer function squared (`gradient`: rows, then columns), m,
 * mu2 and mu3 the weights of data, gradient and planes. cropped: P = m (Y + E), and Y becomes sum H X; else P = data.
 * `planes` holds Q and takes X; first: Q is 0. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_solve(__global const float *otf, __global const int *list, __global const float *data, __global float *split_y,
              __global float *planes, __global const float *gradient, hada_classic_problem problem,
              hada_classic_weights weights)
{
    const uint count = problem.spectrum.count, slice = problem.slice;
    const int depths = problem.depths;
    const uint rows = problem.spectrum.rows, block = problem.spectrum.block;
    const int cropped = weights.cropped, first = weights.first;
    const float m = weights.data, mu2 = weights.gradient, mu3 = weights.planes;
    const uint channel = get_global_id(1), channels = get_global_size(1);
    const uint from = get_group_id(0) * slice, to = min(count, from + slice);
    const size_t step = 2 * (size_t)channels * count;
    __global const float *h = otf + 2 * (problem.otf_offset + (size_t)channel * count);
    __global const float *p = data + 2 * (problem.frame_offset + (size_t)channel * count);
    __global float *y = split_y + (cropped ? 2 * (size_t)channel * count : 0);
    __global float *x = planes + 2 * (size_t)channel * count;
    __global const float *gradient_cols = gradient + rows;

    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        refine_real square = (refine_real)0.0f, hq_re = square, hq_im = square;
        for (int s = 0; s < depths; ++s) {
            refine_real h_re, h_im;
            refine_get(h + (size_t)list[s] * step, i, &h_re, &h_im);
            square = fma(h_re, h_re, fma(h_im, h_im, square));
            if (!first) {
                refine_real q_re, q_im;
                refine_get(x + (size_t)s * step, i, &q_re, &q_im);
                hq_re = fma(h_re, q_re, fma(-h_im, q_im, hq_re));
                hq_im = fma(h_re, q_im, fma(h_im, q_re, hq_im));
            }
        }
        refine_real p_re, p_im;
        refine_get(p, i, &p_re, &p_im);
        if (cropped) {
            refine_real y_re, y_im;
            refine_get(y, i, &y_re, &y_im);
            p_re = m * (p_re + y_re);
            p_im = m * (p_im + y_im);
        }
        const uint ky = i / block % rows, kx = i / (rows * block) * block + i % block;
        const refine_real d =
            fma((refine_real)mu2, refine_get_real(gradient_cols, kx) + gradient[ky], (refine_real)mu3);
        const refine_real per_d = 1.0f / d, per_all = 1.0f / fma((refine_real)m, square, d);
        const refine_real f_re = (d * p_re - m * hq_re) * per_all, f_im = (d * p_im - m * hq_im) * per_all;
        if (cropped)
            refine_put(y, i, fma(square, p_re, hq_re) * per_all, fma(square, p_im, hq_im) * per_all);
        for (int s = 0; s < depths; ++s) {
            refine_real h_re, h_im, q_re = (refine_real)0.0f, q_im = q_re;
            refine_get(h + (size_t)list[s] * step, i, &h_re, &h_im);
            if (!first)
                refine_get(x + (size_t)s * step, i, &q_re, &q_im);
            refine_put(x + (size_t)s * step, i, fma(h_re, f_re, fma(h_im, f_im, q_re)) * per_d,
                       fma(h_re, f_im, fma(-h_im, f_re, q_im)) * per_d);
        }
    }
}

/* The planes' prediction of the frame: out = sum H X, or with has_data the residual data - sum H X.
 * partial[channel][slice]: the sum of |out|^2 over the whole spectrum. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_project(__global const float *otf, __global const int *list, __global const float *data, int has_data,
                __global const float *planes, __global float *out, hada_classic_problem problem,
                __global float *partial)
{
    REFINE_LOCAL
    const uint count = problem.spectrum.count, slice = problem.slice;
    const int depths = problem.depths;
    const uint rows = problem.spectrum.rows, block = problem.spectrum.block, cols = problem.spectrum.cols;
    const uint channel = get_global_id(1), channels = get_global_size(1);
    const uint from = get_group_id(0) * slice, to = min(count, from + slice);
    const size_t step = 2 * (size_t)channels * count;
    const float sign = has_data ? -1.0f : 1.0f;
    __global const float *h = otf + 2 * (problem.otf_offset + (size_t)channel * count);
    __global const float *b = data + 2 * (problem.frame_offset + (size_t)channel * count);
    __global const float *x = planes + 2 * (size_t)channel * count;
    refine_real sum = (refine_real)0.0f;

    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        refine_real y_re = (refine_real)0.0f, y_im = y_re;
        if (has_data)
            refine_get(b, i, &y_re, &y_im);
        for (int s = 0; s < depths; ++s) {
            refine_real h_re, h_im, x_re, x_im;
            refine_get(h + (size_t)list[s] * step, i, &h_re, &h_im);
            refine_get(x + (size_t)s * step, i, &x_re, &x_im);
            x_re *= sign;
            x_im *= sign;
            y_re = fma(h_re, x_re, fma(-h_im, x_im, y_re));
            y_im = fma(h_re, x_im, fma(h_im, x_re, y_im));
        }
        sum += refine_count(fma(y_re, y_re, y_im * y_im), i, rows, block, cols);
        refine_put(out + 2 * (size_t)channel * count, i, y_re, y_im);
    }
    REFINE_PARTIAL(partial, (channel * get_num_groups(0) + get_group_id(0)), refine_sum(sum))
}

/* The transpose: planes = conj(H) in, for every depth of the list. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_transpose(__global const float *otf, __global const int *list, __global const float *in, __global float *planes,
                  hada_classic_problem problem)
{
    const uint count = problem.spectrum.count, slice = problem.slice;
    const int depths = problem.depths;
    const uint channel = get_global_id(1), channels = get_global_size(1);
    const uint from = get_group_id(0) * slice, to = min(count, from + slice);
    const size_t step = 2 * (size_t)channels * count;
    __global const float *h = otf + 2 * (problem.otf_offset + (size_t)channel * count);
    __global float *x = planes + 2 * (size_t)channel * count;

    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        refine_real r_re, r_im;
        refine_get(in + 2 * (size_t)channel * count, i, &r_re, &r_im);
        for (int s = 0; s < depths; ++s) {
            refine_real h_re, h_im;
            refine_get(h + (size_t)list[s] * step, i, &h_re, &h_im);
            refine_put(x + (size_t)s * step, i, fma(h_re, r_re, h_im * r_im), fma(h_re, r_im, -h_im * r_re));
        }
    }
}
