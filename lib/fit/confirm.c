/* What a survey of small copies chose, compared with the crop in the model: the response of the scenes, and exposures.
 */
#include <float.h>
#include <hadalens/response.h>

#include "core/numbers.h"
#include "fit/look.h"
#include "image/correct.h"
#include "image/pixels.h"

/* Another response than the survey's must leave so much less of held-out frames: than linear, than others, and where
 * the pairs gave the dark level as well, which a power nearly makes up for. */
#define SURE           0.7
#define NEARLY_SURE    0.97
#define SURE_WITH_DARK 0.5
/* Light that is in all frames must leave so much less without it: on simulated cameras it left 0.01 to 0.31, in one
 * case with mixed colours and exposures 0.4, on real pairs 0.23; where there was none 0.34 and more. The same of light
 * of each frame's own, where smooth surfaces and noise do not count: 0.01 to 0.24; beside light that was found in all
 * frames, which is a special case of it, 0.19 on real pairs, and 0.24 and more where it was that
 * (perf/results/learning.md). */
#define LIGHT          0.32
#define OWN_LIGHT      0.25
#define OWN_BESIDE_ALL 0.2
/* Frames that are encoded leave so much less of their energy once they are decoded: 0.001 to 0.7 on simulated cameras,
 * 1.4 to 1700 where they were linear. */
#define ENCODED 0.9
/* Where decoded frames leave so much more, a dark level or light makes no difference to that. */
#define SPOILT 2.0
/* Frames that are nowhere brighter are not encoded: 10 or 12 bits in a file of 16. */
#define DIM 0.1

/* Exposures become more precise in so many rounds, in each by this factor at most. */
enum { ROUNDS = 3 };
#define MOST_CHANGE 1.5

/* The exposure of a frame by what its scene makes, with a smooth surface beside it where light is to be left out:
 * least squares of pixels that are known. */
static double exposure_of(const hada_look *at, int pair, const hada_image *frame, double dark, const float *made)
{
    enum { MOST = 1 + HADA_SMOOTH_TERMS };
    const int rows = at->options->raw_rows, cols = at->options->raw_cols, n = at->centred || at->smooth ? MOST : 1;
    const float *weights = at->weights[pair].data;
    double normal[MOST * MOST] = {0.0}, right[MOST] = {0.0}, term[MOST];
    for (int p = 0; p < rows * cols; p++) {
        const double y = hada_smooth_place(p / cols + 0.5, rows), x = hada_smooth_place(p % cols + 0.5, cols);
        for (int k = 0; k < n && (!weights || weights[p] == 1.0f); k++) {
            term[k] = k ? hada_smooth_term(k - 1, y, x) : (double)made[p];
            right[k] += term[k] * ((double)frame->data[p] - dark);
            for (int j = 0; j <= k; j++)
                normal[k * n + j] += term[k] * term[j];
        }
    }
    if (!hada_cholesky_factor(normal, n))
        return 1.0;
    hada_cholesky_solve(normal, n, right);
    return right[0] > 0.0 ? fmin(fmax(right[0], 1.0 / MOST_CHANGE), MOST_CHANGE) : 1.0;
}

/* Exposures of the pairs that `at` names, from what they make of each other together. Their geometric mean stays. */
static hada_status expose_group(hada_look *at, const hada_survey *survey, const hada_dataset *pairs, hada_error *err)
{
    const size_t area = (size_t)at->options->raw_rows * (size_t)at->options->raw_cols;
    double *gain = (double *)(uintptr_t)survey->gains[at->depth] + at->first;
    double times[HADA_LOOK_MOST], dark[HADA_LOOK_MOST], mean = 0.0;
    hada_image frame[HADA_LOOK_MOST];
    hada_dataset *even = NULL;
    float *made = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(made, (size_t)at->group * area, "frames", err));
    HADA_TRY_OR_DONE(hada_survey_apply(&even, survey, pairs, err));
    HADA_TRY_OR_DONE(hada_look_take(at, even, err));
    HADA_TRY_OR_DONE(hada_look_predict(at, made, frame, dark, err));
    for (int i = 0; i < at->group; i++) {
        times[i] = exposure_of(at, i, &frame[i], dark[i], made + (size_t)i * area);
        mean += log(times[i]) / at->group;
    }
    for (int i = 0; i < at->group; i++)
        gain[i] *= times[i] / exp(mean);
done:
    free(made);
    hada_look_return(at);
    hada_dataset_destroy(&even);
    return status;
}

/* More precise exposures of the pairs of a depth, which a survey has, in groups. */
static hada_status expose_depth(const hada_survey *survey, const hada_fit_options *fit, int depth,
                                hada_context *context, const hada_dataset *pairs, hada_error *err)
{
    const int count = hada_dataset_get_info(pairs)->counts[depth],
              groups = (count + HADA_LOOK_MOST - 1) / HADA_LOOK_MOST;
    hada_fit_options options = *fit;
    options.scene_response = survey->response;
    for (int g = 0; count >= HADA_LOOK_LEAST && g < groups; g++)
        for (int round = 0; round < ROUNDS; round++) {
            hada_look at = {.context = context, .options = &options, .depth = depth, .first = count * g / groups};
            hada_look_ignore_light(&at, pairs, depth);
            at.group = count * (g + 1) / groups - at.first;
            HADA_TRY(expose_group(&at, survey, pairs, err));
        }
    return HADA_OK;
}

/* How much light of a depth's scenes, exposed as the survey says, reaches the sensor and beyond. */
static hada_status light_of(const hada_survey *survey, const hada_fit_options *fit, int depth, hada_context *context,
                            const hada_dataset *even, double *light, hada_error *err)
{
    hada_fit_options options = *fit;
    hada_look at = {.context = context, .options = &options, .depth = depth};
    double left[HADA_LOOK_MOST];
    int rows, cols;
    hada_status status = HADA_OK;
    options.scene_response = survey->response;
    at.group = hada_least(hada_dataset_get_info(even)->counts[depth], HADA_LOOK_MOST);
    hada_look_whole(&options, &rows, &cols);
    HADA_TRY_OR_DONE(hada_look_take(&at, even, err));
    HADA_TRY_OR_DONE(hada_look_explain(&at, rows, cols, at.learned, left, light, NULL, err));
done:
    hada_look_return(&at);
    return status;
}

/* Exposures of depths beside each other are not in the pairs: they become such that scenes are as bright at all depths,
 * for a pixel of the scene stands for the same angle at each. */
static hada_status level_depths(const hada_survey *survey, const hada_fit_options *fit, hada_context *context,
                                const hada_dataset *pairs, hada_error *err)
{
    const int *counts = hada_dataset_get_info(pairs)->counts;
    hada_dataset *even = NULL;
    double *light = NULL, mean = 0.0;
    hada_status status = HADA_OK;
    if (fit->depths < 2)
        return HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(light, (size_t)fit->depths, "exposures", err));
    HADA_TRY_OR_DONE(hada_survey_apply(&even, survey, pairs, err));
    for (int z = 0; z < fit->depths; z++) {
        if (!counts[z])
            goto done;
        HADA_TRY_OR_DONE(light_of(survey, fit, z, context, even, &light[z], err));
        mean += log(light[z]) / fit->depths;
    }
    for (int z = 0; isfinite(mean) && z < fit->depths; z++)
        for (int i = 0; i < counts[z]; i++)
            ((double *)(uintptr_t)survey->gains[z])[i] *= light[z] / exp(mean);
done:
    free(light);
    hada_dataset_destroy(&even);
    return status;
}

/* Responses that are compared on the largest grid, exposures alike or apart. */
typedef struct confirming {
    hada_look at; /* with the options: */
    hada_fit_options options;
    const hada_survey *survey;
    const hada_dataset *pairs;
    int rows, chosen; /* of the survey: how many, and which it chose */
    int apart;
    double *left; /* of a frame, for each row; 0: not known yet */
} confirming;

/* of->left: free(). `fit` has the depth of a pair that can be held out, or there are no rows. */
static hada_status begin(confirming *of, hada_context *context, const hada_fit_options *fit, const hada_survey *survey,
                         const hada_dataset *pairs, int smooth, hada_error *err)
{
    *of = (confirming){.options = *fit, .survey = survey, .pairs = pairs};
    of->at = (hada_look){.context = context, .options = &of->options, .depth = hada_look_depth(fit, pairs)};
    if (of->at.depth == fit->depths)
        return HADA_OK;
    of->at.smooth = smooth;
    hada_look_ignore_light(&of->at, pairs, of->at.depth);
    for (; survey->rows[of->rows]; of->rows++) /* none where pairs do not fit */
        of->chosen = survey->rows[of->rows]->chosen ? of->rows : of->chosen;
    for (int r = hada_most(of->chosen - 1, 0); r < hada_least(of->chosen + 2, of->rows); r++)
        if (survey->rows[r]->response == HADA_RESPONSE_SRGB) /* small copies do not tell its neighbours from it */
            of->chosen = r;
    return HADA_NEW(of->left, (size_t)of->rows, "responses", err);
}

/* The pairs exposed as a survey with that response says. */
static hada_status expose(const confirming *of, hada_dataset **even, hada_survey **exposures, hada_error *err)
{
    HADA_TRY(hada_survey_create(exposures, &of->options, of->pairs, HADA_EXPOSURE_EACH, err));
    HADA_TRY(expose_depth(*exposures, &of->options, of->at.depth, of->at.context, of->pairs, err));
    return hada_survey_apply(even, *exposures, of->pairs, err);
}

static hada_status left_with(confirming *of, int row, hada_error *err)
{
    hada_dataset *even = NULL;
    hada_survey *exposures = NULL;
    int rows, cols;
    hada_status status = HADA_OK;
    if (of->left[row] > 0.0)
        return HADA_OK;
    hada_look_whole(&of->options, &rows, &cols);
    of->options.scene_response = of->survey->rows[row]->response;
    if (of->apart)
        HADA_TRY_OR_DONE(expose(of, &even, &exposures, err));
    for (int turn = 0, turns = 1; turn < turns; turn++) { /* of few centred pairs, each is held out once */
        double left = 0.0;
        of->at.first = turn;
        HADA_TRY_OR_DONE(hada_look_take(&of->at, even ? even : of->pairs, err));
        HADA_TRY_OR_DONE(hada_look_left(&of->at, rows, cols, &left, err));
        turns = of->at.centred && of->at.held == 1 ? of->at.count : 1;
        of->left[row] += left / (turns * of->at.held);
        hada_look_return(&of->at);
    }
done:
    hada_look_return(&of->at);
    hada_dataset_destroy(&even);
    hada_survey_destroy(&exposures);
    return status;
}

/* The row that leaves least: of the chosen one and that which the survey's grid says, and on from the better one to
 * neighbours, until none leaves less. */
static hada_status find_row(confirming *of, int *best, hada_error *err)
{
    const int chosen = of->chosen;
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
static hada_status confirm(confirming *of, int apart, int *row, double *least, hada_error *err)
{
    const int chosen = of->chosen;
    const double response = of->survey->rows[chosen]->response;
    const int dark = of->options.find_dark && !of->at.centred;
    const double sure = dark ? SURE_WITH_DARK : response == HADA_RESPONSE_LINEAR ? SURE : NEARLY_SURE;
    int best;
    of->apart = apart;
    memset(of->left, 0, (size_t)of->rows * sizeof *of->left);
    HADA_TRY(find_row(of, &best, err));
    *row = of->left[best] < sure * of->left[chosen] ? best : chosen;
    *least = of->left[best];
    return HADA_OK;
}

/* Whether it is worth a look: on small copies exposures of their own leave less than this share of what is unexplained.
 */
#define MAYBE_APART 0.8

static int may_be_apart(const hada_survey *survey, hada_exposure exposure)
{
    double alike = INFINITY, apart = INFINITY;
    for (int r = 0; survey->rows[r]; r++) {
        alike = fmin(alike, survey->rows[r]->unexplained);
        apart = fmin(apart, survey->rows[r]->unexplained_apart);
    }
    return survey->exposed || (exposure == HADA_EXPOSURE_AUTO && apart < MAYBE_APART * alike);
}

hada_status hada_fit_confirm_survey(hada_survey *survey, const hada_fit_options *fit, hada_exposure exposure,
                                    hada_context *context, const hada_dataset *pairs, hada_error *err)
{
    confirming of = {0};
    hada_survey *exposures = NULL;
    int alike = 0, apart = 0;
    const int looks = may_be_apart(survey, exposure);
    double left_alike = INFINITY, left_apart = INFINITY;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(begin(&of, context, fit, survey, pairs, 0, err));
    if (!of.rows || (of.rows == 1 && !looks))
        goto done;
    if (exposure != HADA_EXPOSURE_EACH)
        HADA_TRY_OR_DONE(confirm(&of, 0, &alike, &left_alike, err));
    if (looks)
        HADA_TRY_OR_DONE(confirm(&of, 1, &apart, &left_apart, err));
    if (left_apart < SURE * left_alike) {
        of.options.scene_response = survey->rows[apart]->response;
        HADA_TRY_OR_DONE(hada_survey_create(&exposures, &of.options, pairs, HADA_EXPOSURE_EACH, err));
        hada_survey_choose(survey, survey->rows[apart], exposures);
        for (int z = 0; z < fit->depths; z++)
            HADA_TRY_OR_DONE(expose_depth(survey, fit, z, context, pairs, err));
        HADA_TRY_OR_DONE(level_depths(survey, fit, context, pairs, err));
    } else {
        hada_survey_choose(survey, survey->rows[alike], NULL);
    }
done:
    free(of.left);
    hada_survey_destroy(&exposures);
    return status;
}

/* What is left of held-out frames of these pairs, with the response and exposures that leave least. */
static hada_status left_of(const hada_fit_options *fit, hada_context *context, const hada_dataset *pairs, int smooth,
                           double *left, hada_error *err)
{
    confirming of = {0};
    hada_survey *survey = NULL;
    double apart = INFINITY;
    int row;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_survey_create(&survey, fit, pairs, HADA_EXPOSURE_AUTO, err));
    HADA_TRY_OR_DONE(begin(&of, context, fit, survey, pairs, smooth, err));
    if (!of.rows)
        goto done;
    HADA_TRY_OR_DONE(confirm(&of, 0, &row, left, err));
    if (may_be_apart(survey, HADA_EXPOSURE_AUTO))
        HADA_TRY_OR_DONE(confirm(&of, 1, &row, &apart, err));
    *left = fmin(*left, apart);
done:
    free(of.left);
    hada_survey_destroy(&survey);
    return status;
}

hada_status hada_fit_confirm_dark(const hada_fit_options *fit, hada_context *context, const hada_dataset *lit,
                                  const hada_dataset *dark, int own, double *before, int *better, hada_error *err)
{
    hada_fit_options without = *fit;
    double after = 0.0;
    without.dark = 0.0;
    if (*before == 0.0)
        HADA_TRY(left_of(fit, context, lit, own, before, err));
    HADA_TRY(left_of(&without, context, dark, own, &after, err));
    *better = after < *before * (!own ? LIGHT : hada_look_is_lit(fit, lit) ? OWN_BESIDE_ALL : OWN_LIGHT);
    return HADA_OK;
}

/* The variance of the frames of which some are held out, in the channel that is looked at. */
static hada_status variance_of(const hada_fit_options *fit, const hada_dataset *pairs, double *variance,
                               hada_error *err)
{
    const int depth = hada_look_depth(fit, pairs);
    *variance = 0.0;
    for (int i = 0; depth < fit->depths && i < hada_dataset_get_info(pairs)->counts[depth]; i++) {
        hada_pair pair;
        double sum = 0.0, squares = 0.0;
        HADA_TRY(hada_pair_take(&pair, pairs, depth, i, err));
        const size_t count = (size_t)pair.raw->rows * (size_t)pair.raw->cols;
        const float *channel = pair.raw->data + (size_t)(pair.raw->channels / 2) * count;
        for (size_t k = 0; k < count; k++) {
            sum += (double)channel[k];
            squares += (double)channel[k] * (double)channel[k];
        }
        *variance += squares - sum * sum / (double)count;
        hada_pair_return(&pair);
    }
    *variance = fmax(*variance, DBL_MIN);
    return HADA_OK;
}

hada_status hada_fit_left_share(const hada_fit_options *fit, hada_context *context, const hada_dataset *pairs,
                                double *share, hada_error *err)
{
    double variance;
    HADA_TRY(variance_of(fit, pairs, &variance, err));
    HADA_TRY(left_of(fit, context, pairs, 0, share, err));
    *share /= variance;
    return HADA_OK;
}

/* The share that is left of held-out frames without the dark level, the light that all hold, or light of each frame's
 * own, whichever leaves least; infinite where none is found. */
static hada_status left_dark(const hada_fit_options *callers, hada_context *context, const hada_dataset *pairs,
                             double *left, hada_error *err)
{
    hada_fit_options fit = *callers;
    hada_dataset *above = NULL, *unlit = NULL;
    hada_image surface = {0};
    double with_surface = INFINITY, with_own = INFINITY, *light = NULL;
    hada_status status = HADA_OK;
    *left = INFINITY;
    HADA_TRY_OR_DONE(hada_fit_find_dark(&fit, pairs, &surface, err));
    if (fit.dark > 0.0)
        HADA_TRY_OR_DONE(hada_fit_left_share(&fit, context, pairs, left, err));
    if (surface.data) {
        fit.dark = 0.0;
        HADA_TRY_OR_DONE(hada_dataset_mend(&above, pairs, NULL, &surface, err));
        HADA_TRY_OR_DONE(hada_fit_left_share(&fit, context, above, &with_surface, err));
    }
    fit.dark = 0.0;
    HADA_TRY_OR_DONE(hada_fit_find_own_light(&fit, pairs, 1, &light, err));
    if (light) {
        HADA_TRY_OR_DONE(hada_dataset_unlit(&unlit, pairs, light, fit.channels, err));
        HADA_TRY_OR_DONE(hada_fit_left_share(&fit, context, unlit, &with_own, err));
    }
    *left = fmin(*left, fmin(with_surface, with_own));
done:
    free(light);
    hada_dataset_destroy(&unlit);
    hada_dataset_destroy(&above);
    hada_image_destroy(&surface);
    return status;
}

/* Of pairs of one depth whose frames are as they are, and decoded: whether far less is left of these. Encodings make
 * more or less of what all frames hold beside the scenes' light, so it is taken off unless decoding clearly spoils. */
static hada_status compare(const hada_fit_options *fit, hada_context *context, const hada_dataset *const kinds[2],
                           int *seem, hada_error *err)
{
    double share[2], dark;
    for (int k = 0; k < 2; k++)
        HADA_TRY(hada_fit_left_share(fit, context, kinds[k], &share[k], err));
    const int spoilt = share[1] > SPOILT * share[0];
    for (int k = 0; k < 2 && !spoilt; k++) {
        HADA_TRY(left_dark(fit, context, kinds[k], &dark, err));
        share[k] = fmin(share[k], dark);
    }
    *seem = share[1] < ENCODED * share[0];
    return HADA_OK;
}

hada_status hada_fit_seem_encoded(const hada_fit_options *fit, hada_context *context, const hada_dataset *pairs,
                                  double encoding, int *seem, hada_error *err)
{
    hada_fit_options options = *fit;
    hada_image frames[HADA_LOOK_MOST] = {{0}}, scenes[HADA_LOOK_MOST] = {{0}};
    hada_dataset *few = NULL, *sound = NULL, *decoded = NULL;
    hada_image flat = {0};
    size_t found;
    float most = 0.0f;
    const int depth = hada_look_depth(fit, pairs);
    const int count = depth < fit->depths ? hada_least(hada_dataset_get_info(pairs)->counts[depth], HADA_LOOK_MOST) : 0;
    hada_status status = HADA_OK;
    *seem = 0;
    if (!count)
        return HADA_OK;
    options.depths = 1;
    options.distances_mm = fit->distances_mm + depth;
    for (int i = 0; i < count; i++) {
        HADA_TRY_OR_DONE(hada_dataset_read(pairs, depth, i, &frames[i], &scenes[i], err));
        most = fmaxf(most, hada_image_brightest(&frames[i]));
    }
    if (most < DIM)
        goto done;
    HADA_TRY_OR_DONE(hada_dataset_from_images(&few, 1, options.distances_mm, &count, frames, scenes, err));
    HADA_TRY_OR_DONE(hada_fit_find_bad_pixels(&options, few, &flat, &found, err));
    HADA_TRY_OR_DONE(hada_dataset_mend(&sound, few, found ? &flat : NULL, NULL, err));
    HADA_TRY_OR_DONE(hada_dataset_decode(&decoded, sound, encoding, err));
    HADA_TRY_OR_DONE(compare(&options, context, (const hada_dataset *const[]){sound, decoded}, seem, err));
done:
    hada_image_destroy(&flat);
    hada_dataset_destroy(&decoded);
    hada_dataset_destroy(&sound);
    hada_dataset_destroy(&few);
    for (int i = 0; i < count; i++) {
        hada_image_destroy(&frames[i]);
        hada_image_destroy(&scenes[i]);
    }
    return status;
}
