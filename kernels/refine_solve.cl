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
 * [set][place in the set][channel][count], A and E as [set][channel][count], B and prior as [channel][count].
 * start: 0 the first step from u = d = 0, 1 the first step from U (d = 0), 2 a further step.
 * partial[set][channel][slice]: sum of |B - sum H U|^2 over the whole spectrum (of the start's U: not padded, or
 * start). */
#include "inc_refine.h"

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_solve(__global const float *otf, ulong otf_offset, __global const int *list, int depths,
             __global const float *data, ulong data_offset, __global float *split_a, __global const float *split_e,
             int padded, __global const float *prior, int has_prior, __global const float *now_u, __global float *now_w,
             float rho, float keep, float over, int start, uint count, uint slice, uint rows, uint block, uint cols,
             __global float *partial, uint partial_first)
{
    REFINE_LOCAL
    const uint channel = get_global_id(1), channels = get_global_size(1), set = get_global_id(2);
    const uint from = get_group_id(0) * slice, to = min(count, from + slice);
    const size_t first = ((size_t)set * (size_t)depths * channels + channel) * count, step = (size_t)channels * count;
    const size_t plane = (size_t)set * channels + channel;
    __global const float *h = otf + 2 * (otf_offset + (size_t)channel * count);
    __global const float *b = data + 2 * (data_offset + (size_t)channel * count);
    __global float *a = split_a + (padded ? 2 * plane * count : 0);
    __global const float *e = split_e + (padded ? 2 * plane * count : 0);
    __global const float *u = now_u + 2 * first;
    __global float *w = now_w + 2 * first;
    __global const float *p = prior + (has_prior ? (size_t)channel * count : 0);
    __global const int *z = list + set * (uint)depths;
    const size_t h_step = 2 * (size_t)channels * count;
    refine_real sum = (refine_real)0.0f;

    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        refine_real square = (refine_real)0.0f, hv_re = square, hv_im = square, hu_re = square, hu_im = square;
        for (int s = 0; s < depths; ++s) {
            refine_real h_re, h_im;
            refine_get(h + (size_t)z[s] * h_step, i, &h_re, &h_im);
            square = fma(h_re, h_re, fma(h_im, h_im, square));
            if (start > 0) {
                refine_real u_re, u_im, v_re, v_im;
                refine_get(u + 2 * (size_t)s * step, i, &u_re, &u_im);
                v_re = u_re;
                v_im = u_im;
                if (start == 2) {
                    refine_real w_re, w_im;
                    refine_get(w + 2 * (size_t)s * step, i, &w_re, &w_im);
                    v_re = fma(-keep, w_re - u_re, u_re);
                    v_im = fma(-keep, w_im - u_im, u_im);
                }
                hu_re = fma(h_re, u_re, fma(-h_im, u_im, hu_re));
                hu_im = fma(h_re, u_im, fma(h_im, u_re, hu_im));
                hv_re = fma(h_re, v_re, fma(-h_im, v_im, hv_re));
                hv_im = fma(h_re, v_im, fma(h_im, v_re, hv_im));
            }
        }
        refine_real y_re, y_im, e_re = (refine_real)0.0f, e_im = e_re;
        if (padded && start == 2) {
            refine_get(a, i, &y_re, &y_im);
            refine_get(e, i, &e_re, &e_im);
            y_re -= 2.0f * e_re;
            y_im -= 2.0f * e_im;
        } else {
            refine_get(b, i, &y_re, &y_im);
        }
        const refine_real r_re = y_re - hu_re, r_im = y_im - hu_im;
        sum += refine_count(fma(r_re, r_re, r_im * r_im), i, rows, block, cols);

        const refine_real g = has_prior ? rho + refine_get_real(p, i) : (refine_real)rho;
        const refine_real per_g = 1.0f / g, per_all = 1.0f / (g + square);
        const refine_real f_re = (g * y_re - rho * hv_re) * per_all, f_im = (g * y_im - rho * hv_im) * per_all;
        if (padded) {
            /* sum H X = Y - f; relaxed against v = Y + E; then A = that + E */
            const refine_real v_re = y_re + e_re, v_im = y_im + e_im;
            refine_put(a, i, v_re + e_re + over * (y_re - f_re - v_re), v_im + e_im + over * (y_im - f_im - v_im));
        }
        for (int s = 0; s < depths; ++s) {
            refine_real h_re, h_im, u_re = (refine_real)0.0f, u_im = u_re, d_re = u_re, d_im = u_re;
            refine_get(h + (size_t)z[s] * h_step, i, &h_re, &h_im);
            if (start > 0)
                refine_get(u + 2 * (size_t)s * step, i, &u_re, &u_im);
            if (start == 2) {
                refine_real w_re, w_im;
                refine_get(w + 2 * (size_t)s * step, i, &w_re, &w_im);
                d_re = keep * (w_re - u_re);
                d_im = keep * (w_im - u_im);
            }
            const refine_real x_re = fma(h_re, f_re, fma(h_im, f_im, rho * (u_re - d_re))) * per_g;
            const refine_real x_im = fma(h_re, f_im, fma(-h_im, f_re, rho * (u_im - d_im))) * per_g;
            refine_put(w + 2 * (size_t)s * step, i, fma(over, x_re - u_re, u_re + d_re),
                       fma(over, x_im - u_im, u_im + d_im));
        }
    }
    REFINE_PARTIAL(partial, (partial_first + plane * get_num_groups(0) + get_group_id(0)), refine_sum(sum))
}
