/* Transfer functions where the sensor crops: what the fit needs besides the steps of fit_nonnegative.cl
 * (lib/fit/cropped.c).
 *
 * Images of pixels are stored channel by channel. */
#include "inc_fit.h"

/* What is left of the difference between a prediction and a value, by the value's weight: 0 where that is 0; below 0
 * the value is the least that it may be. For scalars and vectors. */
#define FIT_LEFT(difference, w, zero)                                                                                  \
    select(select((difference), fmin((difference), 0.0f), (w) < 0.0f), (zero), (w) == 0.0f)

/* The residual of a model's prediction e of a frame b: e becomes e - b, as far as the pixels' weights say (weighted 0:
 * NULL, all alike). Work-items: chunks of 8 HADA_FIT_CHUNK pixels of a channel; the sum of the squares of a chunk is
 * added to out[channel * chunks + chunk]. */
__kernel void fit_remain(__global float *e, __global const float *b, __global const float *weights, int weighted,
                         __global float *out, ulong pixels, ulong chunks)
{
    const size_t chunk = get_global_id(0), channel = get_global_id(1);
    if (chunk >= chunks)
        return;
    const size_t from = chunk * 8 * HADA_FIT_CHUNK, to = min(from + 8 * HADA_FIT_CHUNK, (size_t)pixels);
    __global float *at = e + channel * pixels;
    __global const float *frame = b + channel * pixels, *w = weights + (weighted ? channel * pixels : 0);
    float8 sum = 0.0f;
    size_t i = from;
    for (; i + 8 <= to; i += 8) {
        float8 left = vload8(0, at + i) - vload8(0, frame + i);
        if (weighted)
            left = FIT_LEFT(left, vload8(0, w + i), (float8)0.0f);
        VECTORS_STORE8(__global, left, at + i);
        sum += left * left;
    }
    float rest = 0.0f;
    for (; i < to; i++) {
        const float over = at[i] - frame[i], left = weighted ? FIT_LEFT(over, w[i], 0.0f) : over;
        at[i] = left;
        rest += left * left;
    }
    out[channel * chunks + chunk] += fit_total(sum) + rest;
}

/* The cross sums of whole frames, of which the sensor shows a part: g, which holds sum conj(X) F(e - b) of the transfer
 * functions h, becomes Sxx h - step g. Both are in the image; step 1 fills in the light beyond the sensor as h predicts
 * it. */
__kernel void fit_fill(__global const float *sums, __global const float *h, __global float *g, hada_fit_image image,
                       float step)
{
    const size_t i = get_global_id(0), first = 2 * image.first;
    if (i >= image.vectors)
        return;
    const float8 scene = fit_high(sums, image.stride, 3, i);
    const float16 hv = vload16(i, h + first), gv = vload16(i, g + first);
    float16 filled;
    filled.even = scene * hv.even - step * gv.even;
    filled.odd = scene * hv.odd - step * gv.odd;
    fit_put(filled, i, image.count, g + first);
}
