/* A frame on its way: begun, prepared, ended; which channels need no computing. */
#include "engine/frame.h"

#include "core/clock.h"
#include "core/numbers.h"

enum { STRETCH = 1024 /* pixels that are compared at a time: most comparisons end with the first */ };

/* Whether nothing remains of a channel above dark level and dark frame: in float, as on the device. */
static int is_black(const hada_frame *frame, int channel)
{
    const hada_frame_exposure *exposure = &frame->exposure;
    const hada_pixels *pixels = &exposure->pixels;
    const size_t plane = (size_t)pixels->rows * (size_t)pixels->cols;
    const float *dark = frame->setup->dark_frame.data, level = (float)exposure->levels[channel];
    float room[STRETCH];
    for (size_t first = 0, count; first < plane; first += count) {
        count = plane - first < STRETCH ? plane - first : STRETCH;
        const float *values = hada_pixels_floats(pixels, channel, first, count, room);
        const float *below = dark ? dark + (size_t)channel * plane + first : NULL;
        for (size_t i = 0; i < count; i++)
            if ((values[i] - level) - (below ? below[i] : 0.0f) != 0.0f)
                return 0;
    }
    return 1;
}

static int is_same(const hada_frame *frame, int a, int b)
{
    const hada_frame_exposure *exposure = &frame->exposure;
    const hada_pixels *pixels = &exposure->pixels;
    const int *dark = frame->setup->same_dark;
    const size_t plane = (size_t)pixels->rows * (size_t)pixels->cols;
    float room[2][STRETCH];
    int same = exposure->levels[a] == exposure->levels[b] && dark[a] == dark[b];
    for (size_t first = 0, count; same && first < plane; first += count) {
        count = plane - first < STRETCH ? plane - first : STRETCH;
        same = !memcmp(hada_pixels_floats(pixels, a, first, count, room[0]),
                       hada_pixels_floats(pixels, b, first, count, room[1]), count * sizeof(float));
    }
    return same;
}

/* The first channels with the spectrum and with the planes of channel c. */
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
    for (int c = 0; c < frame->exposure.pixels.channels; c++) {
        skip->spectra[c] = skip->planes[c] = c;
        if (frame->setup->options.skip & HADA_SKIP_CHANNELS)
            find_source(frame, c, &skip->spectra[c], &skip->planes[c]);
        skip->channels += skip->planes[c] != c;
    }
}

static void free_parts(hada_frame *frame)
{
    hada_exposure_end(&frame->exposure);
    HADA_FREE(frame->skip.spectra, frame->skip.planes, frame->stray);
    frame->stray = NULL;
    frame->skip = (hada_frame_skip){0};
}

hada_status hada_frame_begin(hada_frame *frame, const hada_setup *setup, const hada_pixels *raw, hada_result *result,
                             hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(setup->model);
    const hada_config *config = &setup->config;
    const size_t channels = (size_t)info->channels;
    hada_status status = HADA_OK;
    *frame = (hada_frame){.setup = setup, .result = result};
    /* upload and pictures are a unit each */
    frame->work = 2 + (config->joint ? config->steps + (config->pursuit ? HADA_WORK_PURSUIT : 0) : config->depths);
    if (config->classic)
        frame->work += hada_classic_search_most(&config->method);
    HADA_TRY_OR_DONE(hada_exposure_begin(&frame->exposure, info, &config->kind, raw, err));
    HADA_TRY_OR_DONE(HADA_NEW(frame->skip.spectra, channels, "a frame", err));
    HADA_TRY_OR_DONE(HADA_NEW(frame->skip.planes, channels, "a frame", err));
    HADA_TRY_OR_DONE(HADA_NEW(frame->stray, channels * HADA_SMOOTH_TERMS, "a frame", err));
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
    HADA_TRY(hada_result_fit(result, hada_model_get_info(setup->model), depths, err));
    hada_result_renew(result);
    memcpy((double *)result->distances_mm, setup->distances, (size_t)depths * sizeof(double));
    return HADA_OK;
}

hada_status hada_frame_examine(hada_frame *frame, hada_error *err)
{
    const hada_setup *setup = frame->setup;
    const hada_dark kind = setup->options.dark;
    const double models = hada_model_get_info(setup->model)->dark; /* HADA_AUTO: each frame has a level of its own */
    const hada_exposure_rule rule = {.dark_varies =
                                         kind == HADA_DARK_AUTO || (kind == HADA_DARK_MODEL && models == HADA_AUTO),
                                     .dark = kind == HADA_DARK_MODEL   ? models
                                             : kind == HADA_DARK_LEVEL ? setup->options.dark_level
                                                                       : 0.0,
                                     .dark_frame = setup->dark_frame.data,
                                     .pixel_weights = setup->pixel_weights.data,
                                     .flat = setup->flat,
                                     .bad_pixels = setup->bad_pixels,
                                     .repairs = setup->options.repair_not_finite,
                                     .energy = setup->config.joint,
                                     .weights = setup->config.weighs || (setup->config.joint && !setup->config.classic),
                                     .hash = frame->hashed};
    if (frame->examined)
        return HADA_OK;
    HADA_TRY(hada_exposure_examine(&frame->exposure, &rule, err));
    frame->examined = 1;
    return HADA_OK;
}

hada_status hada_frame_prepare(hada_frame *frame, hada_error *err)
{
    frame->start = frame->lap = hada_seconds();
    atomic_store(&frame->enhanced, 0);
    atomic_store(&frame->tiles, 0);
    atomic_store(&frame->tiles_left_out, 0);
    HADA_TRY(prepare_result(frame, err));
    HADA_TRY(hada_frame_examine(frame, err));
    hada_report *report = &frame->result->memory->report;
    const hada_frame_exposure *exposure = &frame->exposure;
    report->repaired_pixels = exposure->repaired;
    report->saturated_pixels = exposure->saturated;
    report->bad_pixels = exposure->bad_count;
    for (int c = 0; c < exposure->pixels.channels; c++) /* the mean of the channels' levels */
        report->dark += exposure->levels[c] / exposure->pixels.channels;
    skip_channels(frame);
    return HADA_OK;
}

/* A frame shows something where one of so many of its pixels lies so many standard deviations of its noise from the
 * median of its channel: light of a lensless camera covers much of the sensor, broken pixels one of a thousand. */
enum { SHOWN = 100 };
#define BEYOND_NOISE 6.0

/* A channel without the dark frame, into `out`, where it is reordered. */
static int channel_shows(const hada_frame *frame, int channel, double noise, float *out)
{
    const hada_pixels *pixels = &frame->exposure.pixels;
    const size_t plane = (size_t)pixels->rows * (size_t)pixels->cols;
    const float *dark = frame->setup->dark_frame.data;
    size_t found = 0;
    for (size_t first = 0, count; first < plane; first += count) {
        count = plane - first < STRETCH ? plane - first : STRETCH;
        const float *values = hada_pixels_floats(pixels, channel, first, count, out + first);
        for (size_t i = 0; i < count; i++)
            out[first + i] = values[i] - (dark ? dark[(size_t)channel * plane + first + i] : 0.0F);
    }
    const double median = hada_select_rank(out, plane, plane / 2),
                 limit = fmax(BEYOND_NOISE * noise, 1e-6 * fabs(median));
    for (size_t i = 0; i < plane; i++)
        found += fabs(out[i] - median) > limit;
    return SHOWN * found >= plane;
}

static hada_status shows_something(const hada_frame *frame, int *shows, hada_error *err)
{
    const hada_pixels *pixels = &frame->exposure.pixels;
    float *room = NULL;
    HADA_TRY(HADA_NEW_RAW(room, (size_t)pixels->rows * (size_t)pixels->cols, "a frame that gave nothing", err));
    const double noise = hada_exposure_noise(&frame->exposure);
    *shows = 0;
    for (int c = 0; c < pixels->channels && !*shows; c++)
        *shows = channel_shows(frame, c, noise, room);
    free(room);
    return HADA_OK;
}

hada_status hada_frame_check_result(const hada_frame *frame, hada_error *err)
{
    const hada_result *result = frame->result;
    const hada_image *all = &result->all_in_focus;
    float most;
    int shows;
    size_t broken = hada_not_finite(all->data, hada_image_count(all), &most);
    for (int z = 0; !broken && most == 0.0F && z < result->depths; z++)
        broken = hada_not_finite(result->planes[z].data, hada_image_count(&result->planes[z]), &most);
    if (broken)
        return hada_fail(err, HADA_ERROR_NUMERIC,
                         "%zu values of the result are NaN or infinite: the model, its net or an option has numbers "
                         "that single precision cannot hold",
                         broken);
    if (most > 0.0F)
        return HADA_OK;
    HADA_TRY(shows_something(frame, &shows, err));
    if (!shows)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_NUMERIC,
                     "the frame shows something, but all planes came out black (dark level %.3g): the dark level or "
                     "dark frame is not this frame's, the model is of another camera, or it, its net or an option "
                     "has numbers that single precision cannot hold",
                     result->memory->report.dark);
}
