/* A frame on the host: checked, repaired, its dark levels found, and which channels need no computing. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/clock.h"
#include "core/finite.h"
#include "engine/frame.h"
#include "filter/hadamard.h"
#include "image/statistics.h"

/* The square of a spectrum's largest value, `points` times the brightest pixel, stays a factor 4 below the largest
 * float, 2^128; the square of the least pixel, 2^-80, leaves 2^46 above the smallest normal one for filters and noise.
 */
static const double most_light = 0x1p63, least_light = 0x1p-40;

hada_status hada_frame_check_range(float largest, double points, hada_error *err)
{
    if ((largest > 0.0f && largest < least_light) || largest * points > most_light)
        return hada_fail(
            err, HADA_ERROR_NUMERIC,
            "the frame's brightest pixel, %.2g, is too %s for single precision (%.2g to %.2g at this size); "
            "multiply frames, and those that the model is fitted with, by a number that brings white to "
            "about 1",
            (double)largest, largest < 1.0f ? "small" : "large", least_light, most_light / points);
    return HADA_OK;
}

static int by_value(const void *a, const void *b)
{
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* The median of the finite values, NaN where there is none. The array is sorted. */
static float median(float *values, size_t count)
{
    if (!count)
        return NAN;
    qsort(values, count, sizeof *values, by_value);
    return count % 2 ? values[count / 2] : 0.5f * (values[count / 2 - 1] + values[count / 2]);
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
    HADA_TRY_OR_DONE(hada_allocated(finite = hada_alloc_raw(count, sizeof *finite, "repairing a frame", err)));
    for (size_t i = 0; i < count; i++)
        if (isfinite(plane[i]))
            finite[n++] = plane[i];
    *out = n ? median(finite, n) : 0.0f;
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

hada_status hada_frame_repair(hada_image *frame, size_t *repaired, hada_error *err)
{
    const size_t pixels = (size_t)frame->rows * (size_t)frame->cols;
    hada_image before = {0};
    hada_status status = HADA_OK;
    *repaired = hada_image_count_not_finite(frame);
    if (!*repaired)
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_image_create(&before, frame->channels, frame->rows, frame->cols, err));
    memcpy(before.data, frame->data, hada_image_count(frame) * sizeof(float));
    for (size_t at = 0; at < pixels * (size_t)frame->channels; at += pixels)
        HADA_TRY_OR_DONE(repair_plane(before.data + at, frame->data + at, frame->rows, frame->cols, err));
done:
    hada_image_destroy(&before);
    return status;
}

/* Whether nothing is left of a channel when the dark level and the dark frame are off: in float, as the device does
 * it. */
static int is_black(const hada_frame *frame, int channel)
{
    const hada_image *image = frame->staged, *dark = &frame->setup->dark_frame;
    const size_t pixels = (size_t)image->rows * (size_t)image->cols, at = (size_t)channel * pixels;
    const float *values = image->data + at, *background = dark->data ? dark->data + at : NULL;
    const float level = (float)frame->levels[channel];
    for (size_t i = 0; i < pixels; i++)
        if ((values[i] - level) - (background ? background[i] : 0.0f) != 0.0f)
            return 0;
    return 1;
}

static int is_same(const hada_frame *frame, int a, int b)
{
    const hada_image *image = frame->staged;
    const int *dark = frame->setup->same_dark;
    const size_t pixels = (size_t)image->rows * (size_t)image->cols;
    return frame->levels[a] == frame->levels[b] && dark[a] == dark[b] &&
           !memcmp(image->data + (size_t)a * pixels, image->data + (size_t)b * pixels, pixels * sizeof(float));
}

/* The first channels whose spectrum and whose planes are those of channel c. */
static void find_source(const hada_frame *frame, int c, int *spectrum, int *planes)
{
    const int joint = frame->setup->config.joint, *same_filter = frame->setup->same_filter;
    *spectrum = *planes = c;
    if (is_black(frame, c)) {
        *spectrum = HADA_CHANNEL_BLACK;
        *planes = joint ? c : HADA_CHANNEL_BLACK;
        return;
    }
    for (int before = c - 1; before >= 0; before--)
        if (is_same(frame, before, c)) {
            *spectrum = before;
            if (!joint && same_filter[before] == same_filter[c])
                *planes = before;
        }
}

static void skip_channels(hada_frame *frame)
{
    hada_frame_skip *skip = &frame->skip;
    skip->channels = 0;
    for (int c = 0; c < frame->staged->channels; c++) {
        skip->spectra[c] = skip->planes[c] = c;
        if (frame->setup->options.skip & HADA_SKIP_CHANNELS)
            find_source(frame, c, &skip->spectra[c], &skip->planes[c]);
        skip->channels += skip->planes[c] != c;
    }
}

static hada_status check_size(const hada_image *raw, const hada_model_info *info, hada_error *err)
{
    if (raw->channels == info->channels && raw->rows == info->raw_rows && raw->cols == info->raw_cols)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_MODEL,
                     "the frame has %d channel(s) of %d x %d pixels; the model %s is for %d channel(s) of %d x %d: use "
                     "the model of this camera, or make one with fit",
                     raw->channels, raw->rows, raw->cols, info->name, info->channels, info->raw_rows, info->raw_cols);
}

static void free_parts(hada_frame *frame)
{
    hada_image_destroy(&frame->repaired);
    free(frame->levels);
    free(frame->skip.spectra);
    free(frame->skip.planes);
    frame->levels = NULL;
    frame->skip = (hada_frame_skip){0};
}

hada_status hada_frame_begin(hada_frame *frame, const hada_setup *setup, const hada_image *raw, hada_result *result,
                             hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(setup->model);
    const hada_config *config = &setup->config;
    const size_t channels = (size_t)info->channels;
    hada_status status = HADA_OK;
    *frame = (hada_frame){.setup = setup, .raw = raw, .result = result};
    /* upload and pictures are a unit each */
    frame->work = 2 + (config->joint ? config->steps + (config->pursuit ? HADA_WORK_PURSUIT : 0) : config->depths);
    HADA_TRY_OR_DONE(check_size(raw, info, err));
    HADA_TRY_OR_DONE(hada_allocated(frame->levels = hada_alloc(channels, sizeof(double), "a frame", err)));
    HADA_TRY_OR_DONE(hada_allocated(frame->skip.spectra = hada_alloc(channels, sizeof(int), "a frame", err)));
    HADA_TRY_OR_DONE(hada_allocated(frame->skip.planes = hada_alloc(channels, sizeof(int), "a frame", err)));
done:
    if (status)
        free_parts(frame);
    return status;
}

void hada_frame_end(hada_frame *frame, hada_status status)
{
    if (status)
        hada_result_clear(frame->result);
    free_parts(frame);
}

void hada_frame_progress(hada_frame *frame, int done)
{
    const int now = (int)((double)done / frame->work * HADA_PROGRESS);
    int before = atomic_load(&frame->progress);
    while (now > before && !atomic_compare_exchange_weak(&frame->progress, &before, now))
        ;
}

hada_status hada_frame_check(hada_frame *frame, hada_error *err)
{
    return atomic_load(&frame->cancelled) ? hada_fail(err, HADA_ERROR_CANCELLED, "the job was cancelled") : HADA_OK;
}

/* A result used again keeps its memory. */
static hada_status prepare_result(hada_frame *frame, hada_error *err)
{
    const hada_setup *setup = frame->setup;
    const int depths = setup->config.depths;
    hada_result *result = frame->result;
    hada_status status = hada_result_fit(result, hada_model_get_info(setup->model), depths, err);
    if (status)
        return status;
    hada_result_renew(result);
    memcpy((double *)result->distances_mm, setup->distances, (size_t)depths * sizeof(double));
    return HADA_OK;
}

static hada_status repair(hada_frame *frame, size_t broken, hada_error *err)
{
    const hada_image *raw = frame->raw;
    if (!frame->setup->options.repair_not_finite)
        HADA_TRY(
            hada_fail(err, HADA_ERROR_NOT_FINITE,
                      "%zu pixel(s) of the frame are NaN or infinite; repair them from their neighbours with --repair, "
                      "or mend the file",
                      broken));
    if (!frame->repaired.data)
        HADA_TRY(hada_image_create(&frame->repaired, raw->channels, raw->rows, raw->cols, err));
    memcpy(frame->repaired.data, raw->data, hada_image_count(raw) * sizeof(float));
    HADA_TRY(hada_frame_repair(&frame->repaired, &frame->result->memory->report.repaired_pixels, err));
    frame->staged = &frame->repaired;
    return HADA_OK;
}

/* frame->staged: the frame as floats that are finite and in range. */
static hada_status stage(hada_frame *frame, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(frame->setup->model);
    float largest;
    const size_t broken = hada_not_finite(frame->raw->data, hada_image_count(frame->raw), &largest);
    frame->staged = frame->raw;
    if (broken) /* which takes values of neighbours: none is brighter than the brightest */
        HADA_TRY(repair(frame, broken, err));
    return hada_frame_check_range(largest, (double)info->grid_rows * info->grid_cols, err);
}

int hada_frame_levels_vary(const hada_setup *setup)
{
    /* a model asks for the level of each frame by a dark level below zero */
    return setup->options.dark == HADA_DARK_AUTO ||
           (setup->options.dark == HADA_DARK_MODEL && hada_model_get_info(setup->model)->dark < 0);
}

double hada_frame_fixed_level(const hada_setup *setup)
{
    return setup->options.dark == HADA_DARK_MODEL   ? hada_model_get_info(setup->model)->dark
           : setup->options.dark == HADA_DARK_LEVEL ? setup->options.dark_level
                                                    : 0.0;
}

static int all_below(const hada_image *image, double level)
{
    const size_t count = hada_image_count(image);
    for (size_t i = 0; i < count; i++)
        if ((double)image->data[i] > level)
            return 0;
    return 1;
}

/* The report takes the mean of the channels' levels. */
static hada_status find_levels(hada_frame *frame, hada_error *err)
{
    const hada_image *image = frame->staged;
    const size_t pixels = (size_t)image->rows * (size_t)image->cols;
    const double level = hada_frame_fixed_level(frame->setup);
    const int vary = hada_frame_levels_vary(frame->setup);
    void *scratch = NULL;
    hada_status status = HADA_OK;
    if (vary)
        HADA_TRY_OR_DONE(hada_allocated(scratch = hada_alloc_raw(pixels, sizeof(float), "the dark level", err)));
    for (int channel = 0; channel < image->channels; channel++) {
        frame->levels[channel] =
            vary ? hada_dark_estimate(image->data + (size_t)channel * pixels, pixels, scratch) : level;
        frame->result->memory->report.dark += frame->levels[channel] / image->channels;
    }
    if (level > 1.0 && all_below(image, level))
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_MODEL,
                      "no pixel of the frame is above the dark level of %g that is taken off: it is one of frames "
                      "in other units; say options.dark",
                      level));
done:
    free(scratch);
    return status;
}

/* In sums side by side, for a single one would wait for each addition. */
static double energy_above(const hada_image *image, const double *levels, const hada_image *dark)
{
    enum { SUMS = 8 };
    const size_t pixels = (size_t)image->rows * (size_t)image->cols;
    double sums[SUMS] = {0}, sum = 0;
    for (int channel = 0; channel < image->channels; channel++) {
        const float *values = image->data + (size_t)channel * pixels;
        const float *below = dark->data ? dark->data + (size_t)channel * pixels : NULL;
        for (size_t i = 0; i < pixels; i += SUMS)
            for (size_t k = 0; k < (pixels - i < SUMS ? pixels - i : SUMS); k++) {
                const double value = values[i + k] - levels[channel] - (below ? below[i + k] : 0.0f);
                sums[k] += value * value;
            }
    }
    for (int k = 0; k < SUMS; k++)
        sum += sums[k];
    return sum;
}

hada_status hada_frame_prepare(hada_frame *frame, hada_error *err)
{
    frame->start = frame->lap = hada_seconds();
    atomic_store(&frame->enhanced, 0);
    atomic_store(&frame->tiles, 0);
    atomic_store(&frame->tiles_left_out, 0);
    HADA_TRY(prepare_result(frame, err));
    HADA_TRY(stage(frame, err));
    HADA_TRY(find_levels(frame, err));
    if (frame->setup->config.joint)
        frame->energy = energy_above(frame->staged, frame->levels, &frame->setup->dark_frame);
    skip_channels(frame);
    return HADA_OK;
}
