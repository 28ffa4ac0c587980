/* Adds to the sums of a fit. Work-items: vectors of eight frequencies. */
#include "inc_fit.h"

/* Adds a pair: scene spectrum x and raw spectrum b. sign -1 removes it. */
__kernel void fit_pair(__global const float *x, __global const float *b, __global float *sums, hada_fit_image image,
                       float sign)
{
    const size_t i = get_global_id(0), first = 2 * image.first, stride = image.stride;
    if (i >= image.vectors)
        return;
    const fit_terms terms = fit_terms_of(vload16(i, x + first), vload16(i, b + first));
    fit_add(sums, stride, 0, i, sign * terms.cross_re);
    fit_add(sums, stride, 1, i, sign * terms.cross_im);
    fit_add(sums, stride, 2, i, sign * terms.raw);
    fit_add(sums, stride, 3, i, sign * terms.scene);
#if FIT_SPLIT
    fit_add(sums, stride, 4, i, sign * terms.split_cross);
    fit_add(sums, stride, 5, i, sign * terms.split_raw);
#endif
}

/* Adds other sums of the same shape, as high and low parts: to combine files or machines. */
__kernel void fit_merge(__global const float *more, __global float *sums, hada_fit_image image, int count)
{
    const size_t i = get_global_id(0), stride = image.stride;
    if (i >= image.vectors)
        return;
    for (int k = 0; k < count; k++) {
        fit_add(sums, stride, k, i, fit_low(more, stride, k, i));
        fit_add(sums, stride, k, i, fit_high(more, stride, k, i));
    }
}

/* Pools over depths, one value per frequency each, at multiples of the stride: 0: sum over depths of |B|^2; 1: the same
 * divided by the number of pairs of each depth; 2: sum of |X|^2 over the number of pairs. FIT_SPLIT: 3, 4: as 0, 1 for
 * Re(B)^2. */
__kernel void fit_pool(__global const float *sums, __global float *pool, hada_fit_image image, float per_pair)
{
    const size_t i = get_global_id(0), stride = image.stride;
    if (i >= image.vectors)
        return;
    const float8 raw = fit_high(sums, stride, 2, i), scene = fit_high(sums, stride, 3, i);
    VECTORS_STORE8(__global, vload8(i, pool) + raw, pool + 8 * i);
    VECTORS_STORE8(__global, vload8(i, pool + stride) + raw * per_pair, pool + stride + 8 * i);
    VECTORS_STORE8(__global, vload8(i, pool + 2 * stride) + scene * per_pair, pool + 2 * stride + 8 * i);
#if FIT_SPLIT
    const float8 split = fit_high(sums, stride, 5, i);
    VECTORS_STORE8(__global, vload8(i, pool + 3 * stride) + split, pool + 3 * stride + 8 * i);
    VECTORS_STORE8(__global, vload8(i, pool + 4 * stride) + split * per_pair, pool + 4 * stride + 8 * i);
#endif
}
