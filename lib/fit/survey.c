#include <hadalens/scene.h>
#include <hadalens/survey.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/callers.h"
#include "fit/survey_level.h"
#include "image/statistics.h"

/* Reduced frames have about so many pixels a side, and windows at least so many: where more were kept (60, 80, 135) the
 * same response had the least share, on simulated and on real pairs (docs/explanation/learning-a-camera.md). */
enum { FRAME_SIDE = 32, WINDOW_LEAST = 8 };
/* Pairs that are looked at: of the nearest, the middle and the farthest depth. Fewer than LEAST of a depth leave too
 * few to learn from when one is held out. */
enum { DEPTHS = 3, PAIRS_EACH = 6, MOST_PAIRS = DEPTHS * PAIRS_EACH, LEAST = 3 };
/* Of a depth, pairs from which exposures are found; further ones are held against these. */
enum { EXPOSED_TOGETHER = 32 };

/* From nothing to what displays and cameras use, and beyond; pairs told exponents a tenth apart. */
static const double responses[] = {HADA_RESPONSE_LINEAR, 1.25, 1.5, 1.8, 2.0, HADA_RESPONSE_SRGB, 2.2, 2.6};
enum { RESPONSES = sizeof responses / sizeof *responses };

/* Another response than linear must leave less unexplained by about this share (a difference of logarithms), and by so
 * many standard errors of the difference over pairs. */
#define BETTER_BY     0.1
#define BETTER_ERRORS 2.0
/* Exposures are taken apart where that leaves less than this share of what is unexplained otherwise. On frames that
 * were exposed alike it takes off a few percent, on those exposed by a factor of two it left a fiftieth. */
#define APART_BELOW 0.5

/* Shares below this, of frames without noise, count as this. */
#define LEAST_SHARE 1e-9

struct hada_survey {
    double response;
    hada_survey_row row[RESPONSES];
    int rows;
    int depths, *pairs;
    double **gain; /* of each depth; NULL: exposures are alike */
};

/* The work of a survey. */
typedef struct surveying {
    hada_fit_options options;
    const int *pairs;
    hada_fit_show show;
    void *user;
    int factor, grid; /* pixels that become one; a side of the small grid */
    int tried;        /* responses: 1 where it is given */
    const double *response;
    hada_survey_level level;
    int count, depth[MOST_PAIRS];
    hada_image frame[MOST_PAIRS], scene[MOST_PAIRS][RESPONSES];
    double unexplained[RESPONSES][2][MOST_PAIRS]; /* exposures alike, and apart */
    float *room;                                  /* a channel of a frame */
} surveying;

static int least(int a, int b)
{
    return a < b ? a : b;
}

/* A reduction that keeps some pixels of frame and window. */
static void choose_grid(surveying *work)
{
    const hada_fit_options *options = &work->options;
    const int frame = options->raw_rows > options->raw_cols ? options->raw_rows : options->raw_cols;
    const int window = options->window_rows > options->window_cols ? options->window_rows : options->window_cols;
    const int narrow = least(options->window_rows, options->window_cols);
    work->factor = least((frame + FRAME_SIDE - 1) / FRAME_SIDE, narrow / WINDOW_LEAST);
    work->factor = work->factor > 1 ? work->factor : 1;
    for (work->grid = 1; work->grid < (frame + window) / work->factor;)
        work->grid *= 2;
}

/* The centre of an image, cut to whole blocks of factor x factor pixels, to one pixel a block. */
static hada_status reduce(const surveying *work, const hada_image *image, int rows, int cols, double response,
                          hada_image *out, hada_error *err)
{
    const int high = rows / work->factor, wide = cols / work->factor;
    const int whole_rows = high * work->factor, whole_cols = wide * work->factor;
    hada_image centre = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_image_crop(&centre, image, (image->rows - whole_rows) / 2, (image->cols - whole_cols) / 2,
                                     whole_rows, whole_cols, err));
    hada_response_convert(centre.data, hada_image_count(&centre), response, HADA_RESPONSE_LINEAR);
    HADA_TRY_OR_DONE(hada_image_resize(out, &centre, high, wide, err));
done:
    hada_image_destroy(&centre);
    return status;
}

static hada_status reduce_frame(const surveying *work, const hada_image *raw, hada_image *out, hada_error *err)
{
    const hada_fit_options *options = &work->options;
    const size_t area = (size_t)raw->rows * (size_t)raw->cols;
    HADA_TRY(reduce(work, raw, raw->rows, raw->cols, HADA_RESPONSE_LINEAR, out, err));
    const size_t small = (size_t)out->rows * (size_t)out->cols;
    for (size_t c = 0; c < (size_t)out->channels; c++) {
        const double dark =
            options->dark < 0.0 ? hada_dark_estimate(raw->data + c * area, area, work->room) : options->dark;
        for (size_t i = 0; i < small; i++)
            out->data[c * small + i] -= (float)dark;
    }
    return HADA_OK;
}

/* Whether a pair is one that the fit will take. */
static int fits(const hada_fit_options *options, const hada_image *raw, const hada_image *scene)
{
    const int whole = scene->rows == options->raw_rows && scene->cols == options->raw_cols;
    const int window = scene->rows == options->window_rows && scene->cols == options->window_cols;
    return raw->channels == options->channels && raw->rows == options->raw_rows && raw->cols == options->raw_cols &&
           scene->channels == options->channels && (whole || window) && !hada_image_count_not_finite(raw) &&
           !hada_image_count_not_finite(scene);
}

/* Reads pair number `pair` of a depth, its scene in all responses tried. */
static hada_status take_pair(surveying *work, int depth, int pair, hada_error *err)
{
    const hada_fit_options *options = &work->options;
    const hada_image *raw, *scene;
    HADA_TRY(work->show(work->user, depth, pair, &raw, &scene, err));
    if (!fits(options, raw, scene))
        return HADA_OK;
    HADA_TRY(reduce_frame(work, raw, &work->frame[work->count], err));
    work->depth[work->count] = depth;
    work->count++; /* from here on it is freed */
    for (int r = 0; r < work->tried; r++)
        HADA_TRY(reduce(work, scene, options->window_rows, options->window_cols, work->response[r],
                        &work->scene[work->count - 1][r], err));
    return HADA_OK;
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
    const int depths = work->options.depths, looked = least(depths, DEPTHS);
    for (int k = 0; k < looked; k++) {
        const int z = looked == 1 ? 0 : k * (depths - 1) / (looked - 1), all = work->pairs[z];
        const int count = all < LEAST ? 0 : least(all, PAIRS_EACH);
        for (int i = 0; i < count; i++)
            HADA_TRY(take_pair(work, z, (int)((long)i * all / count), err));
    }
    return HADA_OK;
}

static void compare(surveying *work)
{
    double gain[MOST_PAIRS], room[MOST_PAIRS];
    for (int r = 0; r < work->tried; r++) {
        for (int k = 0; k < work->count; k++) {
            hada_survey_level_put(&work->level, k, work->depth[k], &work->frame[k], &work->scene[k][r]);
            gain[k] = 1.0;
        }
        hada_survey_level_judge(&work->level, gain, work->unexplained[r][0], NULL);
        hada_survey_level_expose(&work->level, gain, work->unexplained[r][1], room);
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

/* The response with the least share, exposures alike (0) or apart (1); the first one, linear, unless there is
 * evidence. */
static int best_response(const surveying *work, int apart)
{
    int best = 0;
    for (int r = 1; r < work->tried; r++)
        if (mean_of(work->unexplained[r][apart], work->count) < mean_of(work->unexplained[best][apart], work->count))
            best = r;
    const double *linear = work->unexplained[0][apart], *other = work->unexplained[best][apart];
    const double gain = log(mean_of(linear, work->count) / mean_of(other, work->count));
    double spread = 0.0;
    for (int k = 0; k < work->count; k++) {
        const double off = log(fmax(linear[k], LEAST_SHARE) / fmax(other[k], LEAST_SHARE)) - gain;
        spread += off * off;
    }
    const double error = sqrt(spread / ((double)work->count * fmax(1.0, work->count - 1.0)));
    return gain > BETTER_BY && gain > BETTER_ERRORS * error ? best : 0;
}

/* Fills the rows; returns whether exposures are to be taken apart. */
static int choose(hada_survey *survey, const surveying *work, hada_exposure exposure)
{
    const int alike = best_response(work, 0), apart = best_response(work, 1);
    const int exposed =
        exposure == HADA_EXPOSURE_EACH ||
        (exposure == HADA_EXPOSURE_AUTO && mean_of(work->unexplained[apart][1], work->count) <
                                               APART_BELOW * mean_of(work->unexplained[alike][0], work->count));
    const int chosen = exposed ? apart : alike;
    survey->response = work->response[chosen];
    survey->rows = work->tried;
    for (int r = 0; r < work->tried; r++)
        survey->row[r] = (hada_survey_row){.response = work->response[r],
                                           .unexplained = mean_of(work->unexplained[r][0], work->count),
                                           .unexplained_apart = mean_of(work->unexplained[r][1], work->count),
                                           .chosen = r == chosen};
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
    for (int i = 0; i < work->pairs[z]; i++) {
        if (i == EXPOSED_TOGETHER)
            hada_survey_level_expose(&work->level, gain, unexplained, room);
        forget_pairs(work);
        HADA_TRY_OR_DONE(take_pair(work, z, i, err));
        if (!work->count)
            continue;
        hada_survey_level_put(&work->level, together, z, &work->frame[0], &work->scene[0][0]);
        if (i < EXPOSED_TOGETHER) {
            pair_at[together++] = i;
        } else {
            gain[together] = 0.0;
            hada_survey_level_judge(&work->level, gain, unexplained, room);
            exposure[i] = room[together] > 0.0 ? room[together] : 1.0;
        }
    }
    if (together < 2)
        goto done;
    if (work->pairs[z] <= EXPOSED_TOGETHER)
        hada_survey_level_expose(&work->level, gain, unexplained, room);
    for (int k = 0; k < together; k++)
        exposure[pair_at[k]] = gain[k];
done:
    forget_pairs(work);
    return status;
}

static hada_status expose_all(hada_survey *survey, surveying *work, hada_error *err)
{
    work->response = &survey->response;
    work->tried = 1;
    hada_survey_level_destroy(&work->level);
    HADA_TRY(hada_survey_level_create(&work->level, work->grid, work->options.channels, EXPOSED_TOGETHER + 1, err));
    HADA_TRY(hada_allocated(survey->gain = hada_alloc((size_t)survey->depths, sizeof *survey->gain, "exposures", err)));
    for (int z = 0; z < survey->depths; z++) {
        HADA_TRY(hada_allocated(survey->gain[z] =
                                    hada_alloc((size_t)survey->pairs[z], sizeof **survey->gain, "exposures", err)));
        for (int i = 0; i < survey->pairs[z]; i++)
            survey->gain[z][i] = 1.0;
        HADA_TRY(expose_depth(work, z, survey->gain[z], err));
    }
    return HADA_OK;
}

static hada_status make(hada_survey *survey, surveying *work, hada_exposure exposure, hada_error *err)
{
    const hada_fit_options *options = &work->options;
    survey->depths = options->depths;
    survey->response = options->scene_response == HADA_AUTO ? HADA_RESPONSE_LINEAR : options->scene_response;
    work->tried = options->scene_response == HADA_AUTO ? RESPONSES : 1;
    work->response = work->tried == 1 ? &options->scene_response : responses;
    HADA_TRY(hada_allocated(survey->pairs =
                                hada_alloc((size_t)options->depths, sizeof *survey->pairs, "a survey of pairs", err)));
    memcpy(survey->pairs, work->pairs, (size_t)options->depths * sizeof *survey->pairs);
    choose_grid(work);
    HADA_TRY(hada_allocated(work->room = hada_alloc((size_t)options->raw_rows * (size_t)options->raw_cols,
                                                    sizeof(float), "a raw frame", err)));
    HADA_TRY(hada_survey_level_create(&work->level, work->grid, options->channels, MOST_PAIRS, err));
    HADA_TRY(take_pairs(work, err));
    int exposed = exposure == HADA_EXPOSURE_EACH;
    if (work->count >= LEAST) {
        compare(work);
        exposed = choose(survey, work, exposure);
    }
    forget_pairs(work);
    if (exposed)
        HADA_TRY(expose_all(survey, work, err));
    return HADA_OK;
}

hada_status hada_survey_create(hada_survey **out, const hada_fit_options *callers, const int *pairs,
                               hada_exposure exposure, hada_fit_show show, void *user, hada_error *err)
{
    surveying work = {.pairs = pairs, .show = show, .user = user};
    hada_fit_options *options = &work.options;
    hada_status status = HADA_OK;
    if (!out || !callers || !pairs || !show)
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "hada_survey_create: out, options, numbers of pairs and a function that shows them are needed");
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(options, callers, hada_fit_options, err));
    if (options->depths < 1 || options->channels < 1 || options->window_rows < 1 || options->window_cols < 1 ||
        options->window_rows > options->raw_rows || options->window_cols > options->raw_cols)
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_ARGUMENT, "hada_survey_create: the sizes of frames and windows are needed"));
    if (options->scene_response != HADA_AUTO && !hada_response_is_known(options->scene_response))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT,
                                   "the response of the scenes, %g, is none (hadalens/response.h)",
                                   options->scene_response));
    HADA_TRY_OR_DONE(hada_allocated(*out = hada_alloc(1, sizeof **out, "a survey of pairs", err)));
    HADA_TRY_OR_DONE(make(*out, &work, exposure, err));
done:
    forget_pairs(&work);
    hada_survey_level_destroy(&work.level);
    free(work.room);
    if (status)
        hada_survey_destroy(out);
    return status;
}

void hada_survey_destroy(hada_survey **pointer)
{
    hada_survey *survey = pointer ? *pointer : NULL;
    if (!survey)
        return;
    *pointer = NULL;
    for (int z = 0; survey->gain && z < survey->depths; z++)
        free(survey->gain[z]);
    free(survey->gain);
    free(survey->pairs);
    free(survey);
}

double hada_survey_response(const hada_survey *survey)
{
    if (!survey)
        return HADA_AUTO;
    return survey->response;
}

const hada_survey_row *hada_survey_get_row(const hada_survey *survey, size_t index)
{
    return survey && index < (size_t)survey->rows ? &survey->row[index] : NULL;
}

int hada_survey_exposed(const hada_survey *survey)
{
    if (!survey)
        return 0;
    return survey->gain != NULL;
}

double hada_survey_gain(const hada_survey *survey, int depth, int pair)
{
    if (!survey)
        return 1.0;
    const int known = survey->gain && depth >= 0 && depth < survey->depths && pair >= 0 && pair < survey->pairs[depth];
    return known ? survey->gain[depth][pair] : 1.0;
}

void hada_survey_even(const hada_survey *survey, int depth, int pair, hada_image *scene)
{
    if (!survey || !scene)
        return;
    const double gain = hada_survey_gain(survey, depth, pair), response = survey->response;
    const size_t count = hada_image_count(scene);
    if (gain == 1.0)
        return;
    hada_response_convert(scene->data, count, response, HADA_RESPONSE_LINEAR);
    for (size_t i = 0; i < count; i++)
        scene->data[i] *= (float)gain;
    hada_response_convert(scene->data, count, HADA_RESPONSE_LINEAR, response);
}
