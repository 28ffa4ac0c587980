#include "image/correct.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/base.h"
#include "core/numbers.h"
#include "image/statistics.h"

/* Of finite values, one at least, whose order changes. */
static float median(float *values, size_t count)
{
    const float upper = hada_select_rank(values, count, count / 2);
    return count % 2 ? upper : 0.5f * (hada_select_rank(values, count, count / 2 - 1) + upper);
}

static float neighbours_median(const float *plane, int rows, int cols, int row, int col)
{
    enum { REACH = 7 };
    float found[(2 * REACH + 1) * (2 * REACH + 1)];
    for (int reach = 1; reach <= REACH; reach++) {
        size_t n = 0;
        for (int r = row - reach; r <= row + reach; r++)
            for (int c = col - reach; c <= col + reach; c++)
                if (r >= 0 && r < rows && c >= 0 && c < cols && isfinite(plane[(size_t)r * (size_t)cols + (size_t)c]))
                    found[n++] = plane[(size_t)r * (size_t)cols + (size_t)c];
        if (n)
            return median(found, n);
    }
    return NAN;
}

static hada_status plane_median(const float *plane, size_t count, float *out, hada_error *err)
{
    float *finite = NULL;
    size_t n = 0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(finite, count, "repairing a frame", err));
    for (size_t i = 0; i < count; i++)
        if (isfinite(plane[i]))
            finite[n++] = plane[i];
    if (!n)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_NOT_FINITE,
                                   "a channel of the frame holds no finite pixel of weight above 0: nothing is left to "
                                   "repair it from"));
    *out = median(finite, n);
done:
    free(finite);
    return status;
}

static hada_status repair_plane(const float *before, float *after, int rows, int cols, hada_error *err)
{
    const size_t pixels = (size_t)rows * (size_t)cols;
    float whole = NAN; /* the plane's median, found when first needed */
    for (size_t i = 0; i < pixels; i++) {
        if (isfinite(before[i]))
            continue;
        const float value = neighbours_median(before, rows, cols, (int)(i / (size_t)cols), (int)(i % (size_t)cols));
        if (isnan(value) && isnan(whole))
            HADA_TRY(plane_median(before, pixels, &whole, err));
        after[i] = isnan(value) ? whole : value;
    }
    return HADA_OK;
}

/* Of every second pixel of every second row, from (row, col) on. */
static hada_status repair_quarter(hada_image *frame, int row, int col, hada_error *err)
{
    const int rows = (frame->rows + 1 - row) / 2, cols = (frame->cols + 1 - col) / 2;
    hada_image quarter = {0}, before = {0};
    hada_status status = HADA_OK;
    if (rows < 1 || cols < 1)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_image_create(&quarter, 1, rows, cols, err));
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < cols; c++)
            quarter.data[(size_t)r * (size_t)cols + (size_t)c] =
                frame->data[(size_t)(2 * r + row) * (size_t)frame->cols + (size_t)(2 * c + col)];
    HADA_TRY_OR_DONE(hada_image_copy(&before, &quarter, err));
    HADA_TRY_OR_DONE(repair_plane(before.data, quarter.data, rows, cols, err));
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < cols; c++)
            frame->data[(size_t)(2 * r + row) * (size_t)frame->cols + (size_t)(2 * c + col)] =
                quarter.data[(size_t)r * (size_t)cols + (size_t)c];
done:
    hada_image_destroy(&before);
    hada_image_destroy(&quarter);
    return status;
}

hada_status hada_frame_repair(hada_image *frame, hada_mosaic mosaic, size_t *repaired, hada_error *err)
{
    const size_t pixels = (size_t)frame->rows * (size_t)frame->cols;
    hada_image before = {0};
    hada_status status = HADA_OK;
    *repaired = hada_image_count_not_finite(frame);
    if (!*repaired)
        return HADA_OK;
    if (mosaic != HADA_MOSAIC_NONE) {
        for (int i = 0; i < 4; i++)
            HADA_TRY(repair_quarter(frame, i / 2, i % 2, err));
        return HADA_OK;
    }
    HADA_TRY_OR_DONE(hada_image_copy(&before, frame, err));
    for (size_t at = 0; at < pixels * (size_t)frame->channels; at += pixels)
        HADA_TRY_OR_DONE(repair_plane(before.data + at, frame->data + at, frame->rows, frame->cols, err));
done:
    hada_image_destroy(&before);
    return status;
}

hada_status hada_dark_of_sensor(hada_image *out, const hada_image *dark, int channels, hada_mosaic mosaic,
                                hada_error *err)
{
    const size_t broken = hada_image_count_not_finite(dark);
    if (broken)
        return hada_fail(err, HADA_ERROR_NOT_FINITE, "the dark frame holds %zu values that are not finite", broken);
    if (dark->channels != 1 || mosaic == HADA_MOSAIC_NONE)
        return hada_image_repeat(out, dark, channels ? channels : dark->channels, err);
    if (dark->rows < 2 || dark->cols < 2)
        return hada_fail(err, HADA_ERROR_SIZE, "a colour filter mosaic has at least 2 x 2 pixels");
    return hada_mosaic_colours(mosaic, dark, out, err);
}

/* A pixel that sees less than this share of what others see: its noise would be made 20 times as strong. */
#define HARDLY_LIT 0.05

/* Divides the values that stand for one colour by their mean, those that `mosaic` says hold it. */
static hada_status by_mean(float *plane, int rows, int cols, int channel, hada_mosaic mosaic, hada_error *err)
{
    const size_t pixels = (size_t)rows * (size_t)cols;
    double sum = 0.0;
    size_t count = 0;
    for (size_t i = 0; i < pixels; i++)
        if (isfinite(plane[i]) &&
            (mosaic == HADA_MOSAIC_NONE ||
             hada_mosaic_channel(mosaic, (int)(i / (size_t)cols), (int)(i % (size_t)cols)) == channel)) {
            sum += plane[i];
            count++;
        }
    const double mean = count ? sum / (double)count : 0.0;
    if (!(mean > 0.0))
        return hada_fail(
            err, HADA_ERROR_NUMERIC,
            "the flat frame holds no light above its dark level: a frame of an evenly lit sensor is needed");
    for (size_t i = 0; i < pixels; i++)
        plane[i] = plane[i] > HARDLY_LIT * mean && isfinite(plane[i]) ? (float)(plane[i] / mean) : 0.0f;
    return HADA_OK;
}

hada_status hada_flat_sensitivity(hada_image *out, const hada_image *flat, int channels, hada_mosaic mosaic,
                                  hada_error *err)
{
    const size_t pixels = (size_t)flat->rows * (size_t)flat->cols, count = hada_image_count(flat);
    const int filled = flat->channels == 1 && mosaic != HADA_MOSAIC_NONE;
    if (flat->channels != channels && flat->channels != 1)
        return hada_fail(err, HADA_ERROR_SIZE, "the flat frame has %d channels, and 1 or %d are needed", flat->channels,
                         channels);
    HADA_TRY(hada_image_create(out, channels, flat->rows, flat->cols, err));
    if (filled)
        hada_mosaic_fill(mosaic, flat->data, flat->rows, flat->cols, out->data);
    for (size_t i = 0; i < hada_image_count(out) && !filled; i++)
        out->data[i] = flat->data[i % count];
    for (int c = 0; c < channels; c++)
        HADA_TRY(by_mean(out->data + (size_t)c * pixels, flat->rows, flat->cols, c, filled ? mosaic : HADA_MOSAIC_NONE,
                         err));
    return HADA_OK;
}

/* Where value i of a frame has its own in a flat or dark frame; *channel: of the value. */
static size_t place_of(const hada_image *frame, hada_mosaic mosaic, const hada_image *sensor, size_t i, int *channel)
{
    const size_t pixels = (size_t)frame->rows * (size_t)frame->cols, cols = (size_t)frame->cols;
    *channel =
        mosaic == HADA_MOSAIC_NONE ? (int)(i / pixels) : hada_mosaic_channel(mosaic, (int)(i / cols), (int)(i % cols));
    return i % pixels + (sensor->channels == 1 ? 0 : (size_t)*channel * pixels);
}

void hada_flat_apply(hada_image *frame, hada_mosaic mosaic, const hada_image *sensitivity, const double *levels,
                     const float *dark_frame)
{
    const size_t pixels = (size_t)frame->rows * (size_t)frame->cols;
    for (size_t i = 0; i < hada_image_count(frame); i++) {
        int channel;
        const size_t at = place_of(frame, mosaic, sensitivity, i, &channel);
        const double dark = levels[channel] + (dark_frame ? dark_frame[(size_t)channel * pixels + i % pixels] : 0.0f);
        frame->data[i] = hada_flat_value(frame->data[i], sensitivity->data[at], dark);
    }
}

int hada_dark_fits(const hada_image *dark, const hada_image *frame, hada_mosaic mosaic)
{
    const int colours = mosaic == HADA_MOSAIC_NONE ? frame->channels : HADA_MOSAIC_COLOURS;
    return dark && dark->data && dark->channels == colours && dark->rows == frame->rows && dark->cols == frame->cols;
}

void hada_dark_subtract(hada_image *frame, hada_mosaic mosaic, const hada_image *dark)
{
    int channel;
    for (size_t i = 0; i < hada_image_count(frame); i++)
        frame->data[i] -= dark->data[place_of(frame, mosaic, dark, i, &channel)];
}

hada_status hada_flat_repair(hada_image *frame, hada_mosaic mosaic, const hada_image *sensitivity, hada_error *err)
{
    int channel;
    size_t repaired;
    for (size_t i = 0; i < hada_image_count(frame); i++)
        if (sensitivity->data[place_of(frame, mosaic, sensitivity, i, &channel)] == 0.0f)
            frame->data[i] = NAN;
    return hada_frame_repair(frame, mosaic, &repaired, err);
}

hada_status hada_flat_correct(hada_image *frame, hada_mosaic mosaic, const hada_image *sensitivity, double dark,
                              hada_error *err)
{
    const int colours = mosaic == HADA_MOSAIC_NONE ? frame->channels : HADA_MOSAIC_COLOURS;
    double *levels = NULL;
    hada_pixels pixels;
    hada_status status = HADA_OK;
    if (frame->rows != sensitivity->rows || frame->cols != sensitivity->cols ||
        (sensitivity->channels != 1 && sensitivity->channels != colours))
        return hada_fail(
            err, HADA_ERROR_SIZE, "the frame has %d channel(s) of %d x %d pixels, and the flat frame %d of %d x %d",
            frame->channels, frame->rows, frame->cols, sensitivity->channels, sensitivity->rows, sensitivity->cols);
    if (hada_image_count_not_finite(frame))
        return HADA_OK;
    hada_pixels_of_image(&pixels, frame);
    HADA_TRY_OR_DONE(HADA_NEW(levels, (size_t)colours, "the dark level", err));
    for (int c = 0; c < colours; c++)
        levels[c] = dark;
    if (dark == HADA_AUTO)
        HADA_TRY_OR_DONE(hada_dark_levels(&pixels, mosaic, levels, err));
    hada_flat_apply(frame, mosaic, sensitivity, levels, NULL);
    HADA_TRY_OR_DONE(hada_flat_repair(frame, mosaic, sensitivity, err));
done:
    free(levels);
    return status;
}

double hada_smooth_at(const double *weight, int row, int col, int rows, int cols)
{
    const double y = hada_smooth_place(row + 0.5, rows), x = hada_smooth_place(col + 0.5, cols);
    double sum = 0.0;
    for (int k = 0; k < HADA_SMOOTH_TERMS; k++)
        sum += weight[k] * hada_smooth_term(k, y, x);
    return sum;
}

void hada_smooth_add(const double *weight, double times, hada_image *image)
{
    float *to = image->data;
    for (int c = 0; c < image->channels; c++, weight += HADA_SMOOTH_TERMS)
        for (int row = 0; row < image->rows; row++)
            for (int col = 0; col < image->cols; col++, to++)
                *to = (float)((double)*to + times * hada_smooth_at(weight, row, col, image->rows, image->cols));
}

double hada_smooth_nearest(const float *channel, const float *known, int rows, int cols, double *weight)
{
    enum { TERMS = HADA_SMOOTH_TERMS };
    double normal[TERMS * TERMS] = {0.0}, right[TERMS] = {0.0}, term[TERMS], energy = 0.0;
    for (int i = 0; i < rows * cols; i++) {
        const double y = hada_smooth_place(i / cols + 0.5, rows), x = hada_smooth_place(i % cols + 0.5, cols);
        for (int k = 0; k < TERMS && (!known || known[i] != 0.0f); k++) {
            term[k] = hada_smooth_term(k, y, x);
            right[k] += term[k] * (double)channel[i];
            for (int n = 0; n <= k; n++)
                normal[k * TERMS + n] += term[k] * term[n];
        }
    }
    memcpy(weight, right, sizeof right);
    if (!hada_cholesky_factor(normal, TERMS)) {
        memset(weight, 0, sizeof right);
        return 0.0;
    }
    hada_cholesky_solve(normal, TERMS, weight);
    for (int k = 0; k < TERMS; k++)
        energy += right[k] * weight[k];
    return energy;
}
