/* Turns a prediction y of the frame b into what a method needs next, on the sensor's pixels and in place. Where values
 * have weights (image_weighed() of inc_classic.h), `weights` is as the frame; else it is not read.
 *     ratio:    y = max(b, 0) / max(y, number)                       Richardson-Lucy
 *     residual: y = b - y
 *     split:    e = number (b - s - 2 y), s = -e - y, y = e          ADMM; number = 1 / (1 + mu), with weights mu
 * The last is the split v = sum PSF * x for the data (unknown boundaries): with its scaled dual d, v minimises |b -
 * v|^2 + mu |v - y - d|^2, and only s = d - v is kept: docs/explanation/mathematics.md.
 * Images: [channel][row][pitch]. Dimensions: slices of pixels, channels. */
#include "inc_classic.h"
#include "shared_classic.h"

__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_frame(__global float *images, __global const float *frame, __global const float *weights, int weighted,
              __global float *dual, int step, float number, hada_classic_slices slices)
{
    const uint slice = slices.slice, pixels = slices.pixels;
    const uint from = get_group_id(0) * slice, to = min(pixels, from + slice);
    const size_t plane = (size_t)get_global_id(1) * pixels;
    __global float *y = images + plane;
    __global const float *b = frame + plane;

    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        const refine_real recorded = image_get(b, i), predicted = image_get(y, i);
        if (weighted) {
            const refine_real w = image_get(weights, plane + i);
            if (step == HADA_CLASSIC_SPLIT) {
                const refine_real met = fma((refine_real)2.0f, predicted, image_get(dual, plane + i));
                const refine_real e = image_weighed(step, recorded, met, w, number);
                image_put(dual, plane + i, -e - predicted);
                image_put(y, i, e);
            } else {
                image_put(y, i, image_weighed(step, recorded, predicted, w, number));
            }
        } else if (step == HADA_CLASSIC_RATIO) {
            image_put(y, i, image_ratio(recorded, predicted, number));
        } else if (step != HADA_CLASSIC_SPLIT) {
            image_put(y, i, recorded - predicted);
        } else {
            const refine_real e = number * (recorded - image_get(dual, plane + i) - 2.0f * predicted);
            image_put(dual, plane + i, -e - predicted);
            image_put(y, i, e);
        }
    }
}

/* partial[channel][slice]: sums of squares. */
__kernel __attribute__((reqd_work_group_size(REFINE_GROUP, 1, 1))) void
classic_energy(__global const float *images, hada_classic_slices slices, __global float *partial)
{
    REFINE_LOCAL
    const uint slice = slices.slice, pixels = slices.pixels;
    const uint from = get_group_id(0) * slice, to = min(pixels, from + slice);
    __global const float *y = images + (size_t)get_global_id(1) * pixels;
    refine_real sum = (refine_real)0.0f;
    for (uint i = from + get_local_id(0) * REFINE_WIDTH; i < to; i += REFINE_GROUP * REFINE_WIDTH) {
        const refine_real value = image_get(y, i);
        sum = fma(value, value, sum);
    }
    REFINE_PARTIAL(partial, IMAGE_PLACE(0), refine_sum(sum))
}

/* The frame, [channel][rows][cols] floats, to images with a pitch. Dimensions: columns up to the pitch, rows, channels.
 */
__kernel void classic_pad(__global const float *frame, ulong offset, __global float *images, int cols)
{
    const size_t row = (size_t)get_global_id(2) * get_global_size(1) + get_global_id(1), j = get_global_id(0);
    images[row * get_global_size(0) + j] = j < (size_t)cols ? frame[offset + row * (size_t)cols + j] : 0.0f;
}

/* The planes of a result: the window of x without negative values, as planes without a pitch; x keeps only these
 * values. window: rows x cols from (row0, col0) of x; outside it x becomes 0. Dimensions: columns of x and rows of x,
 * planes; the padding of x stays. */
__kernel void classic_crop(__global float *planes, __global float *window, int pitch, int row0, int col0, int rows,
                           int cols)
{
    const int j = get_global_id(0), i = get_global_id(1), plane = get_global_id(2);
    const size_t at = ((size_t)plane * get_global_size(1) + i) * pitch + j;
    const int row = i - row0, col = j - col0, inside = row >= 0 && row < rows && col >= 0 && col < cols;
    const float value = inside ? max(planes[at], 0.0f) : 0.0f;
    planes[at] = value;
    if (inside)
        window[((size_t)plane * rows + row) * cols + col] = value;
}
