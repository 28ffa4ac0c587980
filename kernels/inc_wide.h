/* Numbers side by side: WIDE_WIDTH of them, eight in the vectors of a CPU, or one, so that neighbouring work-items
 * access neighbouring numbers. Arrays begin anywhere. */
#ifndef INC_WIDE_H
#define INC_WIDE_H

#include "inc_vectors.h"

#ifndef WIDE_WIDTH
#define WIDE_WIDTH 8
#endif
#define WIDE_INLINE static inline __attribute__((always_inline))

/* wide_get_some, wide_put_some: the first `count` numbers from p on, at most WIDE_WIDTH; those behind them are read as
 * 0 and not written. */
#if WIDE_WIDTH == 8
typedef float8 wide_real;

WIDE_INLINE wide_real wide_get(__global const float *p)
{
    return vload8(0, p);
}

WIDE_INLINE void wide_put(wide_real v, __global float *p)
{
    VECTORS_STORE8(__global, v, p);
}

WIDE_INLINE wide_real wide_get_some(__global const float *p, long count)
{
    float some[8];
    if (count >= 8)
        return vload8(0, p);
    for (int i = 0; i < 8; ++i)
        some[i] = i < count ? p[i] : 0.0f;
    return vload8(0, some);
}

WIDE_INLINE void wide_put_some(wide_real v, __global float *p, long count)
{
    float some[8];
    if (count >= 8) {
        VECTORS_STORE8(__global, v, p);
        return;
    }
    VECTORS_STORE8(__private, v, some);
    for (int i = 0; i < count; ++i)
        p[i] = some[i];
}

WIDE_INLINE float wide_sum(wide_real v)
{
    const float4 a = v.lo + v.hi;
    const float2 b = a.lo + a.hi;
    return b.x + b.y;
}
#else
typedef float wide_real;

WIDE_INLINE wide_real wide_get(__global const float *p)
{
    return *p;
}

WIDE_INLINE void wide_put(wide_real v, __global float *p)
{
    *p = v;
}

WIDE_INLINE wide_real wide_get_some(__global const float *p, long count)
{
    return *p;
}

WIDE_INLINE void wide_put_some(wide_real v, __global float *p, long count)
{
    *p = v;
}

WIDE_INLINE float wide_sum(wide_real v)
{
    return v;
}
#endif

#endif
