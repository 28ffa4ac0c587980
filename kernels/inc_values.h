/* Plain arrays of floats: a work-item takes VALUE_WIDTH values, eight on CPUs. In work-groups four, which begin at a
 * multiple of 128 bits: the first work-item takes the values before the first multiple, the last one the rest. */
#ifndef INC_VALUES_H
#define INC_VALUES_H

#include "inc_vectors.h"

#ifndef VALUE_WIDTH
#define VALUE_WIDTH 8
#endif

#if VALUE_WIDTH == 4
typedef float4 values_v;
/* The work-item's first value, counted from `offset` on: below 0 for the first work-item of an array that begins
 * between two multiples. */
#define VALUES_FIRST(offset) ((long)get_global_id(0) * 4 - (long)((offset) % 4))
#define VALUES_GET(p)        (*(__global const float4 *)(p))
#define VALUES_GET_ANY(p)    vload4(0, p)
#define VALUES_PUT(v, p)     (*(__global float4 *)(p) = (v))
#else
typedef float8 values_v;
#define VALUES_FIRST(offset) ((long)get_global_id(0) * 8)
#define VALUES_GET(p)        vload8(0, p)
#define VALUES_GET_ANY(p)    vload8(0, p)
#define VALUES_PUT(v, p)     VECTORS_STORE8(__global, v, p)
#endif

/* Whether all values of a work-item are there. */
#define VALUES_WHOLE(first, count) ((first) >= 0 && (first) + VALUE_WIDTH <= (long)(count))
/* The values that are there, where some are not. */
#define VALUES_EACH(i, first, count)                                                                                   \
    for (long i = max(first, (long)0); i < min((first) + VALUE_WIDTH, (long)(count)); i++)

#endif
