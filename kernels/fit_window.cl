/* Filters by the error in the window: conjugate gradients on T = P^-1 (N + D), where P is the denominator of the exact
 * fit, D the same without the depth's own |B|^2, and N v = sum over pairs of conj(B) F crop F^-1(B v)
 * (docs/explanation/learning-a-camera.md). split: real and imaginary parts separately.
 *
 * Spectra are stored channel by channel. Sums over frequencies are partial sums over HADA_FIT_CHUNK vectors of eight
 * that the host adds in order. */
#include "inc_fit.h"

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
    VECTORS_STORE16(__global, vload16(i, sum) + product, sum + 16 * i);
}

static inline float8 fit_inner(float16 under, float16 u, float16 v)
{
    return under.even * u.even * v.even + under.odd * u.odd * v.odd;
}

/* Of a channel: t, which holds N p, becomes (T + shift) p; out[chunk] = sum of weight P p t over its frequencies. */
__kernel __attribute__((reqd_work_group_size(FIT_GROUP, 1, 1))) void
fit_apply(__global const float *p, __global float *t, __global const float *sums, __global const float *pool,
          __global const float *weights, __global float *out, hada_fit_image image, hada_fit_penalty penalty,
          float shift)
{
    FIT_LOCAL
    const size_t offset = image.first;
    const fit_share share = fit_share_of(image);
    float8 sum = 0.0f;
    for (size_t i = share.first; i < share.last; i += FIT_MEMBERS) {
        const fit_under under = fit_under_of(sums, pool, image.stride, penalty, i);
        const float16 pv = vload16(i, p + 2 * offset), gathered = vload16(i, t + 2 * offset);
        const float16 tv = fit_divide_parts(gathered + (under.whole - under.own) * pv, under.whole) + shift * pv;
        const float8 weight = fit_eight(i, weights);
        fit_put(tv, i, image.count, t + 2 * offset);
        /* padding may hold anything, so it is left out rather than multiplied by zero */
        sum += weight > 0.0f ? weight * fit_inner(under.whole, pv, tv) : (float8)0.0f;
    }
    const float total = FIT_TOTAL(sum);
    if (share.writes)
        out[image.partial + share.chunk] = total;
}

/* The residual: r -= step t; out[chunk] = sum of weight P r r. */
__kernel __attribute__((reqd_work_group_size(FIT_GROUP, 1, 1))) void
fit_residual(__global float *r, __global const float *t, __global const float *sums, __global const float *pool,
             __global const float *weights, __global float *out, hada_fit_image image, hada_fit_penalty penalty,
             float step)
{
    FIT_LOCAL
    const size_t offset = image.first;
    const fit_share share = fit_share_of(image);
    float8 sum = 0.0f;
    for (size_t i = share.first; i < share.last; i += FIT_MEMBERS) {
        const fit_under under = fit_under_of(sums, pool, image.stride, penalty, i);
        const float16 rv = vload16(i, r + 2 * offset) - step * vload16(i, t + 2 * offset);
        const float8 weight = fit_eight(i, weights);
        fit_put(rv, i, image.count, r + 2 * offset);
        sum += weight > 0.0f ? weight * fit_inner(under.whole, rv, rv) : (float8)0.0f;
    }
    const float total = FIT_TOTAL(sum);
    if (share.writes)
        out[image.partial + share.chunk] = total;
}

/* x += step p, and then the next direction: p = zeta r + beta p. */
__kernel void fit_advance(__global float *x, __global float *p, __global const float *r, hada_fit_image image,
                          float step, float zeta, float beta)
{
    const size_t i = get_global_id(0), first = 2 * image.first;
    if (i >= image.vectors)
        return;
    const float16 pv = vload16(i, p + first);
    fit_put(vload16(i, x + first) + step * pv, i, image.count, x + first);
    fit_put(zeta * vload16(i, r + first) + beta * pv, i, image.count, p + first);
}
