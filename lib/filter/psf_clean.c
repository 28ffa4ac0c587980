/* Background, noise and edges of point spread functions. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/base.h"
#include "filter/psf.h"
#include "image/statistics.h"

/* Light is what rises above the background by GATE deviations of the noise: a pixel, or the mean of those about it,
 * NARROW or WIDE a side, whose deviation is that of a pixel over the side. The wide mean finds the faint light of
 * diffusers, of which single pixels show nothing; each of its pixels counts FAINT deviations at most, for otherwise a
 * bright spot would make all that lies about it light. perf/results/real-captures.md. */
#define GATE  4.0
#define FAINT 1.0
enum { NARROW = 3, WIDE = 15 };
/* Blocks of 2 x 2 pixels are dark that are among this share of the darkest. */
#define DARK_SHARE 0.1
/* The median of the magnitude of a normal number of deviation 1. */
#define MEDIAN 0.6745
/* The first percentile is 2.3 deviations below the background where all pixels are dark, 1.3 where a tenth is. From
 * between them, the mean of the pixels that are near leads to the background in a few steps; where no pixel is dark it
 * cannot lead far. */
#define PERCENTILE 1.8
#define NEAR       1.5
enum { NEAR_STEPS = 3 };

/* The noise of a channel's darkest blocks, by the median of their diagonal wavelet coefficients (statistics.h), which
 * know nothing of the blocks' means, by which they are chosen. `room`: three floats for each block. */
static double dark_noise(const float *pixels, int rows, int cols, float *room)
{
    const size_t count = (size_t)(rows / 2) * (size_t)(cols / 2);
    float *mean = room, *sorted = room + count, *diagonal = sorted + count;
    size_t dark = 0;
    if (!count)
        return 0.0;
    for (size_t i = 0; i < count; i++) {
        const size_t at = i / (size_t)(cols / 2) * 2 * (size_t)cols + i % (size_t)(cols / 2) * 2;
        const float *up = pixels + at, *down = up + cols;
        sorted[i] = mean[i] = up[0] + up[1] + down[0] + down[1];
        diagonal[i] = fabsf(up[0] - up[1] - down[0] + down[1]) * 0.5F;
    }
    const float most = hada_select_rank(sorted, count, (size_t)(DARK_SHARE * (double)(count - 1)));
    for (size_t i = 0; i < count; i++)
        if (mean[i] <= most)
            sorted[dark++] = diagonal[i];
    return hada_select_rank(sorted, dark, dark / 2) / MEDIAN;
}

static double background_of(const float *pixels, size_t count, double noise, float *room)
{
    double level = hada_first_percentile(pixels, count, room) + PERCENTILE * noise;
    for (int step = 0; noise > 0.0 && step < NEAR_STEPS; step++) {
        double sum = 0.0, near = 0.0;
        for (size_t i = 0; i < count; i++)
            if (fabs(pixels[i] - level) <= NEAR * noise) {
                sum += pixels[i];
                near += 1.0;
            }
        level = near > 0.0 ? sum / near : level;
    }
    return level;
}

/* Half a cosine over `width` pixels from either end. */
static double fade(int i, int n, int width)
{
    const int inside = i < n - 1 - i ? i : n - 1 - i;
    return inside < width ? 0.5 - 0.5 * cos(3.14159265358979323846 * (inside + 0.5) / width) : 1.0;
}

/* Sums of `width` values about each of n, `step` floats apart; zeros beyond. In place; `line`: n floats. */
static void sums_on_line(float *values, int n, size_t step, int width, float *line)
{
    const int half = width / 2;
    double sum = 0.0;
    for (int i = 0; i < n; i++)
        line[i] = values[(size_t)i * step];
    for (int i = -half; i < n; i++) {
        sum += i + half < n ? line[i + half] : 0.0F;
        if (i >= 0)
            values[(size_t)i * step] = (float)sum;
        sum -= i - half >= 0 ? line[i - half] : 0.0F;
    }
}

/* Those of width x width. */
static void sums_about(float *values, int rows, int cols, int width, float *line)
{
    for (int row = 0; row < rows; row++)
        sums_on_line(values + (size_t)row * (size_t)cols, cols, 1, width, line);
    for (int col = 0; col < cols; col++)
        sums_on_line(values + col, rows, (size_t)cols, width, line);
}

static double clean_channel(float *pixels, const hada_image *psf, const hada_psf_options *options, hada_psf_seen *seen,
                            float *room)
{
    const int rows = psf->rows, cols = psf->cols;
    const size_t count = (size_t)rows * (size_t)cols;
    const double part = 1.0 / psf->channels,
                 noise = options->psf_dark == 0.0 ? 0.0 : dark_noise(pixels, rows, cols, room);
    const double gate = options->psf_gate == HADA_AUTO ? GATE : options->psf_gate;
    const double dark = options->psf_dark == HADA_AUTO ? background_of(pixels, count, gate > 0.0 ? noise : 0.0, room)
                                                       : options->psf_dark;
    double border = 0.0, light = 0.0, most = 0.0;
    const double least = gate * noise;
    float *narrow = room, *wide = room + count;
    for (size_t i = 0; i < count && least > 0.0; i++) {
        narrow[i] = (float)(pixels[i] - dark);
        wide[i] = fminf(narrow[i], (float)(FAINT * noise));
    }
    if (least > 0.0) {
        sums_about(narrow, rows, cols, NARROW, room + 2 * count);
        sums_about(wide, rows, cols, WIDE, room + 2 * count);
    }
    for (size_t i = 0; i < count; i++) {
        const int row = (int)(i / (size_t)cols), col = (int)(i % (size_t)cols);
        const double above = pixels[i] - dark;
        const int is_light =
            least > 0.0 ? above > least || narrow[i] > NARROW * least || wide[i] > WIDE * least : above > 0.0;
        const double value = is_light ? fmax(above, 0.0) : 0.0;
        if (!row || !col || row == rows - 1 || col == cols - 1)
            border += value;
        light += value;
        most = fmax(most, value);
        seen->dark += value != 0.0 ? 0.0 : part / (double)count;
        pixels[i] = (float)(value * (options->psf_taper > 0
                                         ? fade(row, rows, options->psf_taper) * fade(col, cols, options->psf_taper)
                                         : 1.0));
    }
    seen->background += part * dark;
    seen->noise += part * noise;
    seen->peak += part * most;
    if (light > 0.0 && rows > 2 && cols > 2)
        seen->border += part * (border / (2.0 * (rows + cols) - 4.0)) / (light / (double)count);
    return light;
}

double hada_psf_light(const hada_image *psf)
{
    double total = 0.0;
    for (size_t i = 0; i < hada_image_count(psf); i++)
        total += psf->data[i];
    return total;
}

hada_status hada_psf_clean(hada_image *psf, const hada_psf_options *options, hada_psf_seen *seen, hada_error *err)
{
    const size_t pixels = (size_t)psf->rows * (size_t)psf->cols;
    hada_psf_seen own;
    double light = 0.0;
    float *room = NULL;
    if (options->psf_dark != 0.0)
        HADA_TRY(HADA_NEW_RAW(room, 2 * pixels + (size_t)(psf->rows + psf->cols), "a point spread function", err));
    seen = seen ? seen : &own;
    *seen = (hada_psf_seen){0};
    for (int c = 0; c < psf->channels; c++)
        light += clean_channel(psf->data + (size_t)c * pixels, psf, options, seen, room);
    free(room);
    return light > 0.0
               ? HADA_OK
               : hada_fail(err, HADA_ERROR_NUMERIC,
                           "nothing of the point spread function is brighter than its background (%.4g) and "
                           "noise (%.4g); check the file, or give its dark level (options.psf_dark) and a lower "
                           "gate (options.psf_gate)",
                           seen->background, seen->noise);
}

/* Lags that are farther than this part of a side say nothing of details. */
enum { FAR = 20 };

/* Where the autocorrelation along a direction, `step` values apart, has fallen half the way to what it is `far` lags
 * away, where the spread of the light as a whole is left of it. Lines run into each other at their ends, where there is
 * little light. */
static double half_lag(const float *values, size_t count, size_t step, size_t far)
{
    double before = hada_product(values, values, count);
    const double half = 0.5 * (before + hada_product(values, values + far * step, count - far * step));
    for (size_t lag = 1; lag < far; lag++) {
        const double now = hada_product(values, values + lag * step, count - lag * step);
        if (now < half)
            return (double)(lag - 1) + (before - half) / (before - now);
        before = now;
    }
    return (double)far;
}

/* How many of n lines are left when half a per cent of the light is left out at either end. */
static int between(const double *light, int n)
{
    double all = 0.0, sum = 0.0;
    int count = 0;
    for (int i = 0; i < n; i++)
        all += light[i];
    for (int i = 0; i < n; i++) {
        sum += light[i];
        count += sum > 0.005 * all && sum - light[i] < 0.995 * all;
    }
    return count;
}

hada_status hada_psf_measure(hada_psf_shape *out, const hada_image *psf, const hada_image *other, hada_error *err)
{
    const size_t all = hada_image_count(psf), cols = (size_t)psf->cols;
    double *light;
    *out = (hada_psf_shape){0};
    HADA_TRY(HADA_NEW(light, (size_t)psf->rows + cols, "the shape of a point spread function", err));
    for (size_t i = 0; i < all; i++) {
        light[i / cols % (size_t)psf->rows] += psf->data[i];
        light[(size_t)psf->rows + i % cols] += psf->data[i];
    }
    out->rows = between(light, psf->rows);
    out->cols = between(light + psf->rows, psf->cols);
    const size_t far = (size_t)(psf->rows < psf->cols ? psf->rows : psf->cols) / FAR;
    out->detail = half_lag(psf->data, all, 1, far) + half_lag(psf->data, all, cols, far);
    if (other)
        out->alike = hada_product(psf->data, other->data, all) /
                     sqrt(hada_product(psf->data, psf->data, all) * hada_product(other->data, other->data, all));
    free(light);
    return HADA_OK;
}

hada_status hada_psf_transpose(hada_image *psf, hada_error *err)
{
    const size_t rows = (size_t)psf->rows, cols = (size_t)psf->cols, area = rows * cols;
    hada_image turned = {0};
    HADA_TRY(hada_image_create(&turned, psf->channels, psf->cols, psf->rows, err));
    for (size_t i = 0; i < hada_image_count(psf); i++) {
        const size_t row = i % area / cols, col = i % cols;
        turned.data[i / area * area + col * rows + row] = psf->data[i];
    }
    hada_image_destroy(psf);
    *psf = turned;
    return HADA_OK;
}
