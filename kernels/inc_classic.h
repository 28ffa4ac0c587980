/* For the kernels of the classic methods over images. Rows have `pitch` floats, a multiple of 8; the values between a
 * row's `cols` pixels and its pitch are 0 and stay 0. REFINE_WIDTH pixels side by side and sums in a fixed order: as in
 * inc_refine.h. */
#ifndef INC_CLASSIC_H
#define INC_CLASSIC_H

#include "inc_refine.h"
#include "shared_classic.h"

#define image_get(p, i)    wide_get((p) + (i))
#define image_put(p, i, v) wide_put(v, (p) + (i))

#if REFINE_WIDTH == 8
#define IMAGE_LANES ((int8)(0, 1, 2, 3, 4, 5, 6, 7))

/* The pixels to the left and to the right of `here`, given the one before the first and the one after the last. */
REFINE_INLINE refine_real image_left(refine_real here, float before)
{
    return (float8)(before, here.s0123, here.s456);
}

REFINE_INLINE refine_real image_right(refine_real here, float after)
{
    return (float8)(here.s1234, here.s567, after);
}

/* v, but w at column `col`, and 0 from column `cols` on; the first of v stands at column j. */
REFINE_INLINE refine_real image_set(refine_real v, float w, int j, int col)
{
    return select(v, (float8)w, IMAGE_LANES + j == col);
}

REFINE_INLINE refine_real image_cut(refine_real v, int j, int first, int cols)
{
    return select((float8)0.0f, v, (IMAGE_LANES + j >= first) & (IMAGE_LANES + j < cols));
}
#else
REFINE_INLINE refine_real image_left(refine_real here, float before)
{
    return before;
}

REFINE_INLINE refine_real image_right(refine_real here, float after)
{
    return after;
}

REFINE_INLINE refine_real image_set(refine_real v, float w, int j, int col)
{
    return j == col ? w : v;
}

REFINE_INLINE refine_real image_cut(refine_real v, int j, int first, int cols)
{
    return j >= first && j < cols ? v : 0.0f;
}
#endif

/* Of the frame to its prediction: max(b, 0) / max(y, number). number below 0: to both -number is added, which changes
 * nothing where they are alike; the prediction is a tenth of it at least then. */
REFINE_INLINE refine_real image_ratio(refine_real b, refine_real y, float number)
{
    const float more = max(-number, 0.0f);
    return max(b + more, 0.0f) / max(y + more, max(number, 0.1f * more));
}

/* A step on values b of the frame and their prediction y, with weights w. A weight below 0 is that of a saturated
 * value, whose true value is b or more: it has the size |w|, and what predicts more than b is right. ratio: |w| max(b,
 * 0) / max(y, number)    residual: |w| (b - y)    left: b - y, or 0    weigh: |w| y split: |w| (b - y) / (|w| + number)
 * number is mu
 */
REFINE_INLINE refine_real image_weighed(int step, refine_real b, refine_real y, refine_real w, float number)
{
    const refine_real size = fabs(w), none = (refine_real)0.0f, left = b - y;
    const refine_real short_of = w < 0.0f ? max(left, 0.0f) : left;
    if (step == HADA_CLASSIC_RATIO) {
        const refine_real ratio = image_ratio(b, y, number);
        return size * (w < 0.0f ? max(ratio, 1.0f) : ratio);
    }
    if (step == HADA_CLASSIC_SPLIT)
        return short_of * (size / max(size + number, REFINE_LEAST_WEIGHT));
    if (step == HADA_CLASSIC_LEFT)
        return size > 0.0f ? short_of : none;
    return step == HADA_CLASSIC_WEIGH ? size * y : size * short_of;
}

/* For several sums of one kernel, one after the other. */
#if REFINE_GROUP > 1
#define IMAGE_PARTIAL(partial, place, value)                                                                           \
    {                                                                                                                  \
        barrier(CLK_LOCAL_MEM_FENCE);                                                                                  \
        REFINE_PARTIAL(partial, place, value)                                                                          \
    }
#else
#define IMAGE_PARTIAL(partial, place, value) REFINE_PARTIAL(partial, place, value)
#endif

/* Which sum of which slice and plane. */
#define IMAGE_PLACE(sum) ((get_global_size(1) * (size_t)(sum) + get_global_id(1)) * get_num_groups(0) + get_group_id(0))

#endif
