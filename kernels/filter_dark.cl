/* Subtracts the dark level, and a dark frame where there is one, from the `count` pixels of a channel, which begin at
 * `offset`. */
#include "inc_values.h"

__kernel void filter_dark(__global float *raw, __global const float *dark, ulong offset, int framed, float level,
                          ulong count)
{
    __global float *pixels = raw + offset;
    __global const float *background = dark + offset;
    const long first = VALUES_FIRST(offset);
    if (VALUES_WHOLE(first, count)) {
        values_v value = VALUES_GET(pixels + first) - level;
        if (framed)
            value -= VALUES_GET(background + first);
        VALUES_PUT(value, pixels + first);
    } else {
        VALUES_EACH(i, first, count)
        pixels[i] = pixels[i] - level - (framed ? background[i] : 0.0f);
    }
}
