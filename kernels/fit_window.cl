/* Filters judged in the window: conjugate gradients on T = P^-1 (N + D), where P is what stands under the exact fit's
 * fraction, D the same without the depth's own |B|^2, and N v = sum over pairs of conj(B) F crop F^-1 (B v)
 * (docs/filters.md). split: real and imaginary parts by themselves, as everywhere.
 *
 * Spectra stand one channel after the other, `count` complex numbers each. Sums over frequencies are partial sums over
 * FIT_CHUNK groups of eight that the host adds in order. */
#include "inc_fit.h"

#ifndef FIT_CHUNK
#define FIT_CHUNK 32
#endif

/* sum += conj(b) g of a pair, all channels at once; split: products of the real parts and of the imaginary parts. */
__kernel void fit_gather(__global const float *g, __global const float *b, __global float *sum, ulong vectors)
{
    const size_t i = get_global_id(0);
    if (i >= vectors)
        return;
    const float16 gv = vload16(i, g), bv = vload16(i, b);
    float16 product;
#if FIT_SPLIT
    product = gv * bv;
#else
    product.even = gv.even * bv.even + gv.odd * bv.odd;
    product.odd = gv.odd * bv.even - gv.even * bv.odd;
#endif
    vstore16(vload16(i, sum) + product, i, sum);
}

inline float8 fit_inner(float16 under, float16 u, float16 v)
{
    return under.even * u.even * v.even + under.odd * u.odd * v.odd;
}

/* For a channel at complex number `offset`: t, which holds N p, becomes (T + shift) p; out[chunk] = sum of weight P p t
 * over its frequencies. */
__kernel void fit_apply(__global const float *p, __global float *t, ulong offset, ulong count,
                        __global const float *sums, __global const float *pool, ulong stride,
                        __global const float *weights, float alpha, float ridge, float shift, __global float *out,
                        int first, int chunks, ulong vectors)
{
    const int chunk = get_global_id(0);
    if (chunk >= chunks)
        return;
    const size_t from = (size_t)chunk * FIT_CHUNK, to = min(from + FIT_CHUNK, (size_t)vectors);
    float8 sum = 0.0f;
    for (size_t i = from; i < to; i++) {
        const fit_under under = fit_under_of(sums, pool, stride, alpha, ridge, i);
        const float16 pv = vload16(i, p + 2 * offset), gathered = vload16(i, t + 2 * offset);
        const float16 tv = fit_divide_parts(gathered + (under.whole - under.own) * pv, under.whole) + shift * pv;
        const float8 weight = vload8(i, weights);
        fit_put(tv, i, count, t + 2 * offset);
        /* padding holds anything, so it is left out rather than multiplied by zero */
        sum += weight > 0.0f ? weight * fit_inner(under.whole, pv, tv) : (float8)0.0f;
    }
    out[first + chunk] = fit_total(sum);
}

/* The residual: r -= step t; out[chunk] = sum of weight P r r. */
__kernel void fit_residual(__global float *r, __global const float *t, ulong offset, ulong count,
                           __global const float *sums, __global const float *pool, ulong stride,
                           __global const float *weights, float alpha, float ridge, float step, __global float *out,
                           int first, int chunks, ulong vectors)
{
    const int chunk = get_global_id(0);
    if (chunk >= chunks)
        return;
    const size_t from = (size_t)chunk * FIT_CHUNK, to = min(from + FIT_CHUNK, (size_t)vectors);
    float8 sum = 0.0f;
    for (size_t i = from; i < to; i++) {
        const fit_under under = fit_under_of(sums, pool, stride, alpha, ridge, i);
        const float16 rv = vload16(i, r + 2 * offset) - step * vload16(i, t + 2 * offset);
        const float8 weight = vload8(i, weights);
        fit_put(rv, i, count, r + 2 * offset);
        sum += weight > 0.0f ? weight * fit_inner(under.whole, rv, rv) : (float8)0.0f;
    }
    out[first + chunk] = fit_total(sum);
}

/* x += step p, and then the next direction: p = zeta r + beta p. */
__kernel void fit_advance(__global float *x, __global float *p, __global const float *r, ulong offset, ulong count,
                          float step, float zeta, float beta, ulong vectors)
{
    const size_t i = get_global_id(0);
    if (i >= vectors)
        return;
    const float16 pv = vload16(i, p + 2 * offset);
    fit_put(vload16(i, x + 2 * offset) + step * pv, i, count, x + 2 * offset);
    fit_put(zeta * vload16(i, r + 2 * offset) + beta * pv, i, count, p + 2 * offset);
}
