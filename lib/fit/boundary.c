/* Whether light leaves the sensor, and the smallest grid that suffices: from a few pairs, before a fit. On such a grid,
 * the dark level and the response of the scenes more precisely, and whether exposures differ. */

#include "core/callers.h"
#include "fit/fitter.h"

/* Pairs that are learned from at most, those held out beside them, and iterations: fewer than for a model, as only two
 * grids are compared (docs/explanation/learning-a-camera.md). */
enum { LEARNED = 8, MOST_HELD = 2, MANY_PAIRS = 4, PASSES = 9 };
#define WHY "looks at pairs, for boundary, response and dark level"

/* By this share more may be left of held-out frames on a smaller grid, 20 decibels below the noise; and so many times
 * the standard deviation of what is left, which counts where frames are small. */
#define MOST_GROWTH 0.01
#define DEVIATIONS  2.0

/* Two pairs of a depth: one is learned from alone, which leaves much that neither grid settles. Where light stays
 * inside, the largest grid leaves nearly what the sensor's leaves, at all distances; where it leaves the sensor, less
 * at some distances, or more by far, for one pair does not settle what lies outside (perf/results/learning.md). */
enum { FEW_PAIRS = 2, FEW_DEPTHS = 3 };
#define LEAST_RATIO 0.93
#define MOST_RATIO  1.4

/* The dark level is the least of a parabola through what is left with it and, this share of it apart, two others; it
 * changes by MOST_STEPS such steps. */
#define DARK_STEP  0.1
#define MOST_STEPS 5.0

/* Another response than the survey's must leave so much less of held-out frames: than linear, than others, and where
 * the pairs gave the dark level as well, which a power nearly makes up for. */
#define SURE           0.7
#define NEARLY_SURE    0.97
#define SURE_WITH_DARK 0.5

/* Shares of a window beyond the sensor's edge that are tried, so that its two edges can still be distinguished. */
static const double overhangs[] = {0.0, 0.25, 0.5, 0.75, 1.0};
enum { OVERHANGS = HADA_COUNT(overhangs) };

/* One channel of a few pairs of a depth, which are spread over all; the last ones are held out. */
typedef struct look {
    hada_context *context;
    const hada_fit_options *options;
    int depth, first, count, held; /* first: the number of the pair that comes first */
    hada_pair pair[LEARNED + MOST_HELD];
    hada_image raw[LEARNED + MOST_HELD], scene[LEARNED + MOST_HELD]; /* their channels, not owned */
    hada_dataset *learned, *held_out;
} look;

static hada_image channel_of(const hada_image *image, int channel)
{
    const size_t area = (size_t)image->rows * (size_t)image->cols;
    return (hada_image){1, image->rows, image->cols, image->data + (size_t)channel * area};
}

static hada_status take_pairs(look *at, const hada_dataset *pairs, hada_error *err)
{
    const double *distance = &at->options->distances_mm[at->depth];
    const int all = hada_dataset_get_info(pairs)->counts[at->depth], channel = at->options->channels / 2;
    at->held = all >= MANY_PAIRS ? MOST_HELD : 1;
    const int count = all < LEARNED + at->held ? all : LEARNED + at->held, learned = count - at->held;
    for (; at->count < count; at->count++) {
        const int number = (int)(((long)at->count * all / count + at->first) % all);
        hada_pair *pair = &at->pair[at->count];
        HADA_TRY(hada_pair_take(pair, pairs, at->depth, number, err));
        if (pair->raw->channels <= channel || pair->scene->channels <= channel) {
            hada_pair_return(pair);
            const hada_status status =
                hada_fail(err, HADA_ERROR_SIZE, "raw frames and scenes of a data set must have the same channels");
            hada_pair_name(pairs, at->depth, number, err);
            return status;
        }
        at->raw[at->count] = channel_of(pair->raw, channel);
        at->scene[at->count] = channel_of(pair->scene, channel);
    }
    HADA_TRY(hada_dataset_from_images(&at->learned, 1, distance, &learned, at->raw, at->scene, err));
    return hada_dataset_from_images(&at->held_out, 1, distance, &at->held, at->raw + learned, at->scene + learned, err);
}

static void return_pairs(look *at)
{
    hada_dataset_destroy(&at->learned);
    hada_dataset_destroy(&at->held_out);
    while (at->count)
        hada_pair_return(&at->pair[--at->count]);
}

/* What is left of the frames held out, learned on a grid of rows x cols; 0: of the size that holds all light. */
static hada_status left_on(const look *at, int rows, int cols, double *left, hada_error *err)
{
    hada_fit_options options = *at->options;
    hada_fitter *fitter = NULL;
    hada_fit_reader from = {0}, held = {0};
    hada_status status = HADA_OK;
    options.depths = options.channels = 1;
    options.mosaic = options.sensor_mosaic = HADA_MOSAIC_NONE; /* of that channel */
    options.distances_mm = at->options->distances_mm + at->depth;
    options.boundary =
        rows == options.raw_rows && cols == options.raw_cols ? HADA_BOUNDARY_CIRCULAR : HADA_BOUNDARY_PADDED;
    options.form = HADA_FORM_COMPLEX;
    options.grid_rows = rows;
    options.grid_cols = cols;
    options.refine_steps = 0;
    options.communicator = NULL;
    options.sums = NULL;
    HADA_TRY_OR_DONE(hada_fitter_create(&fitter, at->context, &options, err));
    for (int i = 0; i < at->count - at->held; i++)
        HADA_TRY_OR_DONE(hada_fitter_add_pair(fitter, 0, &at->raw[i], &at->scene[i], err));
    HADA_TRY_OR_DONE(hada_fit_reader_create(&from, at->learned, &fitter->pair, options.monitor, WHY, err));
    HADA_TRY_OR_DONE(hada_fit_reader_create(&held, at->held_out, &fitter->pair, NULL, WHY, err));
    hada_slot_watch(fitter->grid.slot, options.monitor);
    HADA_TRY_OR_DONE(hada_fit_transfers_left(&fitter->sums, &from, PASSES, &held, left, err));
done:
    hada_fit_reader_destroy(&from);
    hada_fit_reader_destroy(&held);
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
static hada_status shrink(const look *at, double most, int *rows, int *cols, hada_error *err)
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

/* Takes pairs; what is left of those held out on the largest grid, of rows x cols, and on the sensor's. */
static hada_status compare(look *at, const hada_dataset *pairs, int rows, int cols, double *largest, double *inside,
                           hada_error *err)
{
    return_pairs(at);
    HADA_TRY(take_pairs(at, pairs, err));
    HADA_TRY(left_on(at, rows, cols, largest, err));
    return left_on(at, at->options->raw_rows, at->options->raw_cols, inside, err);
}

/* The smallest grid that suffices, from the largest one on; from a depth with more than two pairs. */
static hada_status search(look *at, const hada_dataset *pairs, int *rows, int *cols, hada_error *err)
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
static hada_status search_few(look *at, const hada_dataset *pairs, int *rows, int *cols, hada_error *err)
{
    const hada_fit_options *options = at->options;
    const int nearest = at->depth, depths = options->depths - nearest, looked = hada_least(depths, FEW_DEPTHS);
    for (int k = 0; k < looked; k++) {
        at->depth = nearest + hada_spread(k, looked, depths);
        if (hada_dataset_get_info(pairs)->counts[at->depth] < FEW_PAIRS)
            continue;
        for (at->first = 0; at->first < FEW_PAIRS; at->first++) {
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

/* The first depth of which a pair can be held out; the number of depths if there is none. */
static int first_depth(const hada_fit_options *options, const hada_dataset *pairs)
{
    int z = 0;
    while (z < options->depths && hada_dataset_get_info(pairs)->counts[z] < FEW_PAIRS)
        z++;
    return z;
}

hada_status hada_fit_refine_dark(hada_fit_options *callers, hada_context *context, const hada_dataset *pairs,
                                 hada_error *err)
{
    hada_fit_options options = *callers;
    look at = {.context = context, .options = &options, .depth = first_depth(callers, pairs)};
    const hada_image *surface = hada_dataset_get_info(pairs)->dark_frame;
    const int circular = options.boundary == HADA_BOUNDARY_CIRCULAR;
    double left[3], step = DARK_STEP * callers->dark;
    hada_status status = HADA_OK;
    if (at.depth == options.depths)
        return HADA_OK;
    for (size_t i = 0; surface && i < hada_image_count(surface); i++)
        step += DARK_STEP * surface->data[i] / (double)hada_image_count(surface);
    HADA_TRY_OR_DONE(take_pairs(&at, pairs, err));
    for (int k = 0; k < 3; k++) {
        options.dark = callers->dark + step * (k - 1);
        HADA_TRY_OR_DONE(left_on(&at, circular ? options.raw_rows : options.grid_rows,
                                 circular ? options.raw_cols : options.grid_cols, &left[k], err));
    }
    const double steps = hada_parabola_top(-left[0], -left[1], -left[2]);
    callers->dark += step * fmin(fmax(steps, -MOST_STEPS), MOST_STEPS);
done:
    return_pairs(&at);
    return status;
}

/* Responses that are compared on the largest grid, exposures alike or apart. */
typedef struct confirming {
    look *at;
    hada_fit_options options; /* of `at` */
    const hada_survey *survey;
    const hada_dataset *pairs;
    int rows, apart;
    double *left; /* of each row; 0: not known yet */
} confirming;

/* The pairs exposed as a survey with that response says. */
static hada_status expose(const confirming *of, hada_dataset **even, hada_survey **exposures, hada_error *err)
{
    HADA_TRY(hada_survey_create(exposures, &of->options, of->pairs, HADA_EXPOSURE_EACH, err));
    return hada_survey_apply(even, *exposures, of->pairs, err);
}

static hada_status left_with(confirming *of, int row, hada_error *err)
{
    hada_fit_options *options = &of->options;
    const int circular = options->boundary == HADA_BOUNDARY_CIRCULAR;
    hada_dataset *even = NULL;
    hada_survey *exposures = NULL;
    hada_status status = HADA_OK;
    if (of->left[row] > 0.0)
        return HADA_OK;
    options->scene_response = of->survey->rows[row]->response;
    if (of->apart)
        HADA_TRY_OR_DONE(expose(of, &even, &exposures, err));
    return_pairs(of->at);
    HADA_TRY_OR_DONE(take_pairs(of->at, even ? even : of->pairs, err));
    HADA_TRY_OR_DONE(left_on(
        of->at, with_overhang(options->raw_rows, circular ? 1 : options->window_rows, OVERHANGS - 1),
        with_overhang(options->raw_cols, circular ? 1 : options->window_cols, OVERHANGS - 1), &of->left[row], err));
done:
    return_pairs(of->at);
    hada_dataset_destroy(&even);
    hada_survey_destroy(&exposures);
    return status;
}

/* The row that leaves least: of the chosen one and that which the survey's grid says, and on from the better one to
 * neighbours, until none leaves less. */
static hada_status find_row(confirming *of, int chosen, int *best, hada_error *err)
{
    *best = 0;
    for (int row = 1; row < of->rows; row++) {
        const hada_survey_row *one = of->survey->rows[row], *other = of->survey->rows[*best];
        if (of->apart ? one->unexplained_apart < other->unexplained_apart : one->unexplained < other->unexplained)
            *best = row;
    }
    HADA_TRY(left_with(of, chosen, err));
    HADA_TRY(left_with(of, *best, err));
    *best = of->left[chosen] < of->left[*best] ? chosen : *best;
    for (int before = -1; before != *best;) {
        before = *best;
        for (int row = hada_most(before - 1, 0); row <= hada_least(before + 1, of->rows - 1); row++) {
            HADA_TRY(left_with(of, row, err));
            *best = of->left[row] < of->left[*best] ? row : *best;
        }
    }
    return HADA_OK;
}

/* Looks for the best row, which the survey then has where it is sure; *least: what it leaves. */
static hada_status confirm(confirming *of, int apart, int chosen, int *row, double *least, hada_error *err)
{
    const double response = of->survey->rows[chosen]->response;
    const double sure = of->options.find_dark ? SURE_WITH_DARK : response == HADA_RESPONSE_LINEAR ? SURE : NEARLY_SURE;
    int best = chosen;
    of->apart = apart;
    memset(of->left, 0, (size_t)of->rows * sizeof *of->left);
    HADA_TRY(find_row(of, chosen, &best, err));
    *row = of->left[best] < sure * of->left[chosen] ? best : chosen;
    *least = of->left[best];
    return HADA_OK;
}

hada_status hada_fit_confirm_survey(hada_survey *survey, const hada_fit_options *fit, hada_exposure exposure,
                                    hada_context *context, const hada_dataset *pairs, hada_error *err)
{
    confirming of = {.options = *fit, .survey = survey, .pairs = pairs};
    look at = {.context = context, .options = &of.options, .depth = first_depth(fit, pairs)};
    hada_survey *exposures = NULL;
    int chosen = 0, alike = 0, apart = 0;
    double left_alike = INFINITY, left_apart = INFINITY;
    hada_status status = HADA_OK;
    of.at = &at;
    for (; survey->rows[of.rows]; of.rows++)
        chosen = survey->rows[of.rows]->chosen ? of.rows : chosen;
    if (at.depth == of.options.depths || (of.rows == 1 && (!survey->exposed || exposure == HADA_EXPOSURE_EACH)))
        return HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(of.left, (size_t)of.rows, "responses", err));
    if (exposure != HADA_EXPOSURE_EACH)
        HADA_TRY_OR_DONE(confirm(&of, 0, chosen, &alike, &left_alike, err));
    if (survey->exposed)
        HADA_TRY_OR_DONE(confirm(&of, 1, chosen, &apart, &left_apart, err));
    if (left_apart < SURE * left_alike) {
        of.options.scene_response = survey->rows[apart]->response;
        HADA_TRY_OR_DONE(hada_survey_create(&exposures, &of.options, pairs, HADA_EXPOSURE_EACH, err));
        hada_survey_choose(survey, survey->rows[apart], exposures);
    } else {
        hada_survey_choose(survey, survey->rows[alike], NULL);
    }
done:
    free(of.left);
    hada_survey_destroy(&exposures);
    return_pairs(&at);
    return status;
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
    look at = {.context = context, .options = &options};
    int rows = 0, cols = 0;
    hada_status status = HADA_OK;
    HADA_NEED(callers && context && pairs, err);
    hada_fit_options_init(&options);
    HADA_TRY(HADA_OPTIONS_TAKE(&options, callers, hada_fit_options, err));
    HADA_TRY(hada_fit_sizes_from(&options, pairs, err));
    at.depth = first_depth(&options, pairs);
    options.boundary = HADA_BOUNDARY_PADDED;
    options.grid_rows = options.grid_cols = 0;
    if (at.depth < options.depths) {
        rows = with_overhang(options.raw_rows, options.window_rows, OVERHANGS - 1);
        cols = with_overhang(options.raw_cols, options.window_cols, OVERHANGS - 1);
        const int few = hada_dataset_get_info(pairs)->counts[at.depth] == FEW_PAIRS;
        HADA_TRY_OR_DONE((few ? search_few : search)(&at, pairs, &rows, &cols, err));
        const int inside = rows == options.raw_rows && cols == options.raw_cols;
        options.boundary = inside ? HADA_BOUNDARY_CIRCULAR : HADA_BOUNDARY_PADDED;
        options.grid_rows = inside ? 0 : hada_fft_good_size(rows);
        options.grid_cols = inside ? 0 : hada_fft_good_size(cols);
    }
    HADA_REPORT_GIVE(callers, &options);
done:
    return_pairs(&at);
    return status;
}
