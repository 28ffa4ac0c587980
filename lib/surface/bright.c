#include "surface/bright.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"

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
    HADA_TRY_OR_DONE(
        hada_allocated(image = hada_alloc_raw(width * height, sizeof *image, "the optics between depths", err)));
    HADA_TRY_OR_DONE(hada_allocated(line = hada_alloc_raw(height, sizeof *line, "the optics between depths", err)));
    for (size_t y = 0; y < height; y++)
        line_values(coefficients + y * width, cols, 1, image + y * width);
    for (size_t x = 0; x < width; x++) {
        line_values(image + x, rows, width, line);
        for (size_t y = 0; y < height; y++)
            image[y * width + x] = line[y];
    }
done:
    free(line);
    if (status) {
        free(image);
        image = NULL;
    }
    *out = image;
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
    HADA_TRY_OR_DONE(hada_allocated(ring = hada_alloc(rings, sizeof *ring, "the optics between depths", err)));
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
    free(image);
    free(ring);
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
    double square = 0.0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(
        hada_allocated(out->point = hada_alloc(POINTS, sizeof *out->point, "the optics between depths", err)));
    HADA_TRY_OR_DONE(values(coefficients, rows, cols, &image, err));
    choose(out, image, rows, cols, edge, ABOVE_NOISE * sqrt(noise_of(image, (size_t)rows * (size_t)cols)));
    if (out->count < FEWEST)
        choose(out, image, rows, cols, edge, 0.0);
    for (int i = 0; i < out->count; i++)
        square += out->point[i].value * out->point[i].value;
    out->norm = sqrt(square);
done:
    free(image);
    return status;
}
