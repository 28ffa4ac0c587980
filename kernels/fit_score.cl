/* Leave-one-out scores, and the noise. Work-items: chunks of HADA_FIT_CHUNK vectors of eight frequencies (times
 * FIT_MEMBERS), whose partial sums the host adds in order. Sums: inc_fit.h. */
#include "inc_fit.h"

/* Removes a pair (spectra x, b) from its sums, fits a filter without it for each of the penalties and tries them on it:
 * error[setting] = spectrum of scene - filtered frame, image.count complex numbers each, and leak[setting][chunk] = sum
 * of weight |W|^2 * mean |B|^2 of the other depths. */
__kernel __attribute__((reqd_work_group_size(FIT_GROUP, 1, 1))) void
fit_trial(__global const float *x, __global const float *b, __global const float *sums, __global const float *pool,
          __global const float *weights, __global float *error, __global float *leak, hada_fit_image image,
          hada_fit_trials trials)
{
    FIT_LOCAL
    const size_t stride = image.stride, offset = image.first;
    const float per_pair = trials.per_pair, per_other = trials.per_other;
    const fit_share share_of = fit_share_of(image);
    FIT_KEPT others[HADA_FIT_TRIALS];
    for (int s = 0; s < HADA_FIT_TRIALS; s++)
        others[s] = 0.0f;
    for (size_t i = share_of.first; i < share_of.last; i += FIT_MEMBERS) {
        const float16 xv = vload16(i, x + 2 * offset), bv = vload16(i, b + 2 * offset);
        const float8 weight = fit_eight(i, weights);
        const fit_terms terms = fit_terms_of(xv, bv);
        const float8 whole = fit_high(sums, stride, 2, i);
        const float8 raw = max(fit_without(sums, stride, 2, i, terms.raw), 0.0f);
        const float8 re = fit_without(sums, stride, 0, i, terms.cross_re);
        const float8 other = max(fit_eight(i, pool) - whole, 0.0f);
        const float8 seen = max(fit_eight(i, pool + stride) - whole * per_pair, 0.0f) * per_other;
#if FIT_SPLIT
        const float8 part = fit_high(sums, stride, 5, i);
        const float8 raw_r = clamp(fit_without(sums, stride, 5, i, terms.split_raw), 0.0f, raw);
        const float8 cross_r = fit_without(sums, stride, 4, i, terms.split_cross);
        const float8 other_r = clamp(fit_eight(i, pool + 3 * stride) - part, 0.0f, other);
        const float8 seen_r = clamp((fit_eight(i, pool + 4 * stride) - part * per_pair) * per_other, 0.0f, seen);
#else
        const float8 im = fit_without(sums, stride, 1, i, terms.cross_im);
#endif
        for (int s = 0; s < HADA_FIT_TRIALS; s++) {
            const float alpha = trials.penalty[s].alpha, ridge = trials.penalty[s].ridge;
            float8 lost;
            float16 e;
#if FIT_SPLIT
            const float8 wr = fit_divide(cross_r, raw_r + alpha * other_r + 0.5f * ridge);
            const float8 wi = fit_divide(re - cross_r, raw - raw_r + alpha * (other - other_r) + 0.5f * ridge);
            e.even = xv.even - wr * bv.even;
            e.odd = xv.odd - wi * bv.odd;
            lost = wr * wr * seen_r + wi * wi * (seen - seen_r);
#else
            const float8 share = fit_divide((float8)1.0f, raw + alpha * other + ridge);
            const float8 wr = re * share, wi = im * share;
            e.even = xv.even - (wr * bv.even - wi * bv.odd);
            e.odd = xv.odd - (wr * bv.odd + wi * bv.even);
            lost = (wr * wr + wi * wi) * seen;
#endif
            fit_put(e, i, image.count, error + (size_t)s * 2 * image.count);
            /* padding may hold anything, so it is left out rather than multiplied by zero */
            others[s] += FIT_KEEP(weight > 0.0f ? weight * lost : (float8)0.0f);
        }
    }
    for (int s = 0; s < HADA_FIT_TRIALS; s++) {
        const float total = FIT_KEPT_TOTAL(others[s]);
        if (share_of.writes)
            leak[(size_t)s * image.chunks + share_of.chunk] = total;
    }
}

/* out[setting][row] = sum of squares of a row of the window. */
__kernel void fit_energy(__global const float *planes, int rows, int cols, __global float *out)
{
    const int row = get_global_id(0), setting = get_global_id(1);
    if (row >= rows)
        return;
    __global const float *pixels = planes + ((size_t)setting * rows + row) * cols;
    float8 sum = 0.0f;
    for (int i = 0; i < cols / 8; i++) {
        const float8 value = vload8(i, pixels);
        sum += value * value;
    }
    float total = fit_total(sum);
    for (int col = cols / 8 * 8; col < cols; col++)
        total += pixels[col] * pixels[col];
    out[(size_t)setting * rows + row] = total;
}

/* out[chunk] = sum of weight (Sbb - |Sxb|^2 / max(Sxx, least)): the part that no linear camera explains. */
__kernel __attribute__((reqd_work_group_size(FIT_GROUP, 1, 1))) void fit_unexplained(__global const float *sums,
                                                                                     __global const float *weights,
                                                                                     __global float *out,
                                                                                     hada_fit_image image, float least)
{
    FIT_LOCAL
    const size_t stride = image.stride;
    const fit_share share = fit_share_of(image);
    float8 sum = 0.0f;
    for (size_t i = share.first; i < share.last; i += FIT_MEMBERS) {
        const float8 weight = fit_eight(i, weights), under = max(fit_high(sums, stride, 3, i), least);
        const float8 re = fit_high(sums, stride, 0, i), im = fit_high(sums, stride, 1, i);
        const float8 rest = fit_high(sums, stride, 2, i) - fit_divide(re * re + im * im, under);
        sum += weight > 0.0f ? weight * max(rest, 0.0f) : (float8)0.0f;
    }
    const float total = FIT_TOTAL(sum);
    if (share.writes)
        out[share.chunk] = total;
}
