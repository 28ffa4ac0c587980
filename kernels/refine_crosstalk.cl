/* Crosstalk is a small part of the light of one depth that refinement leaves in the planes of others. Where a plane is
 * dark beside a brighter one, its light is reassigned to the brightest plane (docs/explanation/refinement.md):
 *
 *     w[z] = (1 + k^4) r^4 / (r^4 + k^4),   r = m[z] / max over z of m
 *     x[z] w[z], and sum over z of (1 - w[z]) x[z] to the plane of the largest m, the first of equals
 *
 * m: sum of a plane's channels over pixels up to CROSSTALK_REACH rows and columns away, within the image; k: the share
 * of the brightest plane's light at which another one halves. Planes: float [plane][channel][row][col], not negative.
 * Their sum does not change, nor does a single plane.
 * light: float [plane][row][col]. */
#ifndef CROSSTALK_WIDTH
#define CROSSTALK_WIDTH 8
#endif
#ifndef CROSSTALK_GROUP
#define CROSSTALK_GROUP 1
#endif

#define WIDE_WIDTH CROSSTALK_WIDTH
#include "inc_wide.h"
#include "shared_refine.h"

#define CROSSTALK_REACH 2

/* Channels that share their weights and are handled together. */
#define CROSSTALK_SIDE              3
#define CROSSTALK_CHANNEL(c, count) _Pragma("unroll") for (int c = 0; c < CROSSTALK_SIDE; ++c) if (c < (count))

#if CROSSTALK_WIDTH == 8
typedef int8 crosstalk_int;
#define CROSSTALK_ANY(here) any(here)
#else
typedef int crosstalk_int;
#define CROSSTALK_ANY(here) (here)
#endif

/* light[plane][row][col]: a plane's channels, added up along rows. Dimensions: columns by the width, rows, planes. */
__kernel __attribute__((reqd_work_group_size(CROSSTALK_GROUP, 1, 1))) void
refine_crosstalk_light(__global const float *planes, __global float *light, hada_refine_window window)
{
    const int rows = window.rows, cols = window.cols, channels = window.channels;
    const int first = (int)get_global_id(0) * CROSSTALK_WIDTH, row = (int)get_global_id(1);
    const size_t area = (size_t)rows * (size_t)cols, plane = get_global_id(2), at = (size_t)row * (size_t)cols;
    __global const float *image = planes + plane * (size_t)channels * area + at;
    __global float *out = light + plane * area + at;
    if (first >= CROSSTALK_REACH && first + CROSSTALK_WIDTH + CROSSTALK_REACH <= cols) {
        wide_real sum = (wide_real)0.0f;
        for (int c = 0; c < channels; ++c)
            for (int d = -CROSSTALK_REACH; d <= CROSSTALK_REACH; ++d)
                sum += wide_get(image + (size_t)c * area + first + d);
        wide_put(sum, out + first);
        return;
    }
    for (int col = first; col < min(first + CROSSTALK_WIDTH, cols); ++col) {
        float sum = 0.0f;
        for (int c = 0; c < channels; ++c)
            for (int i = max(col - CROSSTALK_REACH, 0); i <= min(col + CROSSTALK_REACH, cols - 1); ++i)
                sum += image[(size_t)c * area + i];
        out[col] = sum;
    }
}

/* The share of a plane's light that a pixel keeps. */
WIDE_INLINE wide_real crosstalk_weight(wide_real light, wide_real most, float k)
{
    const wide_real part = light / fmax(most, (wide_real)FLT_MIN);
    const wide_real square = part * part, power = square * square;
    return (1.0f + k) * power / (power + k);
}

/* Columns from `first` on of rows `from` to `to`, added up; as many as there are. */
WIDE_INLINE wide_real crosstalk_around(__global const float *light, int from, int to, int cols, int first)
{
    wide_real sum = (wide_real)0.0f;
    for (int i = from; i <= to; ++i)
        sum += wide_get_some(light + (size_t)i * (size_t)cols + first, cols - first);
    return sum;
}

/* Fades the planes in place; share: k. Dimensions: columns by the width, rows. */
__kernel __attribute__((reqd_work_group_size(CROSSTALK_GROUP, 1, 1))) void
refine_crosstalk_fade(__global float *planes, __global const float *light, hada_refine_window window, int depths,
                      float share)
{
    const int rows = window.rows, cols = window.cols, channels = window.channels;
    const int first = (int)get_global_id(0) * CROSSTALK_WIDTH, row = (int)get_global_id(1);
    const int from = max(row - CROSSTALK_REACH, 0), to = min(row + CROSSTALK_REACH, rows - 1);
    const size_t area = (size_t)rows * (size_t)cols, at = (size_t)row * (size_t)cols + (size_t)first;
    const float k = share * share * share * share;
    const wide_real none = (wide_real)0.0f;
    wide_real most = none;
    crosstalk_int brightest = (crosstalk_int)0;
    if (first >= cols)
        return;
    for (int z = 0; z < depths; ++z) {
        const wide_real around = crosstalk_around(light + (size_t)z * area, from, to, cols, first);
        brightest = select(brightest, (crosstalk_int)z, isgreater(around, most));
        most = fmax(most, around);
    }
    for (int c0 = 0; c0 < channels; c0 += CROSSTALK_SIDE) {
        __global float *image = planes + (size_t)c0 * area + at;
        const size_t step = (size_t)channels * area;
        const int side = channels - c0;
        wide_real moved[CROSSTALK_SIDE];
        CROSSTALK_CHANNEL(c, CROSSTALK_SIDE)
        moved[c] = none;
        for (int z = 0; z < depths; ++z) {
            const wide_real around = crosstalk_around(light + (size_t)z * area, from, to, cols, first);
            const wide_real weight = crosstalk_weight(around, most, k);
            CROSSTALK_CHANNEL(c, side)
            {
                __global float *p = image + (size_t)z * step + (size_t)c * area;
                const wide_real value = wide_get_some(p, cols - first);
                const wide_real kept = weight * value;
                moved[c] += value - kept;
                wide_put_some(kept, p, cols - first);
            }
        }
        for (int z = 0; z < depths; ++z) {
            const crosstalk_int here = brightest == (crosstalk_int)z;
            if (CROSSTALK_ANY(here))
                CROSSTALK_CHANNEL(c, side)
                {
                    __global float *p = image + (size_t)z * step + (size_t)c * area;
                    const wide_real kept = wide_get_some(p, cols - first);
                    wide_put_some(kept + select(none, moved[c], here), p, cols - first);
                }
        }
    }
}
