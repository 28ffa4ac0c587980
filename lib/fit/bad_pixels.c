/* Pixels of the sensor that do not see what those around them see: hot, dead and stuck ones. */
#include "core/finite.h"
#include "dataset/dataset.h"
#include "fit/fitter.h"
#include "image/mosaic.h"
#include "image/statistics.h"

/* Frames that are looked at. From so many on, a bad pixel may look sound in one of five. */
enum { FRAMES = 12, MANY = 5 };
/* Around a pixel: of the same colour, without the two largest and the two smallest, which may be bad as well. */
enum { AROUND = 8, OMITTED = 2 };
/* A bad pixel lies so many standard deviations of noise, and so many times the range of those around it, beyond it. */
#define BEYOND_NOISE 6.0F
#define BEYOND_RANGE 3.0F
/* The least noise, as a share of a frame's largest value: frames without any have steps. */
#define LEAST_NOISE 1e-3
/* If more than this share of all pixels seems bad, they belong to what the camera shows. */
#define MOST_BAD 5e-3

typedef struct looking {
    hada_mosaic mosaic;
    int frames, misses;    /* looked at so far; in how many a bad pixel may look sound */
    unsigned char *sounds; /* [channel][row][col]: in how many it did; beyond `misses`: not counted further */
    size_t count;
} looking;

/* The middle of three pixels of a line, `step` apart, of which i is one, the middle one where that is possible. */
static int inside(int i, int count, int step)
{
    return i < step ? i + step : i >= count - step ? i - step : i;
}

/* Whether a value lies beyond those around it, `step` pixels away. At a border these are the nearest ones, none of
 * which is left out: light that falls off towards it makes all of them brighter. */
static int is_beyond(const float *plane, int rows, int cols, int row, int col, int step, float noise)
{
    const float value = plane[(size_t)row * (size_t)cols + (size_t)col];
    const int middle = inside(row, rows, step), centre = inside(col, cols, step);
    const int omitted = middle == row && centre == col ? OMITTED : 0;
    float sorted[AROUND] = {0.0F};
    int n = 0, below = 0;
    for (int r = middle - step; r <= middle + step; r += step)
        for (int c = centre - step; c <= centre + step; c += step) {
            if (r == row && c == col)
                continue;
            const float other = plane[(size_t)r * (size_t)cols + (size_t)c];
            int at = n++;
            for (; at > 0 && sorted[at - 1] > other; at--)
                sorted[at] = sorted[at - 1];
            sorted[at] = other;
            below += other < value;
        }
    if (below > omitted && below < AROUND - omitted)
        return 0;
    const float low = sorted[omitted], high = sorted[AROUND - 1 - omitted];
    return fmaxf(value - high, low - value) > BEYOND_NOISE * noise + BEYOND_RANGE * (high - low);
}

static void look_at(looking *at, const hada_image *frame, float largest)
{
    const size_t area = (size_t)frame->rows * (size_t)frame->cols;
    const int mosaic = at->mosaic != HADA_MOSAIC_NONE;
    hada_pixels pixels = {.size = sizeof pixels, .full_scale = HADA_AUTO};
    hada_pixels_of_image(&pixels, frame);
    const float noise = (float)fmax(hada_noise_estimate(&pixels, at->mosaic), LEAST_NOISE * largest);
    for (size_t i = 0; i < hada_image_count(frame); i++) {
        const int row = (int)(i % area / (size_t)frame->cols), col = (int)(i % (size_t)frame->cols);
        if (at->sounds[i] > at->misses)
            continue;
        if ((mosaic && (size_t)hada_mosaic_channel(at->mosaic, row, col) != i / area) ||
            !is_beyond(frame->data + i / area * area, frame->rows, frame->cols, row, col, mosaic ? 2 : 1, noise))
            at->sounds[i]++;
    }
}

static hada_status look_at_pair(looking *at, const hada_dataset *pairs, int number, hada_error *err)
{
    enum { LEAST_SIDE = 6 }; /* three pixels of each colour */
    hada_pair pair = {0};
    float largest;
    hada_status status = HADA_OK;
    int z = 0;
    for (; number >= hada_dataset_get_info(pairs)->counts[z]; z++)
        number -= hada_dataset_get_info(pairs)->counts[z];
    HADA_TRY(hada_pair_take(&pair, pairs, z, number, err));
    const size_t count = hada_image_count(pair.raw);
    if (!at->sounds && pair.raw->rows >= LEAST_SIDE && pair.raw->cols >= LEAST_SIDE) {
        HADA_TRY_OR_DONE(HADA_NEW(at->sounds, count, "bad pixels", err));
        at->count = count;
    }
    if (at->count == count && !hada_not_finite(pair.raw->data, count, &largest)) { /* others are refused by the fit */
        look_at(at, pair.raw, largest);
        at->frames++;
    }
done:
    hada_pair_return(&pair);
    return status;
}

/* The flat frame of the pairs, or one of 1, with 0 where pixels are bad. */
static hada_status mark(const looking *at, const hada_fit_options *sizes, const hada_image *before, hada_image *flat,
                        hada_error *err)
{
    HADA_TRY(hada_image_create(flat, sizes->channels, sizes->raw_rows, sizes->raw_cols, err));
    const int same = before && before->rows == flat->rows && before->cols == flat->cols;
    for (size_t i = 0; i < at->count; i++)
        flat->data[i] = at->sounds[i] <= at->misses ? 0.0F : same ? before->data[i % hada_image_count(before)] : 1.0F;
    return HADA_OK;
}

hada_status hada_fit_find_bad_pixels(const hada_fit_options *sizes, const hada_dataset *pairs, hada_image *flat,
                                     size_t *found, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(pairs);
    const int count = hada_least(info->pairs, FRAMES);
    looking at = {.mosaic = info->mosaic, .misses = count < MANY ? 0 : count / MANY};
    hada_status status = HADA_OK;
    *found = 0;
    for (int k = 0; k < count; k++)
        HADA_TRY_OR_DONE(look_at_pair(&at, pairs, hada_spread(k, count, info->pairs), err));
    if (at.frames < 2 || at.frames < count ||
        at.count != (size_t)sizes->channels * (size_t)sizes->raw_rows * (size_t)sizes->raw_cols)
        goto done;
    for (size_t i = 0; i < at.count; i++)
        *found += at.sounds[i] <= at.misses;
    if ((double)*found > MOST_BAD * (double)at.count)
        *found = 0;
    if (*found)
        HADA_TRY_OR_DONE(mark(&at, sizes, info->flat, flat, err));
done:
    free(at.sounds);
    return status;
}
