/* Clips negative values to zero, as light is not negative; and blends planes of two methods. */
#include "inc_values.h"

/* `count` values from `offset` on. */
__kernel void filter_clip(__global float *values, ulong offset, ulong count)
{
    const long first = VALUES_FIRST(offset);
    __global float *p = values + offset;
    if (VALUES_WHOLE(first, count))
        VALUES_PUT(max(VALUES_GET(p + first), 0.0f), p + first);
    else
        VALUES_EACH(i, first, count)
    p[i] = max(p[i], 0.0f);
}

/* values = share * values + (1 - share) * others, both clipped. */
__kernel void filter_blend(__global float *values, ulong offset, __global const float *others, ulong count, float share)
{
    const long first = VALUES_FIRST(offset);
    __global float *p = values + offset;
    if (VALUES_WHOLE(first, count)) {
        const values_v other = offset % VALUE_WIDTH ? VALUES_GET_ANY(others + first) : VALUES_GET(others + first);
        VALUES_PUT(share * max(VALUES_GET(p + first), 0.0f) + (1.0f - share) * max(other, 0.0f), p + first);
    } else {
        VALUES_EACH(i, first, count)
        p[i] = share * max(p[i], 0.0f) + (1.0f - share) * max(others[i], 0.0f);
    }
}
