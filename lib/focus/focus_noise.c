/* The threshold's statistics: medians from counts, and what noise does to the measures. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "focus/focus.h"

/* The middle of a bin. */
static double bin_value(int bin)
{
    const uint32_t pattern = ((uint32_t)bin & 0xffffu) << 16 | 0x8000u;
    float value;
    if (!bin)
        return 0.0;
    memcpy(&value, &pattern, sizeof value);
    return value;
}

/* The bin that holds the value of rank (count - 1) / 2 among bins first .. */
static int median_bin(const int64_t *bins, int first, int64_t count)
{
    int64_t seen = 0;
    int bin = first;
    while (bin < HADA_FOCUS_BINS - 1 && (seen += bins[bin]) * 2 < count)
        bin++;
    return bin;
}

static int64_t count_from(const int64_t *bins, int first)
{
    int64_t count = 0;
    for (int i = first; i < HADA_FOCUS_BINS; i++)
        count += bins[i];
    return count;
}

double hada_focus_bins_median_positive(const int64_t *bins, int64_t *total)
{
    *total = count_from(bins, 1);
    return *total ? bin_value(median_bin(bins, 1, *total)) : 0.0;
}

void hada_focus_bins_spread(const int64_t *bins, double *median, double *spread)
{
    const int64_t count = count_from(bins, 0);
    *median = *spread = 0.0;
    if (!count)
        return;
    const int middle = median_bin(bins, 0, count);
    *median = bin_value(middle);
    /* outwards from the median, always the nearer side, until half of the values are passed */
    int low = middle - 1, high = middle + 1;
    int64_t passed = bins[middle];
    double deviation = 0.0;
    while (passed * 2 < count && (low >= 0 || high < HADA_FOCUS_BINS)) {
        const double down = low >= 0 ? *median - bin_value(low) : INFINITY,
                     up = high < HADA_FOCUS_BINS ? bin_value(high) - *median : INFINITY;
        deviation = fmin(down, up);
        passed += down <= up ? bins[low--] : bins[high++];
    }
    *spread = 1.4826 * deviation;
}

double hada_focus_normal_quantile(double p)
{
    double low = -40.0, high = 40.0;
    for (int i = 0; i < 100; i++) {
        const double middle = 0.5 * (low + high);
        if (0.5 * erfc(middle / sqrt(2.0)) > p)
            low = middle;
        else
            high = middle;
    }
    return 0.5 * (low + high);
}

/* Sum over the image of a 3 x 3 filter times another, moved by (row, col). */
static double correlation(const double a[3][3], const double b[3][3], int row, int col)
{
    double sum = 0.0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (i + row >= 0 && i + row < 3 && j + col >= 0 && j + col < 3)
                sum += a[i][j] * b[i + row][j + col];
    return sum;
}

static double window_overlap(const double *weights, int radius, int lag)
{
    double sum = 0.0;
    for (int k = 0; k + lag <= 2 * radius; k++)
        sum += weights[k] * weights[k + lag];
    return sum;
}

/* Contrast: e = gx^2 + gy^2 of normal gx and gy, whose covariance at a lag is twice the sum of the squared
 * correlations (Isserlis). */
static void contrast_moments(const double *weights, int radius, double *mean, double *deviation)
{
    static const double across[3][3] = {{-0.125, 0, 0.125}, {-0.25, 0, 0.25}, {-0.125, 0, 0.125}},
                        along[3][3] = {{-0.125, -0.25, -0.125}, {0, 0, 0}, {0.125, 0.25, 0.125}};
    double variance = 0.0;
    for (int r = -2; r <= 2; r++)
        for (int c = -2; c <= 2; c++) {
            const double xx = correlation(across, across, r, c), yy = correlation(along, along, r, c),
                         xy = correlation(across, along, r, c), yx = correlation(along, across, r, c);
            variance += window_overlap(weights, radius, r < 0 ? -r : r) *
                        window_overlap(weights, radius, c < 0 ? -c : c) * 2.0 * (xx * xx + yy * yy + xy * xy + yx * yx);
        }
    *mean = correlation(across, across, 0, 0) + correlation(along, along, 0, 0);
    *deviation = sqrt(variance);
}

/* Energy: the positive part of a normal variable, averaged. */
static void energy_moments(const double *weights, int radius, double *mean, double *deviation)
{
    const double pi = 3.14159265358979324;
    *mean = 1.0 / sqrt(2.0 * pi);
    *deviation = sqrt(0.5 - 0.5 / pi) * window_overlap(weights, radius, 0);
}

void hada_focus_noise_moments(hada_focus_measure measure, const double *weights, int radius, double *mean,
                              double *deviation)
{
    if (measure == HADA_FOCUS_ENERGY) {
        energy_moments(weights, radius, mean, deviation);
        return;
    }
    contrast_moments(weights, radius, mean, deviation);
    if (measure == HADA_FOCUS_CONTRAST)
        return;
    /* energy times the root of contrast: value and gradient of white noise are uncorrelated, so to first order the
     * relative variances add up, the root's being a quarter of the contrast's */
    double energy, energy_deviation;
    energy_moments(weights, radius, &energy, &energy_deviation);
    const double a = energy_deviation / energy, b = *deviation / *mean;
    *mean = energy * sqrt(*mean);
    *deviation = *mean * sqrt(a * a + b * b / 4.0);
}
