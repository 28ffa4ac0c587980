/* Whether light leaves the sensor, and the smallest grid that serves: a look at a few pairs before a fit. */
#include <math.h>

#include "core/callers.h"
#include "fit/fitter.h"

/* Pairs that are learned from at most, those held out beside them, and iterations, fewer than for a model: what is
 * asked is which of two grids explains more (docs/explanation/learning-a-camera.md). */
enum { LEARNED = 8, MOST_HELD = 2, MANY_PAIRS = 4, PASSES = 9 };

/* By this share more may be left of held-out frames on a smaller grid, 20 decibels below the noise; and so many times
 * the standard deviation of what is left, which counts where frames are small. */
#define MOST_GROWTH 0.01
#define DEVIATIONS  2.0

/* Shares of a window that may stand over the sensor's edge and be told from what stands over the other one. */
static const double overhangs[] = {0.0, 0.25, 0.5, 0.75, 1.0};
enum { OVERHANGS = HADA_COUNT(overhangs) };

/* The pairs of a depth, as they are looked at. */
typedef struct look {
    hada_context *context;
    const hada_fit_options *options;
    hada_fit_show show;
    void *user;
    int depth, channel, held;
    int64_t count, pairs;  /* of the depth, and those taken of it: the last ones are held out */
    hada_image raw, scene; /* a channel of the pair that is shown; not owned */
} look;

static hada_image channel_of(const hada_image *image, int channel)
{
    const size_t area = (size_t)image->rows * (size_t)image->cols;
    return (hada_image){1, image->rows, image->cols, image->data + (size_t)channel * area};
}

/* One channel of the pairs that are taken, which are spread over all. */
static hada_status show_channel(void *user, int depth, int64_t pair, const hada_image **raw, const hada_image **scene,
                                hada_error *err)
{
    look *at = user;
    const hada_image *whole_raw = NULL, *whole_scene = NULL;
    (void)depth;
    HADA_TRY(at->show(at->user, at->depth, pair * at->count / at->pairs, &whole_raw, &whole_scene, err));
    if (!whole_raw || !whole_scene || whole_raw->channels <= at->channel || whole_scene->channels <= at->channel)
        return hada_fail(err, HADA_ERROR_SIZE, "raw frames and scenes of a data set must have the same channels");
    at->raw = channel_of(whole_raw, at->channel);
    at->scene = channel_of(whole_scene, at->channel);
    *raw = &at->raw;
    *scene = &at->scene;
    return HADA_OK;
}

/* What is left of the frames held out, learned on a grid of rows x cols. */
static hada_status left_on(look *at, int rows, int cols, double *left, hada_error *err)
{
    hada_fit_options options = *at->options;
    hada_fitter *fitter = NULL;
    const hada_image *raw = NULL, *scene = NULL;
    hada_status status = HADA_OK;
    options.depths = options.channels = 1;
    options.distances_mm = at->options->distances_mm + at->depth;
    options.boundary =
        rows == options.raw_rows && cols == options.raw_cols ? HADA_BOUNDARY_CIRCULAR : HADA_BOUNDARY_PADDED;
    options.form = HADA_FORM_COMPLEX;
    options.grid_rows = rows;
    options.grid_cols = cols;
    options.refine_steps = 0;
    HADA_TRY_OR_DONE(hada_fitter_create(&fitter, at->context, &options, err));
    for (int64_t i = 0; i < at->pairs - at->held; i++) {
        HADA_TRY_OR_DONE(show_channel(at, 0, i, &raw, &scene, err));
        HADA_TRY_OR_DONE(hada_fitter_add(fitter, 0, raw, scene, err));
    }
    hada_slot_watch(fitter->grid.slot, options.monitor);
    HADA_TRY_OR_DONE(
        hada_fit_transfers_left(&fitter->sums, &fitter->pair, PASSES, at->held, show_channel, at, left, err));
done:
    hada_fitter_destroy(&fitter);
    return status;
}

static int with_overhang(int raw, int window, int k)
{
    const int over = (int)(overhangs[k] * (window - 1));
    return over ? hada_fft_good_size(raw + over) : raw;
}

/* What may be left where the largest grid leaves so much: squares of Gaussian noise have a variance of 2. */
static double most_of(const look *at, double left)
{
    const double pixels = (double)at->held * at->options->raw_rows * at->options->raw_cols;
    return left * (1.0 + MOST_GROWTH + DEVIATIONS * sqrt(2.0 / pixels));
}

/* Rows, and then columns: the smallest grid that leaves as little as the largest one so far does. */
static hada_status shrink(look *at, double most, int *rows, int *cols, hada_error *err)
{
    const hada_fit_options *options = at->options;
    double left = 0.0;
    for (int side = 0; side < 2; side++) {
        int *size = side ? cols : rows;
        const int whole = *size;
        int tried = 0;
        for (int k = 0; k < OVERHANGS; k++) {
            *size = side ? with_overhang(options->raw_cols, options->window_cols, k)
                         : with_overhang(options->raw_rows, options->window_rows, k);
            if (*size >= whole)
                break;
            if (*size == tried)
                continue;
            tried = *size;
            HADA_TRY(left_on(at, *rows, *cols, &left, err));
            if (left <= most)
                break;
        }
        *size = *size < whole ? *size : whole;
    }
    return HADA_OK;
}

static hada_status search(look *at, int *rows, int *cols, hada_error *err)
{
    const hada_fit_options *options = at->options;
    double inside = 0.0, left = 0.0;
    at->held = at->count >= MANY_PAIRS ? MOST_HELD : 1;
    at->pairs = at->count < LEARNED + at->held ? at->count : LEARNED + at->held;
    *rows = with_overhang(options->raw_rows, options->window_rows, OVERHANGS - 1);
    *cols = with_overhang(options->raw_cols, options->window_cols, OVERHANGS - 1);
    HADA_TRY(left_on(at, *rows, *cols, &left, err));
    HADA_TRY(left_on(at, options->raw_rows, options->raw_cols, &inside, err));
    if (inside <= most_of(at, left)) {
        *rows = options->raw_rows;
        *cols = options->raw_cols;
        return HADA_OK;
    }
    return shrink(at, most_of(at, left), rows, cols, err);
}

hada_status hada_fit_find_boundary(hada_fit_options *callers, hada_context *context, const int *counts,
                                   hada_fit_show show, void *user, hada_error *err)
{
    hada_fit_options options;
    look at = {.context = context, .options = &options, .show = show, .user = user};
    int rows = 0, cols = 0;
    if (!callers || !context || !counts || !show)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "hada_fit_find_boundary: options, a context, numbers of pairs and a function that shows pairs "
                         "are needed");
    HADA_TRY(HADA_OPTIONS_TAKE(&options, callers, hada_fit_options, err));
    at.channel = options.channels / 2;
    while (at.depth < options.depths && counts[at.depth] < 2)
        at.depth++;
    options.boundary = HADA_BOUNDARY_PADDED;
    options.grid_rows = options.grid_cols = 0;
    if (at.depth < options.depths) {
        at.count = counts[at.depth];
        HADA_TRY(search(&at, &rows, &cols, err));
        const int inside = rows == options.raw_rows && cols == options.raw_cols;
        options.boundary = inside ? HADA_BOUNDARY_CIRCULAR : HADA_BOUNDARY_PADDED;
        options.grid_rows = inside ? 0 : hada_fft_good_size(rows);
        options.grid_cols = inside ? 0 : hada_fft_good_size(cols);
    }
    HADA_REPORT_GIVE(callers, &options);
    return HADA_OK;
}
