#include "core/random.h"

#include <math.h>

#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF /* a fused multiply-add would change the bits; GCC in ISO mode does not fuse */
#endif

static uint64_t splitmix(uint64_t *x)
{
    uint64_t z = *x += 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

void hada_random_seed(hada_random *random, uint64_t seed, uint64_t sequence)
{
    uint64_t mix = seed;
    const uint64_t a = splitmix(&mix);
    mix = sequence ^ a;
    *random = (hada_random){.state = 0, .stream = splitmix(&mix) | 1u};
    hada_random_bits(random);
    random->state += splitmix(&mix);
    hada_random_bits(random);
}

uint32_t hada_random_bits(hada_random *random)
{
    const uint64_t old = random->state;
    random->state = old * 6364136223846793005u + random->stream;
    const uint32_t shifted = (uint32_t)(((old >> 18) ^ old) >> 27), turn = (uint32_t)(old >> 59);
    return (shifted >> turn) | (shifted << ((32u - turn) & 31u));
}

double hada_random_uniform(hada_random *random)
{
    const uint64_t high = hada_random_bits(random) >> 5, low = hada_random_bits(random) >> 6;
    return (double)((high << 26) | low) * (1.0 / 9007199254740992.0);
}

double hada_random_range(hada_random *random, double low, double high)
{
    const double width = high - low;
    const double step = width * hada_random_uniform(random);
    return low + step;
}

uint32_t hada_random_below(hada_random *random, uint32_t count)
{
    const uint32_t skip = (0u - count) % count; /* the first values of the range that would be hit once more often */
    uint32_t bits;
    do
        bits = hada_random_bits(random);
    while (bits < skip);
    return bits % count;
}

/* Natural logarithm of 0 < x < 1 to double precision: x = m 2^e with m in [1/sqrt 2, sqrt 2), log m by the series of
 * the inverse hyperbolic tangent. */
static double logarithm(double x)
{
    int exponent;
    double m = frexp(x, &exponent);
    if (m < 0.70710678118654752) {
        m *= 2.0;
        exponent--;
    }
    const double t = (m - 1.0) / (m + 1.0), square = t * t;
    double sum = 0.0;
    for (int k = 25; k >= 1; k -= 2) {
        const double scaled = sum * square;
        sum = scaled + 1.0 / k;
    }
    const double small = 2.0 * t * sum, large = exponent * 0.69314718055994531;
    return large + small;
}

double hada_random_normal(hada_random *random)
{
    if (random->has_spare) {
        random->has_spare = 0;
        return random->spare;
    }
    double u, v, s;
    do {
        u = hada_random_range(random, -1.0, 1.0);
        v = hada_random_range(random, -1.0, 1.0);
        const double uu = u * u, vv = v * v;
        s = uu + vv;
    } while (s >= 1.0 || s == 0.0);
    const double factor = sqrt(-2.0 * logarithm(s) / s);
    random->spare = v * factor;
    random->has_spare = 1;
    return u * factor;
}
