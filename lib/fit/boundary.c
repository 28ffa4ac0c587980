/* Whether light leaves the sensor, and the smallest grid that suffices: from a few pairs, before a fit. */

#include "fit/look.h"

/* By this share more may be left of held-out frames on a smaller grid, 20 decibels below the noise; and so many times
 * the standard deviation of what is left, which counts where frames are small. */
#define MOST_GROWTH 0.01
#define DEVIATIONS  2.0

/* Two pairs of a depth: one is learned from alone, which leaves much that neither grid settles. Where light stays
 * inside, the largest grid leaves nearly what the sensor's leaves, at all distances; where it leaves the sensor, less
 * at some distances, or more by far, for one pair does not settle what lies outside (perf/results/learning.md). */
enum { FEW_PAIRS = HADA_LOOK_LEAST, FEW_DEPTHS = 3 };
#define LEAST_RATIO 0.93
#define MOST_RATIO  1.4

/* What may be left where the largest grid leaves so much: squares of Gaussian noise have a variance of 2. */
static double most_of(const hada_look *at, double left)
{
    const double pixels = (double)at->held * at->options->raw_rows * at->options->raw_cols;
    return left * (1.0 + MOST_GROWTH + DEVIATIONS * sqrt(2.0 / pixels));
}

/* Rows, and then columns: the smallest grid that leaves as little as the largest one so far does. */
static hada_status shrink(const hada_look *at, double most, int *rows, int *cols, hada_error *err)
{
    const hada_fit_options *options = at->options;
    double left = 0.0;
    for (int side = 0; side < 2; side++) {
        int *size = side ? cols : rows;
        const int whole = *size;
        int tried = 0;
        for (int k = 0; k < HADA_OVERHANGS; k++) {
            *size = side ? hada_look_side(options->raw_cols, options->window_cols, k)
                         : hada_look_side(options->raw_rows, options->window_rows, k);
            if (*size >= whole)
                break;
            if (*size == tried)
                continue;
            tried = *size;
            HADA_TRY(hada_look_left(at, *rows, *cols, &left, err));
            if (left <= most)
                break;
        }
        *size = *size < whole ? *size : whole;
    }
    return HADA_OK;
}

/* Takes pairs; what is left of those held out on the largest grid, of rows x cols, and on the sensor's. */
static hada_status compare(hada_look *at, const hada_dataset *pairs, int rows, int cols, double *largest,
                           double *inside, hada_error *err)
{
    hada_look_return(at);
    HADA_TRY(hada_look_take(at, pairs, err));
    HADA_TRY(hada_look_left(at, rows, cols, largest, err));
    return hada_look_left(at, at->options->raw_rows, at->options->raw_cols, inside, err);
}

/* The smallest grid that suffices, from the largest one on; from a depth with more than two pairs. */
static hada_status search(hada_look *at, const hada_dataset *pairs, int *rows, int *cols, hada_error *err)
{
    const hada_fit_options *options = at->options;
    double inside = 0.0, left = 0.0;
    HADA_TRY(compare(at, pairs, *rows, *cols, &left, &inside, err));
    if (inside <= most_of(at, left)) {
        *rows = options->raw_rows;
        *cols = options->raw_cols;
        return HADA_OK;
    }
    return shrink(at, most_of(at, left), rows, cols, err);
}

/* The same from two pairs of a depth: the sensor's grid if light stays inside whichever pair is held out, at all
 * distances. Otherwise the largest: any smaller one would seem better because it has less to learn. */
static hada_status search_few(hada_look *at, const hada_dataset *pairs, int *rows, int *cols, hada_error *err)
{
    const hada_fit_options *options = at->options;
    const int nearest = at->depth, depths = options->depths - nearest, looked = hada_least(depths, FEW_DEPTHS);
    for (int k = 0; k < looked; k++) {
        at->depth = nearest + hada_spread(k, looked, depths);
        if (hada_dataset_get_info(pairs)->counts[at->depth] < HADA_LOOK_LEAST)
            continue;
        for (at->first = 0; at->first < HADA_LOOK_LEAST; at->first++) {
            double inside = 0.0, left = 0.0;
            HADA_TRY(compare(at, pairs, *rows, *cols, &left, &inside, err));
            if (left < LEAST_RATIO * inside || left > MOST_RATIO * inside)
                return HADA_OK;
        }
    }
    *rows = options->raw_rows;
    *cols = options->raw_cols;
    return HADA_OK;
}

hada_status hada_fit_sizes_from(hada_fit_options *options, const hada_dataset *pairs, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(pairs);
    hada_pair pair;
    int z = 0;
    while (z < info->depths && !info->counts[z])
        z++;
    if (z == info->depths)
        return hada_fail(err, HADA_ERROR_DATASET, "the data set has no pair to learn from");
    HADA_TRY(hada_pair_take(&pair, pairs, z, 0, err));
    const int rows = pair.raw->rows, cols = pair.raw->cols;
    const int scene_rows = pair.scene->rows, scene_cols = pair.scene->cols;
    options->depths = info->depths;
    options->distances_mm = info->distances_mm;
    options->channels = pair.raw->channels;
    options->mosaic = info->mosaic;
    options->downsample = info->downsample;
    options->sensor_mosaic = info->sensor_mosaic;
    hada_pair_return(&pair);
    options->raw_rows = rows;
    options->raw_cols = cols;
    if (!options->window_rows) {
        options->window_rows = scene_rows;
        options->window_cols = scene_cols;
    }
    if ((options->window_rows != scene_rows || options->window_cols != scene_cols) &&
        (scene_rows != rows || scene_cols != cols))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.window %dx%d: the scenes have %dx%d pixels, which is the window then; a smaller one "
                         "can be cut only from scenes as large as the frame (%dx%d)",
                         options->window_rows, options->window_cols, scene_rows, scene_cols, rows, cols);
    return HADA_OK;
}

hada_status hada_fit_find_boundary(hada_fit_options *callers, hada_context *context, const hada_dataset *pairs,
                                   hada_error *err)
{
    hada_fit_options options;
    hada_look at = {.context = context, .options = &options, .coarse = 1};
    int rows = 0, cols = 0;
    hada_status status = HADA_OK;
    HADA_NEED(callers && context && pairs, err);
    hada_fit_options_init(&options);
    HADA_TRY(HADA_OPTIONS_TAKE(&options, callers, hada_fit_options, err));
    HADA_TRY(hada_fit_sizes_from(&options, pairs, err));
    at.depth = hada_look_depth(&options, pairs);
    options.boundary = HADA_BOUNDARY_PADDED;
    options.grid_rows = options.grid_cols = 0;
    if (at.depth < options.depths) {
        hada_look_whole(&options, &rows, &cols);
        const int few = hada_dataset_get_info(pairs)->counts[at.depth] == HADA_LOOK_LEAST;
        HADA_TRY_OR_DONE((few ? search_few : search)(&at, pairs, &rows, &cols, err));
        const int inside = rows == options.raw_rows && cols == options.raw_cols;
        options.boundary = inside ? HADA_BOUNDARY_CIRCULAR : HADA_BOUNDARY_PADDED;
        options.grid_rows = inside ? 0 : hada_fft_good_size(rows);
        options.grid_cols = inside ? 0 : hada_fft_good_size(cols);
    }
    HADA_REPORT_GIVE(callers, &options);
done:
    hada_look_return(&at);
    return status;
}
