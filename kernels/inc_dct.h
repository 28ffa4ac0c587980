/* Cosine transforms (DCT-II, orthonormal) of eight values, and the shrinkage of their coefficients. */
#ifndef INC_DCT_H
#define INC_DCT_H

/* Work-items of a group: one with vectors of eight lanes, more with numbers. */
#ifndef DCT_GROUP
#define DCT_GROUP 1
#endif
#if DCT_GROUP == 1
#define WIDE_WIDTH 8
#else
#define WIDE_WIDTH 1
#endif
#include "inc_wide.h"

typedef wide_real dct_real;

#define DCT_INLINE static inline __attribute__((always_inline))

/* cos(i pi / 16) / 2 */
#define DCT_C1 0.490392640201615f
#define DCT_C2 0.461939766255643f
#define DCT_C3 0.415734806151273f
#define DCT_C4 0.353553390593274f
#define DCT_C5 0.277785116509801f
#define DCT_C6 0.191341716182545f
#define DCT_C7 0.097545161008064f
/* Below this T^2 the shrunk coefficient is 0. */
#define DCT_LEAST 1e-30f

/* Coefficient k of place i among n. */
DCT_INLINE float dct_basis(int k, int i, int n)
{
    return sqrt((k ? 2.0f : 1.0f) / (float)n) * cospi((float)((2 * i + 1) * k) / (float)(2 * n));
}

DCT_INLINE void dct_forward(dct_real v[8])
{
    const dct_real s0 = v[0] + v[7], s1 = v[1] + v[6], s2 = v[2] + v[5], s3 = v[3] + v[4];
    const dct_real d0 = v[0] - v[7], d1 = v[1] - v[6], d2 = v[2] - v[5], d3 = v[3] - v[4];
    const dct_real a = s0 + s3, b = s1 + s2, c = s0 - s3, d = s1 - s2;
    v[0] = DCT_C4 * (a + b);
    v[4] = DCT_C4 * (a - b);
    v[2] = fma((dct_real)DCT_C2, c, DCT_C6 * d);
    v[6] = fma((dct_real)DCT_C6, c, -DCT_C2 * d);
    v[1] = fma((dct_real)DCT_C1, d0, fma((dct_real)DCT_C3, d1, fma((dct_real)DCT_C5, d2, DCT_C7 * d3)));
    v[3] = fma((dct_real)DCT_C3, d0, fma((dct_real)-DCT_C7, d1, fma((dct_real)-DCT_C1, d2, -DCT_C5 * d3)));
    v[5] = fma((dct_real)DCT_C5, d0, fma((dct_real)-DCT_C1, d1, fma((dct_real)DCT_C7, d2, DCT_C3 * d3)));
    v[7] = fma((dct_real)DCT_C7, d0, fma((dct_real)-DCT_C5, d1, fma((dct_real)DCT_C3, d2, -DCT_C1 * d3)));
}

DCT_INLINE void dct_inverse(dct_real v[8])
{
    const dct_real a = DCT_C4 * (v[0] + v[4]), b = DCT_C4 * (v[0] - v[4]);
    const dct_real c = fma((dct_real)DCT_C2, v[2], DCT_C6 * v[6]), d = fma((dct_real)DCT_C6, v[2], -DCT_C2 * v[6]);
    const dct_real s0 = a + c, s1 = b + d, s2 = b - d, s3 = a - c;
    const dct_real d0 =
        fma((dct_real)DCT_C1, v[1], fma((dct_real)DCT_C3, v[3], fma((dct_real)DCT_C5, v[5], DCT_C7 * v[7])));
    const dct_real d1 =
        fma((dct_real)DCT_C3, v[1], fma((dct_real)-DCT_C7, v[3], fma((dct_real)-DCT_C1, v[5], -DCT_C5 * v[7])));
    const dct_real d2 =
        fma((dct_real)DCT_C5, v[1], fma((dct_real)-DCT_C1, v[3], fma((dct_real)DCT_C7, v[5], DCT_C3 * v[7])));
    const dct_real d3 =
        fma((dct_real)DCT_C7, v[1], fma((dct_real)-DCT_C5, v[3], fma((dct_real)DCT_C3, v[5], -DCT_C1 * v[7])));
    v[0] = s0 + d0;
    v[1] = s1 + d1;
    v[2] = s2 + d2;
    v[3] = s3 + d3;
    v[4] = s3 - d3;
    v[5] = s2 - d2;
    v[6] = s1 - d1;
    v[7] = s0 - d0;
}

/* The non-negative garrote of threshold t. */
DCT_INLINE dct_real dct_garrote(dct_real v, float t)
{
    const dct_real square = v * v;
    return v * max(1.0f - t * t / max(square, DCT_LEAST), 0.0f);
}

#endif
