#include "ref/ref_focus.h"

#include <math.h>
#include <stdlib.h>

#include "core/base.h"

#define REACH 60 /* pixels: the radius of the widest window */

typedef struct scene {
    const float *planes;
    int channels, rows, cols, depths;
} scene;

static int clamp(int i, int n)
{
    return i < 0 ? 0 : i >= n ? n - 1 : i;
}

/* Luminance of a plane, edges repeated. */
static double light(const scene *s, int depth, int row, int col)
{
    static const double weight[3] = {0.2126, 0.7152, 0.0722};
    const size_t pixels = (size_t)s->rows * (size_t)s->cols;
    const float *at = s->planes + (size_t)depth * (size_t)s->channels * pixels +
                      (size_t)clamp(row, s->rows) * (size_t)s->cols + (size_t)clamp(col, s->cols);
    double sum = 0.0;
    for (int c = 0; c < s->channels; c++)
        sum += (s->channels == 3 ? weight[c] : 1.0) * at[(size_t)c * pixels];
    return sum;
}

static double response(const scene *s, int depth, hada_focus_measure measure, int row, int col)
{
    if (measure == HADA_FOCUS_ENERGY)
        return fmax(light(s, depth, row, col), 0.0);
    double across = 0.0, along = 0.0;
    for (int i = -1; i <= 1; i++) {
        across += (2 - abs(i)) * (light(s, depth, row + i, col + 1) - light(s, depth, row + i, col - 1));
        along += (2 - abs(i)) * (light(s, depth, row + 1, col + i) - light(s, depth, row - 1, col + i));
    }
    return (across * across + along * along) / 64.0;
}

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, size_t count)
{
    qsort(values, count, sizeof *values, ascending);
    return count ? values[(count - 1) / 2] : 0.0;
}

/* Windowed response (contrast or energy) of every depth; multiply: its root is multiplied into `out`. The image goes on
 * beyond its edges with its edge pixels, for the edge filter and for the window. `work` holds rows x (cols + 2 radius).
 */
static void window_all(const scene *s, const hada_focus_options *options, hada_focus_measure kind, int multiply,
                       double *work, double *out)
{
    const int radius = (int)ceil(3.0 * options->window_sigma), wide = s->cols + 2 * radius;
    const double unit = -0.5 / (options->window_sigma * options->window_sigma);
    double norm = 0.0;
    for (int k = -radius; k <= radius; k++)
        norm += exp(unit * k * k);
    for (int d = 0; d < s->depths; d++) {
        for (int r = 0; r < s->rows; r++)
            for (int c = 0; c < wide; c++) {
                double sum = 0.0;
                for (int k = -radius; k <= radius; k++)
                    sum += exp(unit * k * k) / norm * response(s, d, kind, r + k, c - radius);
                work[(size_t)r * (size_t)wide + (size_t)c] = sum;
            }
        for (int r = 0; r < s->rows; r++)
            for (int c = 0; c < s->cols; c++) {
                double sum = 0.0, *to = out + ((size_t)d * (size_t)s->rows + (size_t)r) * (size_t)s->cols + c;
                for (int k = 0; k <= 2 * radius; k++)
                    sum += exp(unit * (k - radius) * (k - radius)) / norm *
                           work[(size_t)r * (size_t)wide + (size_t)(c + k)];
                *to = multiply ? *to * sqrt(sum) : sum;
            }
    }
}

static void measure_all(const scene *s, const hada_focus_options *options, double *work, double *out)
{
    const int combined = options->measure == HADA_FOCUS_COMBINED;
    window_all(s, options, combined ? HADA_FOCUS_ENERGY : options->measure, 0, work, out);
    if (combined)
        window_all(s, options, HADA_FOCUS_CONTRAST, 1, work, out);
}

static double noise_level(const scene *s, const unsigned char *competing, double *work)
{
    static const double operator[3][3] = {{1, -2, 1}, {-2, 4, -2}, {1, -2, 1}};
    size_t count = 0;
    for (int d = 0; d < s->depths; d++)
        for (int r = 1; r < s->rows - 1 && (!competing || competing[d]); r++)
            for (int c = 1; c < s->cols - 1; c++) {
                double sum = 0.0;
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++)
                        sum += operator[i][j] * light(s, d, r + i - 1, c + j - 1);
                if (fabs(sum) > 1e-12)
                    work[count++] = fabs(sum);
            }
    return median(work, count) / (6.0 * 0.67448975);
}

/* Mean and standard deviation of the windowed measure of unit white noise, summed directly over pairs of responses. */
static void noise_moments(const hada_focus_options *options, double *mean, double *deviation)
{
    const int radius = (int)ceil(3.0 * options->window_sigma), size = 2 * radius + 1;
    const double unit = -0.5 / (options->window_sigma * options->window_sigma), pi = acos(-1.0);
    double norm = 0.0, squares = 0.0, lagged[3] = {0};
    for (int k = -radius; k <= radius; k++)
        norm += exp(unit * k * k);
    for (int lag = 0; lag < 3; lag++)
        for (int k = 0; k + lag < size; k++)
            lagged[lag] +=
                exp(unit * ((k - radius) * (k - radius) + (k + lag - radius) * (k + lag - radius))) / norm / norm;
    squares = lagged[0] * lagged[0];
    const double energy = 1.0 / sqrt(2.0 * pi), spread = sqrt((0.5 - 0.5 / pi) * squares);
    if (options->measure == HADA_FOCUS_ENERGY) {
        *mean = energy;
        *deviation = spread;
        return;
    }
    /* correlations of the Sobel responses: outer products of those of (1 2 1)/4 and (-1 0 1)/2 */
    static const double smooth[3] = {6.0 / 16, 4.0 / 16, 1.0 / 16}, difference[3] = {2.0 / 4, 0, -1.0 / 4},
                        mixed[3] = {0, 2.0 / 8, 1.0 / 8}; /* odd in the lag */
    double variance = 0.0;
    for (int r = -2; r <= 2; r++)
        for (int c = -2; c <= 2; c++) {
            const double xx = smooth[abs(r)] * difference[abs(c)], yy = difference[abs(r)] * smooth[abs(c)],
                         xy = mixed[abs(r)] * mixed[abs(c)];
            variance += lagged[abs(r)] * lagged[abs(c)] * 2.0 * (xx * xx + yy * yy + 2.0 * xy * xy);
        }
    *mean = 2.0 * smooth[0] * difference[0];
    *deviation = sqrt(variance);
    if (options->measure == HADA_FOCUS_COMBINED) { /* E sqrt(C), errors carried to first order */
        const double root = sqrt(*mean), change = energy / (2.0 * root) * *deviation;
        *deviation = sqrt(root * spread * root * spread + change * change);
        *mean = energy * root;
    }
}

/* z with P(normal > z) = p, by Newton's method. */
static double quantile(double p)
{
    double z = 0.0;
    for (int i = 0; i < 60; i++)
        z += (0.5 * erfc(z / sqrt(2.0)) - p) / (exp(-0.5 * z * z) / sqrt(2.0 * acos(-1.0)));
    return z;
}

static int best_depth(const double *measure, size_t pixels, size_t i, int depths, const unsigned char *competing)
{
    int best = -1;
    for (int d = 0; d < depths; d++)
        if ((!competing || competing[d]) &&
            (best < 0 || measure[(size_t)d * pixels + i] > measure[(size_t)best * pixels + i]))
            best = d;
    return best;
}

typedef struct limits {
    double base, threshold, margin;
} limits;

static limits find_limits(const double *measure, size_t pixels, int depths, const unsigned char *competing,
                          const hada_focus_options *options, double noise, double *losers)
{
    size_t count = 0;
    for (size_t i = 0; i < pixels; i++) {
        const int best = best_depth(measure, pixels, i, depths, competing);
        for (int d = 0; d < depths; d++)
            if (d != best && (!competing || competing[d]))
                losers[count++] = measure[(size_t)d * pixels + i];
    }
    const double base = median(losers, count),
                 z = quantile(options->false_alarm / (1.0 + (double)count / (double)pixels));
    for (size_t i = 0; i < count; i++)
        losers[i] = fabs(losers[i] - base);
    const double spread = 1.4826 * median(losers, count);
    double mean, deviation;
    noise_moments(options, &mean, &deviation);
    const double unit = options->measure == HADA_FOCUS_ENERGY ? noise : noise * noise;
    return (limits){base, fmax(base + z * spread, unit * (mean + z * deviation)), z * spread};
}

static void finish_pixel(const double *measure, size_t pixels, size_t i, int depths, const double *distances,
                         const unsigned char *competing, const limits *limit, double *distance, double *lead)
{
    const int best = best_depth(measure, pixels, i, depths, competing);
    double side[2] = {0.0, 0.0}, other = 0.0;
    const double peak = measure[(size_t)best * pixels + i];
    for (int d = 0; d < depths; d++) {
        const double value = measure[(size_t)d * pixels + i];
        if (competing && !competing[d])
            continue;
        if (abs(d - best) == 1)
            side[d > best] = value;
        else if (d != best)
            other = fmax(other, value);
    }
    const double above = peak - limit->base, left = fmax(side[0] - limit->base, 0.0),
                 right = fmax(side[1] - limit->base, 0.0), bend = 2.0 * above - left - right;
    double step = 0.0;
    if (best > 0 && best < depths - 1 && bend > 0.0)
        step = fmin(fmax(0.5 * (right - left) / bend, -0.5), 0.5);
    const int beside = step < 0.0 ? best - 1 : step > 0.0 ? best + 1 : best;
    const double inverse = (1.0 - fabs(step)) / distances[best] + fabs(step) / distances[beside];
    *lead = fmin(peak - limit->threshold, peak - other - limit->margin) / (peak > 0.0 ? peak : 1.0);
    *distance = *lead > 0.0 ? 1.0 / inverse : NAN;
}

hada_status hada_ref_focus(const float *planes, int channels, int rows, int cols, int depths,
                           const double *distances_mm, const unsigned char *competing,
                           const hada_focus_options *options, double *all_in_focus, double *distance, double *lead,
                           hada_focus_report *report, hada_error *err)
{
    const scene s = {planes, channels, rows, cols, depths};
    const size_t pixels = (size_t)rows * (size_t)cols;
    void *measure = NULL, *work = NULL;
    hada_status status;
    if ((status =
             hada_allocated(measure = hada_alloc(pixels * (size_t)depths, sizeof(double), "the reference", err))) ||
        (status = hada_allocated(work = hada_alloc((size_t)rows * ((size_t)cols * (size_t)depths + 2 * REACH),
                                                   sizeof(double), "the reference", err))))
        goto done;
    const double *m = measure;
    measure_all(&s, options, work, measure);
    const double noise = noise_level(&s, competing, work);
    const limits limit = find_limits(m, pixels, depths, competing, options, noise, work);
    size_t covered = 0;
    for (size_t i = 0; i < pixels; i++) {
        double weights = 0.0, all = 0.0;
        finish_pixel(m, pixels, i, depths, distances_mm, competing, &limit, &distance[i], &lead[i]);
        covered += !isnan(distance[i]);
        for (int d = 0; d < depths; d++)
            if (!competing || competing[d]) {
                weights += m[(size_t)d * pixels + i];
                all += 1.0;
            }
        for (int c = 0; c < channels; c++) {
            double sum = 0.0, plain = 0.0;
            for (int d = 0; d < depths; d++) {
                const double value = planes[((size_t)d * (size_t)channels + (size_t)c) * pixels + i];
                if (competing && !competing[d])
                    continue;
                sum += m[(size_t)d * pixels + i] * value;
                plain += value;
            }
            all_in_focus[(size_t)c * pixels + i] = options->fuse == HADA_FOCUS_SUM ? plain
                                                   : weights > 0.0                 ? sum / weights
                                                                                   : plain / all;
        }
    }
    *report = (hada_focus_report){.size = sizeof *report,
                                  .noise = noise,
                                  .threshold = limit.threshold,
                                  .margin = limit.margin,
                                  .coverage = (double)covered / (double)pixels};
done:
    HADA_FREE(measure, work);
    return status;
}

double hada_ref_focus_dark(const double *all_in_focus, int channels, int rows, int cols, double light, double *distance)
{
    double nearest = INFINITY;
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < cols; c++) {
            double sum = 0.0;
            for (int k = 0; k < channels; k++)
                for (int i = -2; i <= 2; i++)
                    for (int j = -2; j <= 2; j++)
                        sum += all_in_focus[((size_t)k * (size_t)rows + (size_t)clamp(r + i, rows)) * (size_t)cols +
                                            (size_t)clamp(c + j, cols)];
            const double mean = sum / (25.0 * channels);
            nearest = fmin(nearest, fabs(mean / light - 1.0));
            if (!(mean > light))
                distance[(size_t)r * (size_t)cols + (size_t)c] = NAN;
        }
    return nearest;
}
