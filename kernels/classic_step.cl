/* Pixel by pixel steps of FISTA and Richardson-Lucy. Dimensions: slices of pixels, planes; plane p belongs to channel
 * p % channels. */
#include "inc_classic.h"
#include "shared_classic.h"
#include "shared_local.h"

#if REFINE_WIDTH == 8
#define LINE_GET(p)    vload8(0, p)
#define LINE_PUT(p, v) vstore8(v, 0, p)
#else
#define LINE_GET(p)    (*(p))
#define LINE_PUT(p, v) (*(p) = (v))
#endif

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

/* A Gaussian of planes, rows and columns at once; beyond the edges is no light. taps: its values from the middle to
 * `reach`. line: a row with `reach` floats, rounded up to eight, before and behind it. Dimensions: bands of rows,
 * planes. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_blur(__global const float *planes, __global float *blurred, __global const float *taps, int reach,
             hada_classic_bands image, __local STATED_SIZE float *line)
{
    const int rows = image.rows, cols = image.cols, pitch = image.pitch, band = image.band;
    const int from = get_group_id(0) * band, to = min(rows, from + band), margin = (reach + 7) / 8 * 8;
    const size_t plane = (size_t)get_global_id(1) * (size_t)rows * pitch;
    __local float *at = line + margin;
    for (int j = get_local_id(0); j < margin; j += REFINE_GROUP)
        line[j] = at[pitch + j] = 0.0f;
    for (int i = from; i < to; ++i) {
        const int first = max(i - reach, 0), last = min(i + reach, rows - 1);
        for (int j = get_local_id(0) * REFINE_WIDTH; j < pitch; j += REFINE_GROUP * REFINE_WIDTH) {
            refine_real sum = (refine_real)0.0f;
            for (int k = first; k <= last; ++k)
                sum = fma((refine_real)taps[abs(k - i)], image_get(planes, plane + (size_t)k * pitch + j), sum);
            LINE_PUT(at + j, image_cut(sum, j, 0, cols)); /* behind a row may stand what transforms left */
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int j = get_local_id(0) * REFINE_WIDTH; j < pitch; j += REFINE_GROUP * REFINE_WIDTH) {
            refine_real sum = taps[0] * LINE_GET(at + j);
            for (int k = 1; k <= reach; ++k)
                sum = fma((refine_real)taps[k], LINE_GET(at + j - k) + LINE_GET(at + j + k), sum);
            image_put(blurred, plane + (size_t)i * pitch + j, image_cut(sum, j, 0, cols));
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
}
