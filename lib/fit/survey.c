/* What pairs say before a fit: the frames' dark level, the response of the scenes, and exposures that differ. */
#include <hadalens/survey.h>

#include "core/callers.h"
#include "dataset/dataset.h"
#include "fit/fitter.h"
#include "fit/pair_level.h"
#include "image/statistics.h"

/* Pairs that are looked at: of the nearest, the middle and the farthest depth. Fewer than LEAST of a depth leave none
 * to learn from when one is held out. */
enum { DEPTHS = 3, PAIRS_EACH = 6, MOST_PAIRS = DEPTHS * PAIRS_EACH, LEAST = 2 };
/* Of a depth, pairs from which exposures are found; further ones are held against these. */
enum { EXPOSED_TOGETHER = 32 };

/* From nothing to what displays and cameras use, and beyond; pairs showed exponents a tenth apart. */
static const double responses[] = {HADA_RESPONSE_LINEAR, 1.25, 1.5, 1.8, 2.0, HADA_RESPONSE_SRGB, 2.2, 2.6};
enum { RESPONSES = sizeof responses / sizeof *responses };

/* Another response than linear must leave less unexplained by about this share (a difference of logarithms), and by so
 * many standard errors of the difference over pairs. */
#define BETTER_BY     0.1
#define BETTER_ERRORS 2.0
/* The same where the pairs gave the dark level as well, which a power nearly makes up for: FlatCam, from three pairs,
 * leaves 1.6 times less with 1.5 than linear and is 4 dB worse. */
#define DARK_RESPONSE 0.7
/* Exposures are taken apart where that leaves less than this share of what is unexplained otherwise. On frames that
 * were exposed alike it takes off a few percent, on those exposed by a factor of two it left a fiftieth. */
#define APART_BELOW 0.5

/* Dark levels are tried in so many steps up to the darkest place of all frames, then between the best one's neighbours;
 * below LEAST_DARK of full scale none is looked for. A level must leave less of the frames by this factor, by
 * BETTER_ERRORS (perf/results/learning.md). */
enum { LEVELS = 6, SECTIONS = 10, DARK_RESPONSES = 3 };
#define LEAST_DARK  1e-3
#define DARK_BETTER 1.5
static const double dark_responses[DARK_RESPONSES] = {HADA_RESPONSE_LINEAR, 1.5, HADA_RESPONSE_SRGB};

/* Shares below this, of frames without noise, count as this. */
#define LEAST_SHARE 1e-9

/* A survey and what it points to. */
typedef struct owned_survey {
    hada_survey survey;
    hada_survey_row row[RESPONSES];
    const hada_survey_row *list[RESPONSES + 1];
    int depths;
    double **gain; /* of each depth; NULL: exposures are alike */
} owned_survey;

/* The work of a survey. */
typedef struct surveying {
    hada_fit_options options;
    const hada_dataset *pairs;
    const int *counts; /* pairs of each depth */
    hada_progress progress;
    hada_reducer reducer;
    int tried; /* responses: 1 where it is given; 0: frames alone are looked at */
    const double *response;
    hada_pair_level level;
    int count, depth[MOST_PAIRS];
    double noise[MOST_PAIRS]; /* of a reduced pixel, where frames alone are looked at */
    double dark;              /* taken off the frames */
    hada_image frame[MOST_PAIRS], scene[MOST_PAIRS][RESPONSES];
    double unexplained[RESPONSES][2][MOST_PAIRS]; /* exposures alike, and apart */
} surveying;

/* Reads pair number `pair` of a depth, its scene in all responses tried. */
static hada_status take_pair(surveying *work, int depth, int pair, hada_error *err)
{
    const hada_fit_options *options = &work->options;
    hada_pair taken = {0};
    hada_pixels pixels = {.size = sizeof pixels, .full_scale = HADA_AUTO};
    hada_status status = HADA_OK;
    if (!work->progress.what)
        work->progress = hada_progress_begin(options->monitor, "looks at pairs, for dark level and response", 0);
    HADA_TRY(hada_progress_step(&work->progress, NULL, err));
    HADA_TRY(hada_pair_take(&taken, work->pairs, depth, pair, err));
    if (!hada_reducer_fits(&work->reducer, taken.raw, taken.scene))
        goto done;
    HADA_TRY_OR_DONE(hada_reduce_frame(&work->reducer, taken.raw, &work->frame[work->count], err));
    if (!work->tried) {
        hada_pixels_of_image(&pixels, taken.raw);
        work->noise[work->count] = hada_noise_estimate(&pixels, options->mosaic) / work->reducer.factor;
    }
    work->depth[work->count] = depth;
    work->count++; /* from here on it is freed */
    for (int r = 0; r < work->tried; r++)
        HADA_TRY_OR_DONE(
            hada_reduce_scene(&work->reducer, taken.scene, work->response[r], &work->scene[work->count - 1][r], err));
done:
    hada_pair_return(&taken);
    return status;
}

static void forget_pairs(surveying *work)
{
    for (int k = 0; k < work->count; k++) {
        hada_image_destroy(&work->frame[k]);
        for (int r = 0; r < work->tried; r++)
            hada_image_destroy(&work->scene[k][r]);
    }
    work->count = 0;
}

/* Up to PAIRS_EACH pairs, evenly spread, of the depths that are looked at. */
static hada_status take_pairs(surveying *work, hada_error *err)
{
    const int depths = work->options.depths, looked = hada_least(depths, DEPTHS);
    for (int k = 0; k < looked; k++) {
        const int z = hada_spread(k, looked, depths), all = work->counts[z];
        const int count = all < LEAST ? 0 : hada_least(all, PAIRS_EACH);
        for (int i = 0; i < count; i++)
            HADA_TRY(take_pair(work, z, (int)((long)i * all / count), err));
    }
    return HADA_OK;
}

static hada_status begin(surveying *work, hada_error *err)
{
    HADA_TRY(hada_reducer_create(&work->reducer, &work->options, err));
    HADA_TRY(hada_pair_level_create(&work->level, work->reducer.grid, work->options.channels, MOST_PAIRS, err));
    return take_pairs(work, err);
}

static void end(surveying *work)
{
    if (work->progress.what)
        hada_progress_end(&work->progress);
    forget_pairs(work);
    hada_pair_level_destroy(&work->level);
    hada_reducer_destroy(&work->reducer);
}

static void compare(surveying *work)
{
    double gain[MOST_PAIRS], room[MOST_PAIRS];
    for (int r = 0; r < work->tried; r++) {
        for (int k = 0; k < work->count; k++) {
            hada_pair_level_put(&work->level, k, work->depth[k], &work->frame[k], &work->scene[k][r]);
            gain[k] = 1.0;
        }
        hada_pair_level_judge(&work->level, gain, 0, work->unexplained[r][0], NULL);
        hada_pair_level_expose(&work->level, gain, work->unexplained[r][1], room);
    }
}

/* The geometric mean: shares of one response differ by ten from pair to pair, and their mean is that of the worst. */
static double mean_of(const double *shares, int count)
{
    double sum = 0.0;
    for (int k = 0; k < count; k++)
        sum += log(fmax(shares[k], LEAST_SHARE)) / count;
    return exp(sum);
}

/* Whether so much less is left (a logarithm of each pair), surely. */
static int is_better(const double *less, int count, double by)
{
    double gain = 0.0, spread = 0.0;
    for (int k = 0; k < count; k++)
        gain += less[k] / count;
    for (int k = 0; k < count; k++)
        spread += (less[k] - gain) * (less[k] - gain);
    return gain > by && gain > BETTER_ERRORS * sqrt(spread / ((double)count * fmax(1.0, count - 1.0)));
}

/* The response with the least share, exposures alike (0) or apart (1); the first one, linear, unless there is
 * evidence. */
static int best_response(const surveying *work, int apart)
{
    int best = 0;
    for (int r = 1; r < work->tried; r++)
        if (mean_of(work->unexplained[r][apart], work->count) < mean_of(work->unexplained[best][apart], work->count))
            best = r;
    const double *linear = work->unexplained[0][apart], *other = work->unexplained[best][apart];
    double less[MOST_PAIRS];
    for (int k = 0; k < work->count; k++)
        less[k] = log(fmax(linear[k], LEAST_SHARE) / fmax(other[k], LEAST_SHARE));
    const int found_dark = work->options.find_dark && work->options.dark > 0.0;
    return is_better(less, work->count, found_dark ? DARK_RESPONSE : BETTER_BY) ? best : 0;
}

/* Fills the rows; returns whether exposures are to be taken apart. */
static int choose(owned_survey *own, const surveying *work, hada_exposure exposure)
{
    const int alike = best_response(work, 0), apart = best_response(work, 1);
    const int exposed =
        exposure == HADA_EXPOSURE_EACH ||
        (exposure == HADA_EXPOSURE_AUTO && mean_of(work->unexplained[apart][1], work->count) <
                                               APART_BELOW * mean_of(work->unexplained[alike][0], work->count));
    const int chosen = exposed ? apart : alike;
    own->survey.response = work->response[chosen];
    for (int r = 0; r < work->tried; r++) {
        own->row[r] = (hada_survey_row){.response = work->response[r],
                                        .unexplained = mean_of(work->unexplained[r][0], work->count),
                                        .unexplained_apart = mean_of(work->unexplained[r][1], work->count),
                                        .chosen = r == chosen};
        own->list[r] = &own->row[r];
    }
    return exposed;
}

/* Exposures of all pairs of a depth, which are 1 to begin with: some together, each further one against these. */
static hada_status expose_depth(surveying *work, int z, double *exposure, hada_error *err)
{
    enum { PLACES = EXPOSED_TOGETHER + 1 };
    double gain[PLACES] = {0.0}, unexplained[PLACES], room[PLACES];
    int pair_at[PLACES], together = 0;
    hada_status status = HADA_OK;
    work->level.count = 0;
    for (int i = 0; i < work->counts[z]; i++) {
        if (i == EXPOSED_TOGETHER)
            hada_pair_level_expose(&work->level, gain, unexplained, room);
        forget_pairs(work);
        HADA_TRY_OR_DONE(take_pair(work, z, i, err));
        if (!work->count)
            continue;
        hada_pair_level_put(&work->level, together, z, &work->frame[0], &work->scene[0][0]);
        if (i < EXPOSED_TOGETHER) {
            pair_at[together++] = i;
        } else {
            gain[together] = 0.0;
            hada_pair_level_judge(&work->level, gain, 0, unexplained, room);
            exposure[i] = room[together] > 0.0 ? room[together] : 1.0;
        }
    }
    if (together < 2)
        goto done;
    if (work->counts[z] <= EXPOSED_TOGETHER)
        hada_pair_level_expose(&work->level, gain, unexplained, room);
    for (int k = 0; k < together; k++)
        exposure[pair_at[k]] = gain[k];
done:
    forget_pairs(work);
    return status;
}

static hada_status expose_all(owned_survey *own, surveying *work, hada_error *err)
{
    work->response = &own->survey.response;
    work->tried = 1;
    hada_pair_level_destroy(&work->level);
    HADA_TRY(
        hada_pair_level_create(&work->level, work->reducer.grid, work->options.channels, EXPOSED_TOGETHER + 1, err));
    HADA_TRY(HADA_NEW(own->gain, (size_t)own->depths, "exposures", err));
    for (int z = 0; z < own->depths; z++) {
        HADA_TRY(HADA_NEW(own->gain[z], (size_t)work->counts[z], "exposures", err));
        for (int i = 0; i < work->counts[z]; i++)
            own->gain[z][i] = 1.0;
        HADA_TRY(expose_depth(work, z, own->gain[z], err));
    }
    own->survey.gains = (const double *const *)own->gain;
    return HADA_OK;
}

static hada_status make(owned_survey *own, surveying *work, hada_exposure exposure, hada_error *err)
{
    const hada_fit_options *options = &work->options;
    hada_survey *survey = &own->survey;
    own->depths = options->depths;
    survey->rows = own->list;
    survey->response = options->scene_response == HADA_AUTO ? HADA_RESPONSE_LINEAR : options->scene_response;
    work->tried = options->scene_response == HADA_AUTO ? RESPONSES : 1;
    work->response = work->tried == 1 ? &options->scene_response : responses;
    HADA_TRY(begin(work, err));
    survey->exposed = exposure == HADA_EXPOSURE_EACH;
    if (work->count >= LEAST) {
        compare(work);
        survey->exposed = choose(own, work, exposure);
    }
    forget_pairs(work);
    return survey->exposed ? expose_all(own, work, err) : HADA_OK;
}

static hada_status check(const hada_fit_options *options, const hada_dataset_info *pairs, hada_error *err)
{
    if (options->depths != pairs->depths || options->channels < 1 || options->window_rows < 1 ||
        options->window_cols < 1 || options->window_rows > options->raw_rows ||
        options->window_cols > options->raw_cols)
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "hada_survey_create: the depths of the data set and the sizes of frames and windows are needed");
    if (options->scene_response != HADA_AUTO && !hada_response_is_known(options->scene_response))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the response of the scenes, %g, is none (hadalens/response.h)",
                         options->scene_response);
    return HADA_OK;
}

hada_status hada_survey_create(hada_survey **out, const hada_fit_options *callers, const hada_dataset *pairs,
                               hada_exposure exposure, hada_error *err)
{
    surveying work = {.pairs = pairs};
    owned_survey *own = NULL;
    hada_status status = HADA_OK;
    HADA_NEED(out && callers && pairs, err);
    *out = NULL;
    hada_fit_options_init(&work.options);
    HADA_TRY(HADA_OPTIONS_TAKE(&work.options, callers, hada_fit_options, err));
    HADA_TRY(check(&work.options, hada_dataset_get_info(pairs), err));
    work.counts = hada_dataset_get_info(pairs)->counts;
    HADA_TRY(HADA_NEW(own, 1, "a survey of pairs", err));
    *out = &own->survey;
    HADA_TRY_OR_DONE(make(own, &work, exposure, err));
done:
    end(&work);
    if (status)
        hada_survey_destroy(out);
    return status;
}

void hada_survey_destroy(hada_survey **pointer)
{
    owned_survey *own = pointer ? (owned_survey *)*pointer : NULL; /* its first member */
    if (!own)
        return;
    *pointer = NULL;
    for (int z = 0; own->gain && z < own->depths; z++)
        free(own->gain[z]);
    HADA_FREE(own->gain, own);
}

hada_status hada_survey_apply(hada_dataset **out, const hada_survey *survey, const hada_dataset *pairs, hada_error *err)
{
    HADA_NEED(out && survey && pairs, err);
    return hada_dataset_brighten(out, pairs, survey->gains, survey->response, err);
}

/* Of Gaussian noise one value in a hundred is so many standard deviations below the mean. */
#define FIRST_PERCENTILE 2.326

/* The darkest place of all frames: of each the first percentile of its reduced pixels, were they without noise. */
static double darkest(const surveying *work)
{
    double least = INFINITY;
    for (int k = 0; k < work->count; k++) {
        const hada_image *frame = &work->frame[k];
        const size_t area = (size_t)frame->rows * (size_t)frame->cols;
        for (size_t c = 0; c < (size_t)frame->channels; c++)
            least = fmin(least, hada_first_percentile(frame->data + c * area, area, work->reducer.room) +
                                    FIRST_PERCENTILE * work->noise[k]);
    }
    return least;
}

/* Logarithms of what is left of each frame less a level, with the response and exposures that leave least. */
typedef struct left_over {
    double level, log[MOST_PAIRS], mean;
} left_over;

static left_over try_level(surveying *work, double level)
{
    left_over best = {.level = level, .mean = INFINITY};
    for (int k = 0; k < work->count; k++)
        for (size_t i = 0; i < hada_image_count(&work->frame[k]); i++)
            work->frame[k].data[i] -= (float)(level - work->dark);
    work->dark = level;
    compare(work);
    for (int row = 0; row < 2 * work->tried; row++) {
        const double *shares = work->unexplained[row / 2][row % 2];
        left_over now = {.level = level};
        for (int k = 0; k < work->count; k++) {
            now.log[k] = log(fmax(shares[k], LEAST_SHARE) * work->level.frame_energy[k]);
            now.mean += now.log[k] / work->count;
        }
        best = now.mean < best.mean ? now : best;
    }
    return best;
}

/* By golden sections, after steps of one length. */
static left_over best_level(surveying *work, left_over none, double most)
{
    const double golden = 0.5 * (sqrt(5.0) - 1.0), step = most / LEVELS;
    left_over best = none;
    for (int i = 1; i <= LEVELS; i++) {
        const left_over now = try_level(work, i * step);
        best = now.mean < best.mean ? now : best;
    }
    double low = fmax(0.0, best.level - step), high = fmin(most, best.level + step);
    left_over left = try_level(work, high - golden * (high - low));
    left_over right = try_level(work, low + golden * (high - low));
    for (int i = 0; i < SECTIONS; i++)
        if (left.mean < right.mean) {
            high = right.level;
            right = left;
            left = try_level(work, high - golden * (high - low));
        } else {
            low = left.level;
            left = right;
            right = try_level(work, low + golden * (high - low));
        }
    best = left.mean < best.mean ? left : best;
    return right.mean < best.mean ? right : best;
}

/* The level where less is left of the frames with it, surely; otherwise 0. */
static double choose_level(surveying *work, double most)
{
    double less[MOST_PAIRS];
    const left_over none = try_level(work, 0.0), best = best_level(work, none, most);
    for (int k = 0; k < work->count; k++)
        less[k] = none.log[k] - best.log[k];
    return is_better(less, work->count, log(DARK_BETTER)) ? best.level : 0.0;
}

hada_status hada_fit_find_dark(hada_fit_options *options, const hada_dataset *pairs, hada_error *err)
{
    surveying work = {.options = *options, .pairs = pairs, .counts = hada_dataset_get_info(pairs)->counts};
    hada_status status = HADA_OK;
    if (options->dark != 0.0)
        options->find_dark = 0;
    if (!options->find_dark)
        return HADA_OK;
    HADA_TRY_OR_DONE(begin(&work, err));
    const double most = darkest(&work);
    if (work.count >= LEAST && most >= LEAST_DARK) {
        forget_pairs(&work);
        work.tried = options->scene_response == HADA_AUTO ? DARK_RESPONSES : 1;
        work.response = work.tried == 1 ? &options->scene_response : dark_responses;
        HADA_TRY_OR_DONE(take_pairs(&work, err));
        options->dark = choose_level(&work, most);
    }
    options->find_dark = options->dark > 0.0;
done:
    end(&work);
    return status;
}
