#include "surface/spline.h"

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

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

/* So many that noise averages out, and so few that a search over them takes well below a second. */
#define POINTS 2000
/* Pixels below so many standard deviations of the noise are left out, unless fewer than FEWEST remain. */
#define ABOVE_NOISE 3.0
#define FEWEST      500
/* Of the energy. */
#define EDGE_SHARE 0.9
/* Median of |x| of a normal distribution, in standard deviations. */
#define NORMAL_MEDIAN 0.6745

/* Counts of positive floats by exponent and four bits of the mantissa: in their order, 6 % apart. */
enum { BUCKETS = 1 << 12 };

static unsigned bucket_of(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits >> 19 & (BUCKETS - 1);
}

static int signed_of(int i, int n)
{
    return i < (n + 1) / 2 ? i : i - n;
}

/* A quintic spline's values at whole pixels. */
static void line_values(const float *in, int n, size_t step, float *out)
{
    static const float tap[3] = {66.0F / 120.0F, 26.0F / 120.0F, 1.0F / 120.0F};
    for (int i = 0; i < n; i++) {
        float sum = tap[0] * in[(size_t)i * step];
        for (int k = 1; k < 3; k++)
            sum += tap[k] * (in[(size_t)((i + k) % n) * step] + in[(size_t)((i + n - k) % n) * step]);
        out[i] = sum;
    }
}

static hada_status values(const float *coefficients, int rows, int cols, float **out, hada_error *err)
{
    const size_t width = (size_t)cols, height = (size_t)rows;
    float *image = NULL, *line = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(image, width * height, "the optics between depths", err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(line, height, "the optics between depths", err));
    for (size_t y = 0; y < height; y++)
        line_values(coefficients + y * width, cols, 1, image + y * width);
    for (size_t x = 0; x < width; x++) {
        line_values(image + x, rows, width, line);
        for (size_t y = 0; y < height; y++)
            image[y * width + x] = line[y];
    }
done:
    free(line);
    if (status)
        free(image);
    *out = status ? NULL : image;
    return status;
}

/* Variance of noise by the median, which light does not move as long as it covers less than half of the pixels. */
static double noise_of(const float *image, size_t pixels)
{
    size_t count[BUCKETS] = {0}, below = 0;
    unsigned i = 0;
    for (size_t p = 0; p < pixels; p++)
        count[bucket_of(fabsf(image[p]))]++;
    for (below = count[0]; below < pixels / 2; below += count[i])
        i++;
    const uint32_t bits = (uint32_t)i << 19;
    float median;
    memcpy(&median, &bits, sizeof median);
    return (double)median * median / (NORMAL_MEDIAN * NORMAL_MEDIAN);
}

static void add_rings(const float *image, int rows, int cols, double *ring)
{
    const size_t pixels = (size_t)rows * (size_t)cols;
    const double noise = noise_of(image, pixels);
    double energy = 0.0;
    for (size_t p = 0; p < pixels; p++)
        energy += (double)image[p] * image[p] - noise;
    if (!(energy > 0.0))
        return;
    for (size_t p = 0; p < pixels; p++) {
        const double y = signed_of((int)(p / (size_t)cols), rows), x = signed_of((int)(p % (size_t)cols), cols);
        ring[(size_t)sqrt(y * y + x * x)] += ((double)image[p] * image[p] - noise) / energy;
    }
}

hada_status hada_bright_edge(const float *coefficients, int depths, int rows, int cols, double *edge, double *spread,
                             hada_error *err)
{
    const size_t rings = (size_t)(rows + cols), area = (size_t)rows * (size_t)cols;
    double *ring = NULL, all = 0.0, sum = 0.0, square = 0.0;
    float *image = NULL;
    size_t r = 0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(ring, rings, "the optics between depths", err));
    for (size_t k = 0; k < (size_t)depths; k++) {
        HADA_TRY_OR_DONE(values(coefficients + k * area, rows, cols, &image, err));
        add_rings(image, rows, cols, ring);
        free(image);
        image = NULL;
    }
    for (size_t i = 0; i < rings; i++)
        all += ring[i];
    for (sum = ring[0]; sum < EDGE_SHARE * all && r + 1 < rings; sum += ring[r])
        r++;
    for (size_t i = 0; i <= r; i++)
        square += ring[i] * (double)(i * i);
    *edge = r > 1 ? (double)r : 1.0;
    *spread = sum > 0.0 && square > sum ? sqrt(square / sum) : 1.0;
done:
    HADA_FREE(image, ring);
    return status;
}

/* What a pixel tells of a magnification: its energy, and more of it farther out. */
static float weight_of(const float *image, size_t p, int rows, int cols, double edge, double above)
{
    const double y = signed_of((int)(p / (size_t)cols), rows), x = signed_of((int)(p % (size_t)cols), cols);
    const double value = image[p];
    return value > above ? (float)(value * value * (1.0 + (y * y + x * x) / (edge * edge))) : 0.0F;
}

static void choose(hada_bright *out, const float *image, int rows, int cols, double edge, double above)
{
    const size_t pixels = (size_t)rows * (size_t)cols;
    size_t count[BUCKETS] = {0}, more = 0;
    unsigned least = BUCKETS - 1;
    for (size_t p = 0; p < pixels; p++)
        count[bucket_of(weight_of(image, p, rows, cols, edge, above))]++;
    for (more = count[least]; least > 1 && more + count[least - 1] <= POINTS; more += count[least])
        least--;
    out->count = 0;
    for (size_t p = 0; p < pixels && out->count < POINTS; p++)
        if (bucket_of(weight_of(image, p, rows, cols, edge, above)) >= least)
            out->point[out->count++] = (hada_bright_point){signed_of((int)(p / (size_t)cols), rows),
                                                           signed_of((int)(p % (size_t)cols), cols), image[p]};
}

hada_status hada_bright_find(hada_bright *out, const float *coefficients, int rows, int cols, double edge,
                             hada_error *err)
{
    float *image = NULL;
    double square = 0.0, energy = 1e-300;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(out->point, POINTS, "the optics between depths", err));
    HADA_TRY_OR_DONE(values(coefficients, rows, cols, &image, err));
    choose(out, image, rows, cols, edge, ABOVE_NOISE * sqrt(noise_of(image, (size_t)rows * (size_t)cols)));
    if (out->count < FEWEST)
        choose(out, image, rows, cols, edge, 0.0);
    for (int i = 0; i < out->count; i++)
        square += out->point[i].value * out->point[i].value;
    out->norm = sqrt(square);
    for (int p = 0; p < rows * cols; p++) {
        const double here = (double)image[p] * image[p];
        energy += here;
        out->centre[0] += here * signed_of(p / cols, rows);
        out->centre[1] += here * signed_of(p % cols, cols);
    }
    out->centre[0] /= energy;
    out->centre[1] /= energy;
done:
    free(image);
    return status;
}
