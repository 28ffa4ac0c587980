/* The bounds that several groups share: tests/stress/bounds.md derives them. */
#include "core/fft_factor.h"
#include "stress.h"

/* Mean square of the relative error of a one-dimensional transform, in units of u^2. */
static double variance(int n)
{
    hada_fft_stages stages;
    double sum = 0.0;
    hada_fft_factor(n, 0, &stages);
    for (int i = 0; i < stages.count; i++) {
        const int radix = stages.radix[i];
        sum += radix <= 8 ? 0.41 * log2(radix) : (radix - 1) / 22.0 + 1.0;
    }
    return stages.chirp ? 2.0 * sum + 1.35 : sum;
}

/* The largest possible relative error of a one-dimensional transform to first order, in units of u. */
static double worst(int n)
{
    hada_fft_stages stages;
    double sum = 0.0;
    hada_fft_factor(n, 0, &stages);
    for (int i = 0; i < stages.count; i++) {
        const int radix = stages.radix[i];
        sum += radix <= 8 ? 6.7 * log2(radix) : 1.42 * (radix + 6);
    }
    return stages.chirp ? 2.0 * sum + 20.0 : sum;
}

double stress_fft_worst(int rows, int cols)
{
    return STRESS_U * (worst(rows) + worst(cols) + 4.0);
}

double stress_fft_bound(int rows, int cols)
{
    /* few values have no statistics */
    if ((double)rows * cols < 256.0)
        return stress_fft_worst(rows, cols);
    return STRESS_U * (1.5 * sqrt(variance(rows) + variance(cols)) + 1.0);
}

double stress_fft_underflow(const stress_device *device, int rows, int cols)
{
    return 4.0 * (device->denormals ? 0x1p-150 : 0x1p-126) * sqrt((double)rows * cols);
}

double stress_sum_bound(double n)
{
    return STRESS_U * (2.0 * sqrt(n) + 1.0);
}
