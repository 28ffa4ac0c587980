/* Filters and transfer functions from the sums of a fit: each frequency is its own least-squares problem.
 *
 * complex: W = Sxb / (Sbb + alpha * (Sbb of the other depths) + ridge);
 * split: Wr = Srr / (Brr + alpha * other + ridge/2), Wi likewise with the imaginary parts;
 * H = conj(Sxb) / max(Sxx, floor).
 * Values beyond an image's end are written as well, so images are solved in order. */
#include "inc_fit.h"

__kernel void fit_filter(__global const float *sums, __global const float *pool, __global float *filter,
                         hada_fit_image image, hada_fit_penalty penalty)
{
    const size_t i = get_global_id(0), stride = image.stride;
    if (i >= image.vectors)
        return;
    const float8 re = fit_high(sums, stride, 0, i);
    float16 cross;
#if FIT_SPLIT
    cross.even = fit_high(sums, stride, 4, i);
    cross.odd = (re - cross.even) + (fit_low(sums, stride, 0, i) - fit_low(sums, stride, 4, i));
#else
    cross.even = re;
    cross.odd = fit_high(sums, stride, 1, i);
#endif
    const fit_under under = fit_under_of(sums, pool, stride, penalty, i);
    VECTORS_STORE16(__global, fit_divide_parts(cross, under.whole), filter + 2 * image.first + 16 * i);
}

__kernel void fit_transfer(__global const float *sums, __global float *otf, hada_fit_image image, float least)
{
    const size_t i = get_global_id(0), stride = image.stride;
    if (i >= image.vectors)
        return;
    const float8 under = max(fit_high(sums, stride, 3, i), least);
    float16 h;
    h.even = fit_divide(fit_high(sums, stride, 0, i), under);
    h.odd = fit_divide(-fit_high(sums, stride, 1, i), under);
    VECTORS_STORE16(__global, h, otf + 2 * image.first + 16 * i);
}
