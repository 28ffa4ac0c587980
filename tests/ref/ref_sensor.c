#include "ref/ref_sensor.h"

#include <math.h>

#include "ref/ref_layers.h"

#define EXACT 16.0 /* electrons: below, Poisson numbers are exact */

static void words(uint64_t seed, size_t index, uint32_t draw, uint32_t out[4])
{
    out[0] = (uint32_t)index;
    out[1] = (uint32_t)((uint64_t)index >> 32);
    out[2] = draw;
    out[3] = 0;
    hada_ref_philox(10, out, (uint32_t)seed, (uint32_t)(seed >> 32));
}

static double unit(uint32_t word)
{
    return ((word >> 8) + 1) / 16777216.0;
}

/* Cornish and Fisher's expansion for a Poisson number, before it is rounded. */
static double expanded(double mean, double g)
{
    return mean + sqrt(mean - 1.0 / 12.0) * g + (g * g - 1.0) / 6.0 + (g - g * g * g) / (72.0 * sqrt(mean));
}

/* Counts uniform numbers whose product stays above exp(-mean). */
static double exact(double mean, uint64_t seed, size_t index)
{
    uint32_t word[4];
    double product = 1.0;
    for (uint32_t count = 0;; count++) {
        if (count % 4 == 0)
            words(seed, index, count / 4 + 1, word);
        product *= unit(word[count % 4]);
        if (product <= exp(-mean))
            return count;
    }
}

double hada_ref_sensor(const hada_sensor *s, uint64_t seed, size_t index, double gain, double light)
{
    uint32_t word[4];
    words(seed, index, 0, word);
    const double radius = sqrt(-2.0 * log(unit(word[0]))), angle = 2.0 * acos(-1.0) * unit(word[1]);
    const double shot = radius * cos(angle), read = s->read_noise * radius * sin(angle),
                 share = s->exposure * gain * (light > 0.0 ? light : 0.0), mean = share * s->full_well;
    double y = s->saturate ? fmin(share, 1.0) : share;
    if (s->full_well > 0.0) {
        const double electrons = mean < EXACT ? exact(mean, seed, index) : fmax(0.0, rint(expanded(mean, shot)));
        y = ((s->saturate ? fmin(electrons, s->full_well) : electrons) + read) / s->full_well;
    } else {
        y += read;
    }
    y += s->dark_level;
    if (s->saturate)
        y = fmin(y, 1.0);
    if (!s->bits)
        return y;
    const double levels = (double)((1 << s->bits) - 1);
    return fmin(fmax(rint(y * levels), 0.0), levels) / levels;
}

double hada_ref_poisson_below(double mean, int count)
{
    double sum = 0.0;
    for (int k = 0; k <= count; k++)
        sum += exp(k * log(mean) - mean - lgamma(k + 1.0));
    return sum;
}

double hada_ref_poisson_approximated(double mean, int count)
{
    double low = -6.0, high = 6.0;
    for (int step = 0; step < 60; step++) {
        const double middle = (low + high) / 2.0;
        if (expanded(mean, middle) < count + 0.5)
            low = middle;
        else
            high = middle;
    }
    return 0.5 * erfc(-low / sqrt(2.0));
}
