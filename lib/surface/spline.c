#include "surface/spline.h"

#include <math.h>
#include <stddef.h>

#define TWO_PI 6.283185307179586476925286766559

double hada_spline_gain(int k, int n)
{
    const double omega = TWO_PI * k / n;
    return (66.0 + 52.0 * cos(omega) + 2.0 * cos(2.0 * omega)) / 120.0;
}

/* The B-spline of degree 5 at 2 + t, at 1 + t and at t, 0 <= t <= 1, times 120. */
static double b_far(double t)
{
    const double left = 1.0 - t, square = left * left;
    return left * square * square;
}

static double b_next(double t)
{
    return 26.0 + t * (-50.0 + t * (20.0 + t * (20.0 + t * (-20.0 + 5.0 * t))));
}

static double b_near(double t)
{
    const double square = t * t;
    return 66.0 + square * (-60.0 + square * (30.0 - 10.0 * t));
}

void hada_spline_weights(double fraction, double weights[HADA_SPLINE_TAPS])
{
    const double left = 1.0 - fraction;
    weights[0] = b_far(fraction) / 120.0;
    weights[1] = b_next(fraction) / 120.0;
    weights[2] = b_near(fraction) / 120.0;
    weights[3] = b_near(left) / 120.0;
    weights[4] = b_next(left) / 120.0;
    weights[5] = b_far(left) / 120.0;
}

static int wrap(int i, int n)
{
    return i < 0 ? i + n : i >= n ? i - n : i;
}

static int outside(double x, int n)
{
    return !(x >= -(n / 2) && x <= n / 2);
}

void hada_spline_axis(int n, double scale, double offset, double factor, int *base, float *weights)
{
    for (int i = 0; i < n; i++) {
        const double at = ((i < (n + 1) / 2 ? i : i - n) - offset) / scale, low = floor(at);
        double taps[HADA_SPLINE_TAPS] = {0};
        base[i] = 0;
        if (!outside(at, n)) {
            hada_spline_weights(at - low, taps);
            base[i] = wrap(wrap((int)low - 2, n), n);
        }
        for (int k = 0; k < HADA_SPLINE_TAPS; k++)
            weights[(size_t)k * (size_t)n + (size_t)i] = (float)(factor * taps[k]);
    }
}

double hada_spline_value(const float *coefficients, int rows, int cols, double y, double x)
{
    const double row = floor(y), col = floor(x);
    double down[HADA_SPLINE_TAPS], along[HADA_SPLINE_TAPS], sum = 0.0;
    int at[HADA_SPLINE_TAPS];
    if (outside(y, rows) || outside(x, cols))
        return 0.0;
    hada_spline_weights(y - row, down);
    hada_spline_weights(x - col, along);
    for (int k = 0; k < HADA_SPLINE_TAPS; k++)
        at[k] = wrap(wrap((int)col - 2 + k, cols), cols);
    for (int k = 0; k < HADA_SPLINE_TAPS; k++) {
        const float *line = coefficients + (size_t)wrap(wrap((int)row - 2 + k, rows), rows) * (size_t)cols;
        double value = 0.0;
        for (int j = 0; j < HADA_SPLINE_TAPS; j++)
            value += along[j] * line[at[j]];
        sum += down[k] * value;
    }
    return sum;
}
