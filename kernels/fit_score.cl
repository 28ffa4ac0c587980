/* Leave-one-out errors of one pair, and what the noise is, as partial sums over FIT_CHUNK groups of four frequencies
 * that the host adds in order. The pair is taken out of the sums, the filter made without it is tried on it; by
 * Parseval's theorem the squared error over the frame is a weighted sum over the half spectrum. */
#include "inc_fit.h"

#ifndef FIT_CHUNK
#define FIT_CHUNK 64
#endif

inline float fit_total(float4 value)
{
    return (value.x + value.y) + (value.z + value.w);
}

/* For each setting (alpha, lambda; the ridge is lambda * scale): out[0][setting][chunk] = sum of weight |X - W B|^2 and
 * out[1][setting][chunk] = sum of weight |W|^2 * mean |B|^2 of the other depths, W fitted without this pair. */
__kernel void fit_leave_one_out(__global const float *x, __global const float *b, ulong offset,
                                __global const float *sums, __global const float *pool, ulong stride,
                                __global const float *weights, __global const float2 *settings, int setting_count,
                                float scale, float per_pair, float per_other, __global float *out, int chunks,
                                ulong vectors)
{
    const int setting = get_global_id(0), chunk = get_global_id(1);
    if (chunk >= chunks)
        return;
    const float alpha = settings[setting].x, ridge = settings[setting].y * scale;
    const size_t first = (size_t)chunk * FIT_CHUNK;
    const size_t last = min(first + FIT_CHUNK, (size_t)vectors);
    float4 own = 0.0f, others = 0.0f;
    for (size_t i = first; i < last; i++) {
        const float8 xv = vload8(i, x + 2 * offset), bv = vload8(i, b + 2 * offset);
        const float4 weight = vload4(i, weights);
        const fit_terms terms = fit_terms_of(xv, bv);
        const float4 whole = fit_high(sums, stride, 2, i);
        const float4 raw = max(fit_without(sums, stride, 2, i, terms.raw), 0.0f);
        const float4 re = fit_without(sums, stride, 0, i, terms.cross_re);
        const float4 other = max(vload4(i, pool) - whole, 0.0f);
        const float4 seen = max(vload4(i, pool + stride) - whole * per_pair, 0.0f) * per_other;
        float4 er, ei, leak;
#if FIT_SPLIT
        const float4 part = fit_high(sums, stride, 5, i);
        const float4 raw_r = clamp(fit_without(sums, stride, 5, i, terms.split_raw), 0.0f, raw);
        const float4 cross_r = fit_without(sums, stride, 4, i, terms.split_cross);
        const float4 other_r = clamp(vload4(i, pool + 3 * stride) - part, 0.0f, other);
        const float4 seen_r = max(vload4(i, pool + 4 * stride) - part * per_pair, 0.0f) * per_other;
        const float4 wr = fit_divide(cross_r, raw_r + alpha * other_r + 0.5f * ridge);
        const float4 wi = fit_divide(re - cross_r, raw - raw_r + alpha * (other - other_r) + 0.5f * ridge);
        er = xv.even - wr * bv.even;
        ei = xv.odd - wi * bv.odd;
        leak = wr * wr * seen_r + wi * wi * max(seen - seen_r, 0.0f);
#else
        const float4 im = fit_without(sums, stride, 1, i, terms.cross_im);
        const float4 under = raw + alpha * other + ridge;
        const float4 wr = fit_divide(re, under), wi = fit_divide(im, under);
        er = xv.even - (wr * bv.even - wi * bv.odd);
        ei = xv.odd - (wr * bv.odd + wi * bv.even);
        leak = (wr * wr + wi * wi) * seen;
#endif
        /* padding holds anything, so it is left out rather than multiplied by zero */
        own += weight > 0.0f ? weight * (er * er + ei * ei) : (float4)0.0f;
        others += weight > 0.0f ? weight * leak : (float4)0.0f;
    }
    out[(size_t)setting * chunks + chunk] = fit_total(own);
    out[(size_t)(setting_count + setting) * chunks + chunk] = fit_total(others);
}

/* out[0][chunk] = sum of weight (Sbb - |Sxb|^2 / max(Sxx, floor)): what no linear camera explains. */
__kernel void fit_unexplained(__global const float *sums, ulong stride, __global const float *weights, float least,
                              __global float *out, int chunks, ulong vectors)
{
    const size_t chunk = get_global_id(0), first = chunk * FIT_CHUNK;
    if (chunk >= (size_t)chunks)
        return;
    const size_t last = min(first + FIT_CHUNK, (size_t)vectors);
    float4 sum = 0.0f;
    for (size_t i = first; i < last; i++) {
        const float4 weight = vload4(i, weights), under = max(fit_high(sums, stride, 3, i), least);
        const float4 re = fit_high(sums, stride, 0, i), im = fit_high(sums, stride, 1, i);
        const float4 rest = fit_high(sums, stride, 2, i) - fit_divide(re * re + im * im, under);
        sum += weight > 0.0f ? weight * max(rest, 0.0f) : (float4)0.0f;
    }
    out[chunk] = fit_total(sum);
}
