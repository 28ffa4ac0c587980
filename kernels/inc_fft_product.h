/* The filter product that an inverse transform applies while it reads a spectrum.
 * FFT_PRODUCT: 0 none, 1 complex, 2 split (re*re, im*im). FFT_HALF: the filter is stored as half. */
#ifndef INC_FFT_PRODUCT_H
#define INC_FFT_PRODUCT_H

#ifndef FFT_PRODUCT
#define FFT_PRODUCT 0
#endif
#ifndef FFT_HALF
#define FFT_HALF 0
#endif

#if FFT_HALF
typedef ushort filter_value;
/* Eight finite halves: their bits moved to where float has them, and the exponent's bias set right. As exact as
 * vload_half8, which some CPU drivers do one by one. */
static inline float8 load_filter(__global const ushort *p)
{
    const uint8 bits = convert_uint8(vload8(0, p));
    return as_float8((bits & 0x7fffu) << 13 | (bits & 0x8000u) << 16) * 0x1p112f;
}
static inline float2 load_filter_value(__global const ushort *p)
{
    return vload_half2(0, (__global const half *)p);
}
/* Two complex values, aligned. */
static inline float4 load_filter_values(__global const ushort *p)
{
    const uint4 bits = convert_uint4(*(__global const ushort4 *)p);
    return as_float4((bits & 0x7fffu) << 13 | (bits & 0x8000u) << 16) * 0x1p112f;
}
#else
typedef float filter_value;
static inline float8 load_filter(__global const float *p)
{
    return vload8(0, p);
}
static inline float2 load_filter_value(__global const float *p)
{
    return vload2(0, p);
}
static inline float4 load_filter_values(__global const float *p)
{
    return *(__global const float4 *)p;
}
#endif

/* A value of a spectrum times one of its filter. */
#if FFT_PRODUCT == 1
static inline float2 filter_product(float2 v, float2 h)
{
    return (float2)(fma(v.x, h.x, -(v.y * h.y)), fma(v.x, h.y, v.y * h.x));
}
#elif FFT_PRODUCT == 2
static inline float2 filter_product(float2 v, float2 h)
{
    return v * h;
}
#endif

#endif
