/* Point spread functions that vary over the field, b = sum_k h_k * (w_k x): weights of components. Images of components
 * stand as [place in the list][channel], where the list has the components of a depth one after the other; `maps` has
 * an image of weights for each index that the list may hold, from `offset` floats on. Dimensions: slices of pixels,
 * images that are written. */
#include "inc_classic.h"
#include "shared_classic.h"

/* An image of each component: w_k x. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_part(__global const float *planes, __global float *parts, __global const int *list, __global const float *maps,
             hada_ulong offset, int components, hada_classic_slices slices)
{
    const uint slice = slices.slice, pixels = slices.pixels, channels = slices.channels;
    const uint from = get_group_id(0) * slice, to = min(pixels, from + slice);
    const size_t image = get_global_id(1), place = image / channels;
    __global const float *x = planes + (place / components * channels + image % channels) * pixels;
    __global const float *w = maps + offset + (size_t)list[place] * pixels;
    __global float *part = parts + image * pixels;
    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH)
        image_put(part, i, image_get(w, i) * image_get(x, i));
}

/* The transpose: the sum over components of w_k times the image of each. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_unite(__global const float *parts, __global float *planes, __global const int *list, __global const float *maps,
              hada_ulong offset, int components, hada_classic_slices slices)
{
    const uint slice = slices.slice, pixels = slices.pixels, channels = slices.channels;
    const uint from = get_group_id(0) * slice, to = min(pixels, from + slice);
    const size_t image = get_global_id(1), depth = image / channels;
    __global float *x = planes + image * pixels;
    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        refine_real sum = (refine_real)0.0f;
        for (int k = 0; k < components; ++k) {
            const size_t place = depth * components + k;
            __global const float *w = maps + offset + (size_t)list[place] * pixels;
            sum = fma(image_get(w, i), image_get(parts, (place * channels + image % channels) * pixels + i), sum);
        }
        image_put(x, i, sum);
    }
}
