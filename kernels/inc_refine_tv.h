/* For the kernels of total variation: the projection of a dual. */
#ifndef INC_REFINE_TV_H
#define INC_REFINE_TV_H

#include "inc_refine.h"

/* Avoids a division by a slope of zero. */
#define TV_LEAST 1e-30f

/* The nearest point of the ellipsoid |mean|^2 + per_colour |rest|^2 <= 1: the mean of the channels is shortened by
 * 1 + mu, the rest by 1 + per_colour mu. Newton's method on 1 / |p| = 1 finds mu: exact at once where per_colour is 1,
 * to single precision in three rounds for colours up to 4. mean, rest: the squares. */
REFINE_INLINE void tv_shorten(refine_real mean, refine_real rest, float per_colour, refine_real *of_mean,
                              refine_real *of_rest)
{
    const int rounds = per_colour == 1.0f ? 0 : 3;
    const refine_real length = sqrt(fma(rest, (refine_real)per_colour, mean));
    refine_real mu = max(length - 1.0f, 0.0f);
    *of_mean = *of_rest = 1.0f / (1.0f + mu);
    for (int k = 0; k < rounds; ++k) {
        *of_rest = 1.0f / fma((refine_real)per_colour, mu, 1.0f);
        const refine_real a = mean * *of_mean * *of_mean, b = per_colour * rest * *of_rest * *of_rest;
        const refine_real slope = fma(a, *of_mean, per_colour * b * *of_rest);
        /* 0 where p is inside */
        mu = mu > 0.0f ? max(fma((a + b) / max(slope, TV_LEAST), sqrt(a + b) - 1.0f, mu), 0.0f) : mu;
        *of_mean = 1.0f / (1.0f + mu);
    }
    if (rounds)
        *of_rest = 1.0f / fma((refine_real)per_colour, mu, 1.0f);
}

#endif
