/* What lies in a point spread function beside its light is taken off; its shape. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/base.h"
#include "filter/psf.h"
#include "image/correct.h"
#include "image/statistics.h"

/* Light is what rises above the background by GATE deviations of the noise: a pixel, or the mean of those about it,
 * NARROW or WIDE a side, whose deviation is that of a pixel over the side. The wide mean finds the faint light of
 * diffusers, of which single pixels show nothing; each of its pixels counts FAINT deviations at most, for otherwise a
 * bright spot would make all that lies about it light. perf/results/real-captures.md. */
#define GATE  4.0
#define FAINT 1.0
enum { NARROW = 3, WIDE = 15 };
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
    const double part = 1.0 / psf->channels;
    hada_psf_dark seen_dark = {0};
    if (options->psf_dark != 0.0)
        seen_dark = hada_psf_find_dark(pixels, rows, cols, room);
    const double gate = options->psf_gate == HADA_AUTO ? GATE : options->psf_gate, noise = seen_dark.noise;
    const int finds = options->psf_dark == HADA_AUTO;
    const double uneven = finds && gate > 0.0 ? hada_psf_take_uneven(pixels, rows, cols, noise, room) : 0.0;
    const double dark = finds ? hada_psf_background(pixels, count, gate > 0.0 ? noise : 0.0, room) : options->psf_dark;
    const double lifted = finds && gate > 0.0 ? fmin(seen_dark.lifted, fmax(dark - seen_dark.lowest, 0.0)) : 0.0;
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
        const double value = is_light ? fmax(above + lifted, 0.0) : 0.0;
        if (!row || !col || row == rows - 1 || col == cols - 1)
            border += value;
        light += value;
        most = fmax(most, value);
        seen->dark += value != 0.0 ? 0.0 : part / (double)count;
        pixels[i] = (float)(value * (options->psf_taper > 0
                                         ? fade(row, rows, options->psf_taper) * fade(col, cols, options->psf_taper)
                                         : 1.0));
    }
    seen->background += part * (dark - lifted);
    seen->uneven += part * uneven;
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

/* The light above the median, of what is more than noise. */
static double light_of(const hada_image *psf, float *room)
{
    const size_t count = hada_image_count(psf);
    hada_pixels pixels = {.size = sizeof pixels, .full_scale = HADA_AUTO};
    double light = 0.0;
    hada_pixels_of_image(&pixels, psf);
    memcpy(room, psf->data, count * sizeof *room);
    const double dark =
        hada_select_rank(room, count, count / 2) + GATE * hada_noise_estimate(&pixels, HADA_MOSAIC_NONE);
    for (size_t i = 0; i < count; i++)
        light += fmax(psf->data[i] - dark, 0.0);
    return light;
}

/* Hot pixels become as their neighbours. Without them this share of the light must be left: else it is spots of single
 * pixels. */
#define LEFT 0.3

static hada_status repair_hot(hada_image *psf, size_t *hot, hada_error *err)
{
    hada_pixels pixels = {.size = sizeof pixels, .full_scale = HADA_AUTO};
    hada_image repaired = {0};
    size_t *list = NULL;
    float *room = NULL;
    hada_status status = HADA_OK;
    hada_pixels_of_image(&pixels, psf);
    HADA_TRY_OR_DONE(hada_bad_pixels_find(&pixels, HADA_MOSAIC_NONE, 1, &list, hot, err));
    if (!*hot)
        goto done;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(room, hada_image_count(psf), "a point spread function", err));
    HADA_TRY_OR_DONE(hada_image_copy(&repaired, psf, err));
    for (size_t i = 0; i < *hot; i++)
        repaired.data[list[i]] = NAN;
    HADA_TRY_OR_DONE(hada_frame_repair(&repaired, HADA_MOSAIC_NONE, hot, err));
    if (light_of(&repaired, room) < LEFT * light_of(psf, room))
        *hot = 0;
    else
        memcpy(psf->data, repaired.data, hada_image_count(psf) * sizeof *psf->data);
done:
    hada_image_destroy(&repaired);
    HADA_FREE(list, room);
    return status;
}

hada_status hada_psf_clean(hada_image *psf, const hada_psf_options *options, hada_psf_seen *seen, hada_error *err)
{
    const size_t pixels = (size_t)psf->rows * (size_t)psf->cols;
    hada_psf_seen own = {0};
    double light = 0.0;
    float *room = NULL;
    seen = seen ? seen : &own;
    *seen = (hada_psf_seen){0};
    if (options->psf_dark != 0.0) {
        HADA_TRY(repair_hot(psf, &seen->hot, err));
        HADA_TRY(HADA_NEW_RAW(room, 2 * pixels + (size_t)(psf->rows + psf->cols), "a point spread function", err));
    }
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

/* How many of n lines are left when half a per cent of the light is left out at either end; *middle: of the light, from
 * the axis. */
static int between(const double *light, int n, double *middle)
{
    double all = 0.0, sum = 0.0;
    int count = 0;
    for (int i = 0; i < n; i++) {
        all += light[i];
        *middle += light[i] * (i - n / 2);
    }
    *middle /= all;
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
    out->rows = between(light, psf->rows, &out->row);
    out->cols = between(light + psf->rows, psf->cols, &out->col);
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
