/* The proximal step of total variation with non-negativity, in the window, channels coupled: for each depth
 *     min over u >= 0 of  1/2 |u - w|^2 + theta sum over pixels of sqrt(|mean|^2 + colour^2 |rest|^2)
 * where grad u at a pixel, a vector over channels and directions, is parted into what the channels have in common and
 * the rest, by projected gradients on its dual (A. Chambolle, "Total variation minimization and a class of binary MRF
 * models", 2005; coupled channels: X. Bresson and T. Chan, Inverse Problems and Imaging 2(4), 2008; bounds as in Beck
 * and Teboulle, IEEE TIP 18(11), 2009): with p a vector per pixel and channel,
 *     u = max(0, w + theta div p),   p' = the nearest to p + step / theta grad u with |mean|^2 + |rest|^2 / colour^2
 * <= 1. Differences are forward, 0 at the far edges, so p is 0 there.
 *
 * Planes stand as [place][channel][rows][cols], duals as [place][channel][2][rows][cols] (along columns, along rows).
 * Loads reach a value beyond an image: both arrays have room behind. A row's last vector overlaps the one before, so
 * REFINE_WIDTH 8 wants windows of at least eight columns. Dimensions: bands of rows, places. */
#include "inc_refine_tv.h"
#include "shared_refine.h"

#if REFINE_WIDTH == 8
/* 0 at the last of a row's pixels */
REFINE_INLINE refine_real tv_end(refine_real v, int last)
{
    if (last)
        v.s7 = 0.0f;
    return v;
}

/* v where a vector that overlaps the one before is new, kept elsewhere */
REFINE_INLINE refine_real tv_rest(refine_real kept, refine_real v, int done)
{
    return select(v, kept, (int8)(0, 1, 2, 3, 4, 5, 6, 7) < done);
}
#else
REFINE_INLINE refine_real tv_end(refine_real v, int last)
{
    return last ? 0.0f : v;
}

REFINE_INLINE refine_real tv_rest(refine_real kept, refine_real v, int done)
{
    return v;
}
#endif

/* u at the pixels from `at` on, all of one row; the duals before a row or an image are 0. */
REFINE_INLINE refine_real tv_plane(__global const float *w, __global const float *p, int area, int cols, int at,
                                   float theta)
{
    __global const float *pj = p + area;
    const refine_real up = at < cols ? (refine_real)0.0f : wide_get(p + at - cols);
    const refine_real div = (wide_get(p + at) - up) + (wide_get(pj + at) - wide_get(pj + at - 1));
    return max(fma((refine_real)theta, div, wide_get(w + at)), 0.0f);
}

/* p' from p; fresh: p is 0; per_colour: 1 / colour^2 */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_tv_duals(__global const float *given, __global const float *old, __global float *next, int fresh,
                hada_refine_window window, float theta, float step, float per_colour)
{
    const int channels = window.channels, rows = window.rows, cols = window.cols, band = window.band;
    const int from = get_group_id(0) * band, to = min(rows, from + band), area = rows * cols;
    const size_t first = (size_t)get_global_id(1) * channels * area;
    const float share = 1.0f / (float)channels;
    for (int i = from; i < to; ++i) {
        for (int j = get_local_id(0) * REFINE_WIDTH; j < cols; j += REFINE_GROUP * REFINE_WIDTH) {
            const int col = min(j, cols - REFINE_WIDTH), at = i * cols + col, down = i + 1 < rows ? at + cols : at;
            refine_real square = (refine_real)0.0f, sum_i = square, sum_j = square, of_mean, of_rest;
            for (int c = 0; c < channels; ++c) {
                __global const float *w = given + first + (size_t)c * area, *p = old + 2 * (first + (size_t)c * area);
                __global float *q = next + 2 * (first + (size_t)c * area);
                refine_real here, below, right, qi = (refine_real)0.0f, qj = qi;
                if (fresh) {
                    here = max(wide_get(w + at), 0.0f);
                    below = max(wide_get(w + down), 0.0f);
                    right = max(wide_get(w + at + 1), 0.0f);
                } else {
                    here = tv_plane(w, p, area, cols, at, theta);
                    below = tv_plane(w, p, area, cols, down, theta);
                    /* beyond the end of a row it is not used */
                    right = tv_plane(w, p, area, cols, at + 1, theta);
                    qi = wide_get(p + at);
                    qj = wide_get(p + at + area);
                }
                qi = fma((refine_real)step, below - here, qi);
                qj = tv_end(fma((refine_real)step, right - here, qj), col + REFINE_WIDTH == cols);
                wide_put(qi, q + at);
                wide_put(qj, q + at + area);
                square = fma(qi, qi, fma(qj, qj, square));
                sum_i += qi;
                sum_j += qj;
            }
            const refine_real mean = share * fma(sum_i, sum_i, sum_j * sum_j);
            tv_shorten(mean, max(square - mean, 0.0f), per_colour, &of_mean, &of_rest);
            sum_i *= share * (of_mean - of_rest);
            sum_j *= share * (of_mean - of_rest);
            for (int c = 0; c < channels; ++c) {
                __global float *q = next + 2 * (first + (size_t)c * area);
                wide_put(fma(of_rest, wide_get(q + at), sum_i), q + at);
                wide_put(fma(of_rest, wide_get(q + at + area), sum_j), q + at + area);
            }
        }
    }
}

/* u in the place of w. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
refine_tv_planes(__global float *planes, __global const float *duals, hada_refine_window window, float theta)
{
    const int channels = window.channels, rows = window.rows, cols = window.cols, band = window.band;
    const int from = get_group_id(0) * band, to = min(rows, from + band), area = rows * cols;
    const size_t first = (size_t)get_global_id(1) * channels * area;
    for (int c = 0; c < channels; ++c) {
        __global float *w = planes + first + (size_t)c * area;
        __global const float *p = duals + 2 * (first + (size_t)c * area);
        for (int i = from; i < to; ++i) {
            for (int j = get_local_id(0) * REFINE_WIDTH; j < cols; j += REFINE_GROUP * REFINE_WIDTH) {
                const int col = min(j, cols - REFINE_WIDTH), at = i * cols + col;
                wide_put(tv_rest(wide_get(w + at), tv_plane(w, p, area, cols, at, theta), j - col), w + at);
            }
        }
    }
}
