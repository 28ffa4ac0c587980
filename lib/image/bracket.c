/* Frames of one scene with several exposures, merged into one. */
#include <math.h>

#include "core/callers.h"
#include "image/mosaic.h"
#include "image/statistics.h"

/* Two exposures are compared by so many pixels at least, and go together if these are correlated so much, and the
 * brighter one is the longer one, but for what saturation takes from its mean. */
enum { LEAST_PIXELS = 256 };
#define LEAST_SCALE 0.9
#define LEAST_ALIKE 0.5

/* One exposure. Its values are scale * value + offset of the shortest one's. */
typedef struct exposure {
    const hada_image *frame;
    double mean, scale, offset;
    float limit[HADA_MOSAIC_COLOURS]; /* of each channel, modulo their number: values from here on are cut off */
} exposure;

typedef struct bracket {
    hada_mosaic mosaic;
    int count;
    exposure *of; /* by brightness */
} bracket;

static float limit_at(const bracket *all, int k, size_t i)
{
    const hada_image *frame = all->of[k].frame;
    const size_t cols = (size_t)frame->cols, plane = (size_t)frame->rows * cols;
    const int channel = all->mosaic != HADA_MOSAIC_NONE
                            ? hada_mosaic_channel(all->mosaic, (int)(i / cols), (int)(i % cols))
                            : (int)(i / plane) % HADA_MOSAIC_COLOURS;
    return all->of[k].limit[channel];
}

static int is_known(const bracket *all, int k, size_t i)
{
    return all->of[k].frame->data[i] < limit_at(all, k, i); /* not NaN either */
}

/* Values from which on each channel may be cut off: those in this part of the largest one. A few pixels that are not
 * lose little. */
#define MAY_BE_CUT_OFF (1.0f - 0x1p-7f)

static void find_limits(const bracket *all, exposure *of, float *room)
{
    const hada_image *frame = of->frame;
    const int channels = all->mosaic != HADA_MOSAIC_NONE ? HADA_MOSAIC_COLOURS : frame->channels;
    for (int c = 0; c < HADA_MOSAIC_COLOURS; c++)
        of->limit[c] = INFINITY;
    for (int c = 0; c < channels; c++) {
        size_t count;
        const float *values = hada_mosaic_channel_values(all->mosaic, c, frame, room, &count);
        float *limit = &of->limit[c % HADA_MOSAIC_COLOURS];
        float largest = 0.0f;
        for (size_t i = 0; i < count; i++)
            largest = fmaxf(largest, values[i]);
        *limit = fminf(*limit, MAY_BE_CUT_OFF * largest);
    }
}

static double mean_of(const hada_image *frame)
{
    double sum = 0.0;
    size_t count = 0;
    for (size_t i = 0; i < hada_image_count(frame); i++)
        if (isfinite(frame->data[i])) {
            sum += frame->data[i];
            count++;
        }
    return count ? sum / (double)count : 0.0;
}

static int by_mean(const void *a, const void *b)
{
    const exposure *one = a, *other = b;
    return (one->mean > other->mean) - (one->mean < other->mean);
}

/* Scale and offset of exposure k to the one before it, by orthogonal regression over the pixels that both know: noise
 * of either does not lessen the scale, as it would in a regression of one on the other. */
static hada_status relate(const bracket *all, int k, hada_error *err)
{
    const float *x = all->of[k - 1].frame->data, *y = all->of[k].frame->data;
    double sx = 0.0, sy = 0.0, xx = 0.0, xy = 0.0, yy = 0.0;
    size_t count = 0;
    for (size_t i = 0; i < hada_image_count(all->of[k].frame); i++) {
        if (!is_known(all, k - 1, i) || !is_known(all, k, i))
            continue;
        const double a = x[i] - all->of[k - 1].mean, b = y[i] - all->of[k].mean;
        sx += a;
        sy += b;
        xx += a * a;
        xy += a * b;
        yy += b * b;
        count++;
    }
    if (count < LEAST_PIXELS)
        return hada_fail(
            err, HADA_ERROR_NUMERIC,
            "exposures %d and %d (by brightness) share %zu pixels that neither saturates, too few to relate "
            "them; add an exposure between them",
            k, k + 1, count);
    xx -= sx * sx / (double)count;
    xy -= sx * sy / (double)count;
    yy -= sy * sy / (double)count;
    const double difference = yy - xx, scale = (difference + hypot(difference, 2.0 * xy)) / (2.0 * xy);
    if (!(xy > LEAST_ALIKE * sqrt(xx * yy) && scale > LEAST_SCALE))
        return hada_fail(err, HADA_ERROR_NUMERIC,
                         "exposures %d and %d (by brightness) do not show the same scene: brighter pixels of one are "
                         "not brighter in the other",
                         k, k + 1);
    const double offset = all->of[k].mean + sy / (double)count - scale * (all->of[k - 1].mean + sx / (double)count);
    all->of[k].scale = scale * all->of[k - 1].scale;
    all->of[k].offset = offset + scale * all->of[k - 1].offset;
    return HADA_OK;
}

/* Each exposure counts by the square of its length, as is best where noise is the sensor's own; where it is that of
 * photons, the variance is a few per cent above the least. *length: of all that count. */
static float merge(const bracket *all, size_t i, double *length)
{
    double sum = 0.0, squares = 0.0;
    *length = 0.0;
    for (int k = 0; k < all->count; k++)
        if (is_known(all, k, i)) {
            const double scale = all->of[k].scale;
            sum += (all->of[k].frame->data[i] - all->of[k].offset) * scale;
            squares += scale * scale;
            *length += scale;
        }
    if (*length > 0.0)
        return (float)(sum / squares);
    *length = all->of[0].scale;
    return all->of[0].frame->data[i];
}

static hada_status check(const hada_image *frames, int count, hada_mosaic mosaic, hada_error *err)
{
    if (count < 2)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a bracket has two exposures or more; here is %d", count);
    if (mosaic != HADA_MOSAIC_NONE && !hada_mosaic_is_pattern(mosaic))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the mosaic of a bracket, %d, is not a pattern", (int)mosaic);
    for (int k = 0; k < count; k++)
        HADA_TRY(hada_image_check(&frames[k], NULL, "a bracket", "one of frames", err));
    for (int k = 0; k < count; k++)
        if (frames[k].channels != frames->channels || frames[k].rows != frames->rows || frames[k].cols != frames->cols)
            return hada_fail(
                err, HADA_ERROR_SIZE, "exposure %d has %d channel(s) of %d x %d pixels, the first %d of %d x %d", k + 1,
                frames[k].channels, frames[k].rows, frames[k].cols, frames->channels, frames->rows, frames->cols);
    return HADA_OK;
}

hada_status hada_image_merge_exposures(hada_image *out, hada_image *weights, const hada_image *frames, int count,
                                       hada_mosaic mosaic, double *scales, double *dark, hada_error *err)
{
    HADA_NEED(out && frames, err);
    bracket all = {.count = count};
    float *room = NULL;
    hada_status status = HADA_OK;
    *out = (hada_image){0};
    if (weights)
        *weights = (hada_image){0};
    HADA_TRY(check(frames, count, mosaic, err));
    all.mosaic = frames->channels == 1 ? mosaic : HADA_MOSAIC_NONE;
    HADA_TRY_OR_DONE(HADA_NEW(all.of, (size_t)count, "a bracket", err));
    HADA_TRY_OR_DONE(HADA_NEW(room, (size_t)frames->rows * (size_t)frames->cols, "a bracket", err));
    for (int k = 0; k < count; k++) {
        all.of[k] = (exposure){.frame = &frames[k], .mean = mean_of(&frames[k]), .scale = 1.0};
        find_limits(&all, &all.of[k], room);
    }
    qsort(all.of, (size_t)count, sizeof *all.of, by_mean);
    for (int k = 1; k < count; k++)
        HADA_TRY_OR_DONE(relate(&all, k, err));
    HADA_TRY_OR_DONE(hada_image_create(out, frames->channels, frames->rows, frames->cols, err));
    if (weights)
        HADA_TRY_OR_DONE(hada_image_create(weights, frames->channels, frames->rows, frames->cols, err));
    double whole = 0.0, length;
    for (int k = 0; k < count; k++)
        whole += all.of[k].scale;
    for (size_t i = 0; i < hada_image_count(out); i++) {
        out->data[i] = merge(&all, i, &length);
        if (weights)
            weights->data[i] = (float)(length / whole);
    }
    const exposure *longest = &all.of[count - 1];
    if (dark)
        *dark = longest->scale > 1.0 ? longest->offset / (1.0 - longest->scale) : 0.0;
    for (int k = 0; scales && k < count; k++)
        scales[all.of[k].frame - frames] = all.of[k].scale;
done:
    HADA_FREE(all.of, room);
    if (status)
        hada_image_destroy(out);
    return status;
}
