/* A frame on the host: checked, corrected, examined. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/base.h"
#include "core/numbers.h"
#include "image/pixels.h"
#include "image/statistics.h"
#include "planes/maker.h"

/* The mosaic that a frame of the model's size is. */
static hada_mosaic mosaic_of(const hada_model_info *info, hada_mosaic mosaic, int channels)
{
    return channels > 1 || info->channels != HADA_MOSAIC_COLOURS ? HADA_MOSAIC_NONE
           : mosaic == HADA_MOSAIC_AUTO                          ? info->mosaic
                                                                 : mosaic;
}

hada_status hada_frame_check_size(const hada_model_info *info, const hada_frame_kind *kind, int channels, int rows,
                                  int cols, hada_error *err)
{
    const int binned = hada_is_of_sensor(info, kind->downsample, rows, cols), times = rows / info->raw_rows;
    const int same = binned || (rows == info->raw_rows && cols == info->raw_cols);
    const hada_mosaic mosaic = binned ? kind->sensor_mosaic : kind->mosaic;
    if (same && hada_mosaic_is_pattern(mosaic) && channels != 1)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the frame has %d channels, but a colour filter mosaic has one: leave options.mosaic out",
                         channels);
    if (same && (channels == info->channels || mosaic_of(info, mosaic, channels) != HADA_MOSAIC_NONE))
        return HADA_OK;
    if (same && channels == 1 && info->channels == HADA_MOSAIC_COLOURS)
        return hada_fail(
            err, HADA_ERROR_MODEL,
            "the frame has one channel, and the model %s is for colours: if the sensor has a colour filter "
            "mosaic, name its pattern with options.mosaic, such as options.mosaic rggb",
            info->name);
    if (!same && hada_is_of_sensor(info, times, rows, cols))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the frame has %d x %d pixels, %d times the %d x %d that the model %s is for: bin it with "
                         "options.downsample %d, or make the model with fit options.downsample %d",
                         rows, cols, times, info->raw_rows, info->raw_cols, info->name, times, times);
    return hada_fail(
        err, HADA_ERROR_MODEL,
        "the frame has %d channel(s) of %d x %d pixels; the model %s is for %d channel(s) of %d x %d: use "
        "the model of this camera, or make one with fit (from a PSF of another size or in grey: fit --psf PSF "
        "--frame FRAME)",
        channels, rows, cols, info->name, info->channels, info->raw_rows, info->raw_cols);
}

hada_status hada_frame_bin(hada_pixels *pixels, hada_image *own, const hada_model_info *info,
                           const hada_frame_kind *kind, hada_error *err)
{
    const hada_mosaic mosaic = pixels->channels == 1 ? kind->sensor_mosaic : HADA_MOSAIC_NONE;
    *own = (hada_image){0};
    if (!hada_is_of_sensor(info, kind->downsample, pixels->rows, pixels->cols))
        return HADA_OK;
    HADA_TRY(hada_pixels_copy(pixels, own, err));
    HADA_TRY(hada_image_bin(own, kind->downsample, mosaic, 1, err));
    hada_pixels_of_image(pixels, own);
    return HADA_OK;
}

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

enum {
    CHUNK = 8192, /* pixels that are examined together: their floats stay in the processor's cache */
    SUMS = 8,     /* side by side: a single sum would wait for each addition */
    LANES = 4     /* of the hash */
};

typedef struct examination {
    const hada_exposure_rule *rule;
    size_t broken;
    float largest, next; /* the largest value, and that below it */
    float limit;         /* values above it are near the largest */
    size_t equal, near;  /* values as large as the largest, and a little smaller */
    double sums[SUMS];
    uint64_t lanes[LANES];
} examination;

/* Each step is reversible for given values, so that frames which differ in few pixels never end alike; the multiplier
 * is that of D. Knuth's MMIX generator. */
static uint64_t mix(uint64_t lane, uint64_t word)
{
    lane = (lane ^ word) * UINT64_C(6364136223846793005);
    return lane ^ lane >> 32;
}

static void hash(uint64_t lanes[LANES], const float *values, size_t count)
{
    uint64_t words[LANES];
    for (size_t i = 0; i < count; i += 2 * LANES) {
        const size_t here = count - i < 2 * LANES ? count - i : 2 * LANES;
        memset(words, 0, sizeof words);
        memcpy(words, values + i, here * sizeof *values);
        for (int k = 0; k < LANES; k++)
            lanes[k] = mix(lanes[k], words[k]);
    }
}

uint64_t hada_exposure_sample(const hada_frame_exposure *exposure)
{
    enum { STRETCHES = 16, PIXELS = 64 };
    const size_t plane = (size_t)exposure->came.rows * (size_t)exposure->came.cols;
    uint64_t lanes[LANES] = {1, 2, 3, 4};
    float room[PIXELS];
    for (int c = 0; c < exposure->came.channels; c++)
        for (size_t i = 0; i < STRETCHES; i++) {
            const size_t first = i * plane / STRETCHES, count = plane - first < PIXELS ? plane - first : PIXELS;
            hash(lanes, hada_pixels_floats(&exposure->came, c, first, count, room), count);
        }
    return mix(mix(lanes[0], lanes[1]), mix(lanes[2], lanes[3]));
}

static void add_energy(double sums[SUMS], const float *values, const float *below, double level, size_t count)
{
    for (size_t i = 0; i < count; i += SUMS)
        for (size_t k = 0; k < (count - i < SUMS ? count - i : SUMS); k++) {
            const double value = values[i + k] - level - (below ? below[i + k] : 0.0f);
            sums[k] += value * value;
        }
}

static size_t plane_of(const hada_frame_exposure *exposure)
{
    return (size_t)exposure->came.rows * (size_t)exposure->came.cols;
}

size_t hada_exposure_count(const hada_frame_exposure *exposure)
{
    return (size_t)exposure->info->channels * plane_of(exposure);
}

/* The channel of a pixel of the frame as it came. */
static int channel_of(const hada_frame_exposure *exposure, size_t pixel)
{
    const size_t cols = (size_t)exposure->came.cols;
    return hada_mosaic_channel(exposure->mosaic, (int)(pixel / cols), (int)(pixel % cols));
}

/* What of an examination a pass over the frame finds. */
enum { VALUES = 1, ENERGY = 2, BRIGHT = 4, NEXT = 8 };

static void count_bright(examination *look, const float *values, size_t count)
{
    const float largest = look->largest, limit = look->limit;
    size_t equal = 0, above = 0;
    for (size_t i = 0; i < count; i++) {
        equal += values[i] == largest;
        above += values[i] > limit;
    }
    look->equal += equal;
    look->near += above - equal;
}

static void find_next(examination *look, const float *values, size_t count)
{
    for (size_t i = 0; i < count; i++)
        look->next = values[i] < look->largest && values[i] > look->next ? values[i] : look->next;
}

static void pass(const hada_frame_exposure *exposure, examination *look, int what)
{
    const size_t plane = plane_of(exposure);
    const float *dark = look->rule->dark_frame;
    float room[CHUNK];
    for (int c = 0; c < exposure->pixels.channels; c++)
        for (size_t first = 0, count; first < plane; first += count) {
            count = plane - first < CHUNK ? plane - first : CHUNK;
            const float *values = hada_pixels_floats(&exposure->pixels, c, first, count, room);
            float largest;
            if (what & VALUES) {
                look->broken += hada_not_finite(values, count, &largest);
                look->largest = largest > look->largest ? largest : look->largest;
                if (look->rule->hash)
                    hash(look->lanes, values, count);
            }
            if (what & BRIGHT)
                count_bright(look, values, count);
            if (what & NEXT)
                find_next(look, values, count);
            if (what & ENERGY)
                add_energy(look->sums, values, dark ? dark + (size_t)c * plane + first : NULL, exposure->levels[c],
                           count);
        }
}

/* Whether the frame is cut off at its largest value (image/statistics.h). */
static int is_cut_off(const hada_frame_exposure *exposure, examination *look)
{
    look->limit = HADA_NEAR_LARGEST * look->largest;
    pass(exposure, look, BRIGHT);
    if (look->near || !hada_is_cut_off(look->equal, 0))
        return hada_is_cut_off(look->equal, look->near);
    pass(exposure, look, NEXT);
    look->limit = HADA_NEAR_LARGEST * look->next;
    look->equal = 0;
    pass(exposure, look, BRIGHT);
    return hada_is_cut_off(look->equal, look->near);
}

/* From now on the exposure's pixels are floats of its own. */
static hada_status copy(hada_frame_exposure *exposure, hada_error *err)
{
    if (!exposure->own.data)
        HADA_TRY(hada_pixels_copy(&exposure->came, &exposure->own, err));
    hada_pixels_of_image(&exposure->pixels, &exposure->own);
    return HADA_OK;
}

/* Where value i of the frame as it came stands among those of all channels. */
static size_t value_of(const hada_frame_exposure *exposure, size_t i)
{
    return exposure->mosaic == HADA_MOSAIC_NONE ? i : (size_t)channel_of(exposure, i) * plane_of(exposure) + i;
}

/* A caller's weight of value i of the frame as it came. */
static float given_weight(const hada_frame_exposure *exposure, size_t i)
{
    return exposure->pixel_weights ? exposure->pixel_weights[value_of(exposure, i)] : 1.0f;
}

/* Pixels of weight 0 become such that are repaired; *blanked: how many. */
static hada_status blank(hada_frame_exposure *exposure, size_t *blanked, hada_error *err)
{
    *blanked = 0;
    if (!exposure->pixel_weights)
        return HADA_OK;
    HADA_TRY(copy(exposure, err));
    for (size_t i = 0; i < hada_image_count(&exposure->own); i++)
        if (!(given_weight(exposure, i) > 0.0f)) {
            exposure->own.data[i] = NAN;
            ++*blanked;
        }
    return HADA_OK;
}

/* Bad pixels as well. */
static hada_status blank_bad(hada_frame_exposure *exposure, size_t *blanked, hada_error *err)
{
    HADA_TRY(hada_bad_pixels_find(&exposure->pixels, exposure->mosaic, 0, &exposure->bad, &exposure->bad_count, err));
    if (exposure->bad_count)
        HADA_TRY(copy(exposure, err));
    for (size_t k = 0; k < exposure->bad_count; k++)
        exposure->own.data[exposure->bad[k]] = NAN;
    *blanked += exposure->bad_count;
    return HADA_OK;
}

static hada_status repair(hada_frame_exposure *exposure, const examination *look, size_t blanked, hada_error *err)
{
    if (!look->rule->repairs && look->broken > blanked)
        return hada_fail(err, HADA_ERROR_NOT_FINITE,
                         "%zu pixel(s) of the frame are NaN or infinite; repair them from their neighbours with "
                         "options.repair_not_finite, or mend the file",
                         look->broken - blanked);
    HADA_TRY(copy(exposure, err));
    HADA_TRY(hada_frame_repair(&exposure->own, exposure->mosaic, &exposure->repaired, err));
    exposure->repaired -= blanked;
    return HADA_OK;
}

static int all_below(const hada_frame_exposure *exposure, double level)
{
    const size_t plane = plane_of(exposure);
    float room[CHUNK];
    for (int c = 0; c < exposure->pixels.channels; c++)
        for (size_t first = 0, count; first < plane; first += count) {
            count = plane - first < CHUNK ? plane - first : CHUNK;
            const float *values = hada_pixels_floats(&exposure->pixels, c, first, count, room);
            for (size_t i = 0; i < count; i++)
                if ((double)values[i] > level)
                    return 0;
        }
    return 1;
}

/* The energy of a mosaic whose other colours are filled in. */
static double mosaic_energy(const hada_frame_exposure *exposure)
{
    const float *dark = exposure->dark_frame;
    const size_t plane = plane_of(exposure);
    double sums[HADA_MOSAIC_COLOURS] = {0.0}, energy = 0.0;
    size_t counts[HADA_MOSAIC_COLOURS] = {0};
    for (size_t i = 0; i < plane; i++) {
        const int c = channel_of(exposure, i);
        const size_t at = (size_t)c * plane + i;
        const double value = exposure->own.data[at] - exposure->levels[c] - (dark ? dark[at] : 0.0f);
        sums[c] += value * value;
        counts[c]++;
    }
    for (int c = 0; c < HADA_MOSAIC_COLOURS; c++)
        energy += sums[c] * (double)plane / (double)counts[c];
    return energy;
}

static double sum_of(const examination *look)
{
    double sum = 0.0;
    for (int k = 0; k < SUMS; k++)
        sum += look->sums[k];
    return sum;
}

static void measure(hada_frame_exposure *exposure)
{
    const hada_exposure_rule rule = {.dark_frame = exposure->dark_frame};
    examination look = {.rule = &rule};
    if (exposure->mosaic == HADA_MOSAIC_NONE)
        pass(exposure, &look, ENERGY);
    exposure->energy = exposure->mosaic == HADA_MOSAIC_NONE ? sum_of(&look) : mosaic_energy(exposure);
}

/* By the flat frame. Values of weight 0 are those of divided neighbours. A dark level that is estimated is so again, as
 * in a fit, which has divided frames alone. */
static hada_status divide(hada_frame_exposure *exposure, const hada_exposure_rule *rule, hada_error *err)
{
    double *levels = exposure->levels, *before = levels + exposure->info->channels;
    size_t blanked;
    memcpy(before, levels, (size_t)exposure->info->channels * sizeof *levels);
    hada_flat_apply(&exposure->own, exposure->mosaic, rule->flat, before, rule->dark_frame);
    HADA_TRY(blank(exposure, &blanked, err));
    HADA_TRY(hada_frame_repair(&exposure->own, exposure->mosaic, &blanked, err));
    return rule->dark_varies ? hada_dark_levels(&exposure->pixels, exposure->mosaic, levels, err) : HADA_OK;
}

/* Whether a frame is brought from the sensor's colours to the scenes'. */
static int has_matrix(const hada_frame_exposure *exposure)
{
    return hada_colours_known(exposure->info->colour_matrix);
}

/* What is above dark levels and dark frame, which stay: they are subtracted later. */
static hada_status unmix(hada_frame_exposure *exposure, hada_error *err)
{
    const size_t plane = plane_of(exposure);
    const float *dark = exposure->dark_frame;
    HADA_TRY(copy(exposure, err));
    float *values = exposure->own.data;
    for (size_t i = 0; i < HADA_COLOURS * plane; i++)
        values[i] -= (float)exposure->levels[i / plane] + (dark ? dark[i] : 0.0F);
    hada_colours_unmix(values, plane, exposure->info->colour_matrix);
    for (size_t i = 0; i < HADA_COLOURS * plane; i++)
        values[i] += (float)exposure->levels[i / plane] + (dark ? dark[i] : 0.0F);
    return HADA_OK;
}

float hada_exposure_brightest(const hada_frame_exposure *exposure, size_t i)
{
    const double level = exposure->levels[(size_t)exposure->info->channels + i / plane_of(exposure)];
    const double dark = exposure->dark_frame ? level + exposure->dark_frame[i] : level;
    const float value =
        exposure->flat ? hada_flat_value(exposure->brightest, exposure->flat->data[i], dark) : exposure->brightest;
    if (!exposure->stray)
        return value;
    const size_t pixel = i % plane_of(exposure), cols = (size_t)exposure->came.cols;
    return value - (float)hada_smooth_at(exposure->stray + i / plane_of(exposure) * HADA_SMOOTH_TERMS,
                                         (int)(pixel / cols), (int)(pixel % cols), exposure->came.rows,
                                         exposure->came.cols);
}

/* Fills the other colours of a mosaic in. */
static hada_status fill(hada_frame_exposure *exposure, hada_error *err)
{
    hada_image *own = &exposure->own, filled = {0};
    HADA_TRY(hada_mosaic_colours(exposure->mosaic, own, &filled, err));
    hada_image_destroy(own);
    *own = filled;
    hada_pixels_of_image(&exposure->pixels, own);
    return HADA_OK;
}

static hada_status begin(hada_frame_exposure *exposure, const hada_frame_kind *kind, hada_error *err)
{
    const hada_model_info *info = exposure->info;
    hada_pixels *pixels = &exposure->came;
    HADA_TRY(hada_frame_check_size(info, kind, pixels->channels, pixels->rows, pixels->cols, err));
    HADA_TRY(hada_frame_bin(pixels, &exposure->binned, info, kind, err));
    exposure->mosaic = mosaic_of(info, kind->mosaic, pixels->channels);
    if (exposure->mosaic != HADA_MOSAIC_NONE && (pixels->rows < 2 || pixels->cols < 2))
        return hada_fail(err, HADA_ERROR_MODEL, "a colour filter mosaic has at least 2 x 2 pixels");
    exposure->pixels = *pixels;
    return HADA_NEW(exposure->levels, 2 * (size_t)info->channels, "a frame", err);
}

hada_status hada_exposure_begin(hada_frame_exposure *exposure, const hada_model_info *info, const hada_frame_kind *kind,
                                const hada_pixels *pixels, hada_error *err)
{
    *exposure = (hada_frame_exposure){.info = info, .came = *pixels};
    const hada_status status = begin(exposure, kind, err);
    if (status)
        hada_exposure_end(exposure);
    return status;
}

void hada_exposure_end(hada_frame_exposure *exposure)
{
    hada_image_destroy(&exposure->own);
    hada_image_destroy(&exposure->binned);
    HADA_FREE(exposure->levels, exposure->bad);
    exposure->levels = NULL;
    exposure->bad = NULL;
}

hada_status hada_exposure_examine(hada_frame_exposure *exposure, const hada_exposure_rule *rule, hada_error *err)
{
    const hada_model_info *info = exposure->info;
    const int mosaic = exposure->mosaic != HADA_MOSAIC_NONE;
    const int at_once = rule->energy && !rule->dark_varies && !rule->flat && !mosaic;
    examination look = {.rule = rule, .lanes = {1, 2, 3, 4}};
    size_t blanked;
    hada_image_destroy(&exposure->own);
    exposure->pixel_weights = rule->pixel_weights;
    exposure->dark_frame = rule->dark_frame;
    exposure->flat = rule->flat;
    exposure->pixels = exposure->came;
    exposure->repaired = exposure->bad_count = 0;
    free(exposure->bad);
    exposure->bad = NULL;
    exposure->stray = NULL;
    for (int c = 0; c < info->channels; c++)
        exposure->levels[c] = rule->dark;
    if (mosaic || rule->flat || !hada_pixels_uploads(&exposure->came))
        HADA_TRY(copy(exposure, err));
    HADA_TRY(blank(exposure, &blanked, err));
    if (rule->bad_pixels)
        HADA_TRY(blank_bad(exposure, &blanked, err));
    pass(exposure, &look, at_once ? VALUES | ENERGY : VALUES);
    for (int k = 0; k < 2; k++)
        exposure->hash[k] = mix(mix(look.lanes[k], look.lanes[k + 2]), look.lanes[3 - k]);
    if (look.broken) /* which takes values of neighbours: none is brighter than the brightest */
        HADA_TRY(repair(exposure, &look, blanked, err));
    HADA_TRY(hada_frame_check_range(look.largest, (double)info->grid_rows * info->grid_cols, err));
    exposure->saturated = 0;
    exposure->brightest = look.largest;
    if (rule->weights && look.largest > 0.0f && is_cut_off(exposure, &look))
        exposure->saturated = look.equal;
    if (rule->dark_varies)
        HADA_TRY(hada_dark_levels(&exposure->pixels, exposure->mosaic, exposure->levels, err));
    else if (rule->dark > 1.0 && all_below(exposure, rule->dark))
        return hada_fail(
            err, HADA_ERROR_MODEL,
            "no pixel of the frame is above the dark level of %g that is subtracted: the level seems to be "
            "in other units; set options.dark",
            rule->dark);
    if (rule->flat)
        HADA_TRY(divide(exposure, rule, err));
    if (mosaic)
        HADA_TRY(fill(exposure, err));
    if (has_matrix(exposure))
        HADA_TRY(unmix(exposure, err));
    exposure->energy = 0.0;
    if (at_once && !look.broken && !has_matrix(exposure))
        exposure->energy = sum_of(&look);
    else if (rule->energy)
        measure(exposure);
    return HADA_OK;
}

hada_status hada_exposure_subtract(hada_frame_exposure *exposure, const double *weight, hada_error *err)
{
    HADA_TRY(copy(exposure, err));
    hada_smooth_add(weight, -1.0, &exposure->own);
    exposure->stray = weight;
    measure(exposure);
    return HADA_OK;
}

int hada_exposure_has_gaps(const hada_frame_exposure *exposure)
{
    return exposure->repaired || exposure->bad_count || exposure->saturated || exposure->pixel_weights;
}

int hada_exposure_is_weighted(const hada_frame_exposure *exposure)
{
    return exposure->mosaic != HADA_MOSAIC_NONE || hada_exposure_has_gaps(exposure);
}

/* The weight of value i of the frame as it came. */
static float weight_of(const hada_frame_exposure *exposure, size_t i, float value)
{
    const float weight = given_weight(exposure, i);
    return !isfinite(value) ? 0.0f : exposure->saturated && value == exposure->brightest ? -weight : weight;
}

size_t hada_exposure_weigh(const hada_frame_exposure *exposure, float *weights)
{
    const hada_pixels *came = &exposure->came;
    const size_t plane = plane_of(exposure);
    const int mosaic = exposure->mosaic != HADA_MOSAIC_NONE;
    float room[CHUNK];
    size_t good = 0;
    if (mosaic)
        memset(weights, 0, hada_exposure_count(exposure) * sizeof *weights);
    for (int c = 0; c < came->channels; c++)
        for (size_t first = 0, count; first < plane; first += count) {
            count = plane - first < CHUNK ? plane - first : CHUNK;
            const float *values = hada_pixels_floats(came, c, first, count, room);
            for (size_t k = 0; k < count; k++) {
                const size_t pixel = first + k, i = (size_t)c * plane + pixel;
                float *to = weights + (mosaic ? (size_t)channel_of(exposure, pixel) * plane + pixel : i);
                *to = weight_of(exposure, i, values[k]);
                good += *to > 0.0f;
            }
        }
    for (size_t k = 0; k < exposure->bad_count; k++) {
        float *to = weights + value_of(exposure, exposure->bad[k]);
        good -= *to > 0.0f;
        *to = 0.0f;
    }
    return has_matrix(exposure) ? hada_colours_weigh(weights, came->rows, came->cols, exposure->mosaic) : good;
}

double hada_exposure_noise(const hada_frame_exposure *exposure)
{
    return hada_noise_estimate(&exposure->pixels, exposure->mosaic);
}

double hada_exposure_noise_energy(const hada_frame_exposure *exposure)
{
    const double deviation = hada_exposure_noise(exposure);
    return deviation * deviation * (double)hada_exposure_count(exposure);
}

double hada_exposure_light(const hada_frame_exposure *exposure)
{
    return sqrt(exposure->energy / (double)hada_exposure_count(exposure));
}

double hada_exposure_noise_unit(const hada_frame_exposure *exposure, const hada_noise_share *usual)
{
    return hada_noise_unit(&exposure->pixels, exposure->mosaic, usual,
                           exposure->energy / (double)hada_exposure_count(exposure),
                           exposure->brightest - exposure->levels[0]);
}
