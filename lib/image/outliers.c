#include <math.h>

#include "core/base.h"
#include "image/correct.h"
#include "image/statistics.h"

/* Pixels of the same colour are looked at around each one: in a square, whose nearest ones are AROUND. */
enum { REACH = 2, SIDE = 2 * REACH + 1, SQUARE = SIDE * SIDE - 1, AROUND = 8 };
/* A bad pixel lies so much beyond the median of the square: so many times what all but one of the nearest ones do
 * together, for one of them may be bad as well, and so many standard deviations of noise. A Gaussian as wide as the
 * header says stays below that wherever between pixels it is. */
#define BEYOND_NEAREST 1.2F
#define BEYOND_NOISE   6.0F
/* And beyond the square by so many times its range, without the three largest and the three smallest: where it is
 * bright, noise is stronger. */
enum { OMITTED = 3 };
#define BEYOND_RANGE 1.5F
/* The least noise, as a share of a frame's largest value: frames without any have steps. */
#define LEAST_NOISE 1e-3
/* If more than this share of a frame's values seem bad, they belong to what the camera shows. */
#define MOST_BAD 5e-3
/* Bad pixels of a frame that hold less than this share of what its noise holds do no harm, and are left in: weights
 * cost time. */
#define LEAST_SQUARES 0.02
/* One that is alone has so many times as much light as those seven have, beyond so many deviations of noise. */
#define ALONE       10.0F
#define ALONE_NOISE 8.0F
/* A first look: beyond three of the four nearest ones by so many times their range. */
#define BEYOND_THREE 2.0F

/* The middle of a line of pixels that reaches so many steps to either side and has pixel i among them: i where that is
 * possible, else the nearest one so many steps from i. */
static int middle_of(int i, int count, int step, int reach)
{
    while (i < reach * step)
        i += step;
    while (i >= count - reach * step)
        i -= step;
    return i;
}

typedef struct search {
    const hada_pixels *frame;
    hada_mosaic mosaic;
    int step; /* to the next pixel of the same colour */
    int alone;
    float noise;  /* negative: not known yet */
    float *rooms; /* three rows, and one for the noise */
    size_t *list, count, most;
    double squares; /* how far they lie from their squares' medians */
} search;

/* Puts a value among `count` ascending ones. */
static void put_sorted(float *sorted, int count, float value)
{
    int at = count;
    for (; at > 0 && sorted[at - 1] > value; at--)
        sorted[at] = sorted[at - 1];
    sorted[at] = value;
}

/* How far a bad pixel lies from the median; 0: it is none. Near a border the square lies beside the pixel rather than
 * around it. */
static float beyond_median(const search *of, int channel, int row, int col)
{
    const hada_pixels *frame = of->frame;
    const int step = of->step, reach = REACH * step;
    const int middle = middle_of(row, frame->rows, step, REACH);
    const int centre = middle_of(col, frame->cols, step, REACH);
    const int near_row = middle_of(row, frame->rows, step, 1);
    const int near_col = middle_of(col, frame->cols, step, 1);
    float square[SQUARE] = {0.0F}, nearest[AROUND] = {0.0F}, value = 0.0F, room, most = 0.0F, sum = 0.0F;
    float light = 0.0F, brightest = 0.0F;
    int count = 0, near = 0;
    for (int r = middle - reach; r <= middle + reach; r += step)
        for (int c = centre - reach; c <= centre + reach; c += step) {
            const size_t at = (size_t)r * (size_t)frame->cols + (size_t)c;
            const float other = *hada_pixels_floats(frame, channel, at, 1, &room);
            if (r == row && c == col) {
                value = other;
                continue;
            }
            put_sorted(square, count++, other);
            if (abs(r - near_row) <= step && abs(c - near_col) <= step)
                nearest[near++] = other;
        }
    const float median = 0.5F * (square[SQUARE / 2 - 1] + square[SQUARE / 2]);
    for (int i = 0; i < near; i++) {
        const float beyond = fabsf(nearest[i] - median);
        sum += beyond;
        most = fmaxf(most, beyond);
        light += nearest[i] - median;
        brightest = fmaxf(brightest, nearest[i] - median);
    }
    if (of->alone && value - median < ALONE * (light - brightest - ALONE_NOISE * of->noise))
        return 0.0F;
    const float low = square[OMITTED], high = square[SQUARE - 1 - OMITTED], away = fabsf(value - median);
    return away > BEYOND_NEAREST * (sum - most) + BEYOND_NOISE * of->noise &&
                   fmaxf(value - high, low - value) > BEYOND_RANGE * (high - low)
               ? away
               : 0.0F;
}

static float noise_of(const search *of)
{
    const hada_pixels *frame = of->frame;
    const size_t cols = (size_t)frame->cols;
    float largest = 0.0F;
    for (int c = 0; c < frame->channels; c++)
        for (int row = 0; row < frame->rows; row++) {
            const float *values = hada_pixels_floats(frame, c, (size_t)row * cols, cols, of->rooms + 3 * cols);
            for (size_t i = 0; i < cols; i++)
                largest = fmaxf(largest, fabsf(values[i]));
        }
    return (float)fmax(hada_noise_estimate(frame, of->mosaic), LEAST_NOISE * (double)largest);
}

/* Whether a pixel may lie beyond the four nearest ones. */
static int may_be_bad(const float *const rows[3], int col, int step)
{
    const float value = rows[1][col], a = fminf(rows[0][col], rows[2][col]), b = fmaxf(rows[0][col], rows[2][col]),
                c = fminf(rows[1][col - step], rows[1][col + step]),
                d = fmaxf(rows[1][col - step], rows[1][col + step]);
    const float least = fminf(a, c), low = fminf(fmaxf(a, c), fminf(b, d)), high = fmaxf(fmaxf(a, c), fminf(b, d)),
                most = fmaxf(b, d);
    return value - high > BEYOND_THREE * (high - least) || low - value > BEYOND_THREE * (most - low);
}

/* Adds the bad pixels of a row. Returns 0 where there are too many. */
static int look_along(search *of, int channel, int row)
{
    const int step = of->step, cols = of->frame->cols, inside = row >= step && row < of->frame->rows - step;
    const float *rows[3] = {NULL};
    for (int k = 0; k < 3 && inside; k++)
        rows[k] = hada_pixels_floats(of->frame, channel, (size_t)(row + (k - 1) * step) * (size_t)cols, (size_t)cols,
                                     of->rooms + (size_t)k * (size_t)cols);
    for (int col = 0; col < cols; col++) {
        if (inside && col >= step && col < cols - step && !may_be_bad(rows, col, step))
            continue;
        if (of->noise < 0.0F)
            of->noise = noise_of(of);
        const float beyond = beyond_median(of, channel, row, col);
        if (beyond <= 0.0F)
            continue;
        if (of->count == of->most)
            return 0;
        of->squares += (double)beyond * (double)beyond;
        of->list[of->count++] = ((size_t)channel * (size_t)of->frame->rows + (size_t)row) * (size_t)cols + (size_t)col;
    }
    return 1;
}

hada_status hada_bad_pixels_find(const hada_pixels *frame, hada_mosaic mosaic, int alone, size_t **list, size_t *count,
                                 hada_error *err)
{
    const size_t cols = (size_t)frame->cols, values = (size_t)frame->channels * (size_t)frame->rows * cols;
    search of = {.frame = frame, .mosaic = mosaic, .alone = alone, .noise = -1.0F};
    hada_status status = HADA_OK;
    int few = 1;
    of.step = mosaic == HADA_MOSAIC_NONE ? 1 : 2;
    of.most = (size_t)(MOST_BAD * (double)values);
    if (frame->rows < SIDE * of.step || frame->cols < SIDE * of.step)
        goto done;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(of.rooms, 4 * cols, "bad pixels", err));
    HADA_TRY_OR_DONE(HADA_NEW_RAW(of.list, of.most + 1, "bad pixels", err));
    for (int c = 0; c < frame->channels && few; c++)
        for (int row = 0; row < frame->rows && few; row++)
            few = look_along(&of, c, row);
    if (!alone && of.squares < LEAST_SQUARES * (double)values * (double)of.noise * (double)of.noise)
        of.count = 0;
done:
    if (status || !few || !of.count) {
        free(of.list);
        of.list = NULL;
        of.count = 0;
    }
    free(of.rooms);
    *list = of.list;
    *count = of.count;
    return status;
}
