/* Transfer functions of point spread functions without negative values: the steps of lib/fit/nonnegative.c.
 *
 * Frequencies are taken eight at a time; where the last eight reach beyond an image's end, one by one, since another
 * image may follow. */
#include "inc_fit.h"

/* A compromise between the pairs and a guess G, each with its weight: H = (S + weight G) / (w + weight), S = conj(Sxb)
 * scale, w = Sxx scale. Written to the image of `out`; G begins at complex number `guess_first` of `guess` and may be
 * what is written. guessed 0: G = 0. is_filled 1: S = filled scale, which begins at the same number. */
__kernel void fit_blend(__global const float *sums, __global const float *filled, int is_filled,
                        __global const float *guess, ulong guess_first, int guessed, __global float *out,
                        hada_fit_image image, hada_fit_blend_rule rule)
{
    const size_t i = get_global_id(0), first = 8 * i, count = image.count, stride = image.stride;
    const float scale = rule.scale, weight = rule.weight;
    if (first >= count)
        return;
    const float8 under = fma(max(fit_high(sums, stride, 3, i), 0.0f), (float8)scale, (float8)weight);
    float16 h;
    if (is_filled) {
        h = vload16(i, filled + 2 * guess_first) * scale;
    } else {
        h.even = fit_high(sums, stride, 0, i) * scale;
        h.odd = fit_high(sums, stride, 1, i) * -scale;
    }
    __global const float *g = guess + 2 * guess_first;
    __global float *to = out + 2 * image.first;
    if (first + 8 <= count) {
        if (guessed)
            h = fma(vload16(i, g), (float16)weight, h);
        h.even /= under;
        h.odd /= under;
        VECTORS_STORE16(__global, h, to + 16 * i);
        return;
    }
    float over[16], by[8];
    vstore16(h, 0, over);
    vstore8(under, 0, by);
    for (size_t k = 0; first + k < count; ++k)
        for (size_t part = 2 * k; part < 2 * k + 2; ++part) {
            if (guessed)
                over[part] = fma(g[2 * first + part], weight, over[part]);
            to[2 * first + part] = over[part] / by[k];
        }
}

/* A step at eight pixels. v holds u = max(v, 0), the non-negative image, and d = min(v, 0), the scaled dual; x comes in
 * as the image of H. The new v is r x + (1 - r) u + d with the relaxation r, its d times the dual's scale; x goes out
 * as the next guess: u - d, or (last) u. start: v is not read, u = d = 0. */
__kernel void fit_clip(__global float *x, __global float *v, hada_fit_clip_rule rule, ulong vectors)
{
    const float over = rule.relaxation;
    const size_t i = get_global_id(0);
    if (i >= vectors)
        return;
    float8 next = over * vload8(i, x);
    if (!rule.start) {
        const float8 now = vload8(i, v);
        next = fma(max(now, 0.0f), (float8)(1.0f - over), next) + min(now, 0.0f);
    }
    const float8 u = max(next, 0.0f), d = min(next, 0.0f) * rule.dual_scale;
    VECTORS_STORE8(__global, u + d, v + 8 * i);
    VECTORS_STORE8(__global, rule.last ? u : u - d, x + 8 * i);
}
