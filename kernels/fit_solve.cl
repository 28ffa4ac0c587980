/* Filters and transfer functions from the sums of a fit: each frequency is its own least-squares problem.
 *
 * complex: W = Sxb / (Sbb + alpha * (Sbb of the other depths) + ridge);
 * split: Wr = Srr / (Brr + alpha * other + ridge/2), Wi likewise with the imaginary parts;
 * H = conj(Sxb) / max(Sxx, floor).
 * Results stand at `at`, in complex numbers; values beyond an image's end are written as well, so images are solved in
 * order. */
#include "inc_fit.h"

__kernel void fit_filter(__global const float *sums, __global const float *pool, ulong stride, float alpha, float ridge,
                         __global float *filter, ulong at, ulong vectors)
{
    const size_t i = get_global_id(0);
    if (i >= vectors)
        return;
    const float8 raw = fit_high(sums, stride, 2, i), other = max(vload8(i, pool) - raw, 0.0f);
    const float8 re = fit_high(sums, stride, 0, i);
    float16 w;
#if FIT_SPLIT
    const float8 cross = fit_high(sums, stride, 4, i), cross_rest = fit_low(sums, stride, 4, i);
    const float8 part = fit_high(sums, stride, 5, i), part_rest = fit_low(sums, stride, 5, i);
    const float8 raw_i = max((raw - part) + (fit_low(sums, stride, 2, i) - part_rest), 0.0f);
    const float8 cross_i = (re - cross) + (fit_low(sums, stride, 0, i) - cross_rest);
    const float8 other_r = clamp(vload8(i, pool + 3 * stride) - part, 0.0f, other);
    w.even = fit_divide(cross, part + alpha * other_r + 0.5f * ridge);
    w.odd = fit_divide(cross_i, raw_i + alpha * (other - other_r) + 0.5f * ridge);
#else
    const float8 under = raw + alpha * other + ridge;
    w.even = fit_divide(re, under);
    w.odd = fit_divide(fit_high(sums, stride, 1, i), under);
#endif
    vstore16(w, i, filter + 2 * at);
}

__kernel void fit_transfer(__global const float *sums, ulong stride, float least, __global float *otf, ulong at,
                           ulong vectors)
{
    const size_t i = get_global_id(0);
    if (i >= vectors)
        return;
    const float8 under = max(fit_high(sums, stride, 3, i), least);
    float16 h;
    h.even = fit_divide(fit_high(sums, stride, 0, i), under);
    h.odd = fit_divide(-fit_high(sums, stride, 1, i), under);
    vstore16(h, i, otf + 2 * at);
}
