/* Pixel by pixel steps of FISTA and Richardson-Lucy. Dimensions: slices of pixels, planes; plane p belongs to channel
 * p % channels. */
#include "inc_classic.h"
#include "shared_classic.h"

/* A gradient step: g = v + alpha[channel] g. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void classic_descend(__global const float *momentum,
                                                                                        __global float *gradient,
                                                                                        __global const float *alpha,
                                                                                        hada_classic_slices slices)
{
    const uint slice = slices.slice, pixels = slices.pixels;
    const uint from = get_group_id(0) * slice, to = min(pixels, from + slice);
    const size_t plane = (size_t)get_global_id(1) * pixels;
    __global const float *v = momentum + plane;
    __global float *g = gradient + plane;
    const float a = alpha[get_global_id(1) % slices.channels];
    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH)
        image_put(g, i, fma((refine_real)a, image_get(g, i), image_get(v, i)));
}

/* Non-negativity and momentum (FISTA): x' = max(0, z), v = x' + beta (x' - x), x = x'. z is the proximal step's result,
 * or (direct) the gradient step v + alpha g itself. partial: the sums of (x' - x)^2, then those of x'^2. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_momentum(__global float *planes, __global float *momentum, __global const float *gradient, int direct,
                 __global const float *alpha, float beta, hada_classic_slices slices, __global float *partial)
{
    REFINE_LOCAL
    const uint slice = slices.slice, pixels = slices.pixels;
    const uint from = get_group_id(0) * slice, to = min(pixels, from + slice);
    const size_t plane = (size_t)get_global_id(1) * pixels;
    __global float *x = planes + plane, *v = momentum + plane;
    __global const float *g = gradient + plane;
    const float a = alpha[get_global_id(1) % slices.channels];
    refine_real change = (refine_real)0.0f, size = change;
    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        refine_real z = image_get(g, i);
        if (direct)
            z = fma((refine_real)a, z, image_get(v, i));
        z = max(z, 0.0f);
        const refine_real step = z - image_get(x, i);
        change = fma(step, step, change);
        size = fma(z, z, size);
        image_put(x, i, z);
        image_put(v, i, fma((refine_real)beta, step, z));
    }
    IMAGE_PARTIAL(partial, IMAGE_PLACE(0), refine_sum(change))
    IMAGE_PARTIAL(partial, IMAGE_PLACE(1), refine_sum(size))
}

/* The point from which Richardson-Lucy continues: y = max(0, x + factor (x - before)). */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_extrapolate(__global const float *planes, __global const float *before, __global float *next, float factor,
                    hada_classic_slices slices)
{
    const uint slice = slices.slice, pixels = slices.pixels;
    const uint from = get_group_id(0) * slice, to = min(pixels, from + slice);
    const size_t plane = (size_t)get_global_id(1) * pixels;
    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        const refine_real x = image_get(planes, plane + i);
        image_put(next, plane + i, max(fma((refine_real)factor, x - image_get(before, plane + i), x), 0.0f));
    }
}
