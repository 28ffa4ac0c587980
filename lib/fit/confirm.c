/* What a survey of small copies chose, with the crop in the model: the response of the scenes, exposures alike or
 * apart. */
#include <float.h>
#include <hadalens/response.h>

#include "fit/look.h"
#include "fit/sample.h"
#include "image/pixels.h"

/* Exposures of their own must leave so much less of held-out frames. */
#define SURE 0.7
/* Frames that are encoded leave so much less of their energy once they are decoded: 0.001 to 0.7 on simulated cameras,
 * 1.4 to 1700 where they were linear. */
#define ENCODED 0.9
/* Where decoded frames leave so much more, a dark level or light makes no difference to that. */
#define SPOILT 2.0
/* Frames that are nowhere brighter are not encoded: 10 or 12 bits in a file of 16. */
#define DIM 0.1

/* Exposures alike and apart, which are compared on the largest grid. */
typedef struct confirming {
    hada_look at; /* with the options: */
    hada_fit_options options;
    const hada_survey *survey;
    const hada_dataset *pairs;
    int rows, chosen; /* of the survey: how many, and which is taken */
} confirming;

/* Chooses a row. `fit` has the depth of a pair that can be held out, or there are no rows. */
static hada_status begin(confirming *of, hada_context *context, const hada_fit_options *fit, const hada_survey *survey,
                         const hada_dataset *pairs, hada_error *err)
{
    double responses[HADA_SAMPLE_RESPONSES];
    *of = (confirming){.options = *fit, .survey = survey, .pairs = pairs};
    of->at = (hada_look){.context = context, .options = &of->options, .depth = hada_look_depth(fit, pairs)};
    if (of->at.depth == fit->depths)
        return HADA_OK;
    hada_look_ignore_light(&of->at, pairs, of->at.depth);
    for (; survey->rows[of->rows]; of->rows++) { /* none where pairs do not fit */
        of->chosen = survey->rows[of->rows]->chosen ? of->rows : of->chosen;
        responses[of->rows] = survey->rows[of->rows]->response;
    }
    if (of->rows > 1)
        HADA_TRY(hada_fit_find_response(fit, pairs, of->at.centred, responses, of->rows, &of->chosen, err));
    of->options.scene_response = of->rows ? responses[of->chosen] : fit->scene_response;
    return HADA_OK;
}

/* The pairs exposed as a survey with that response says. */
static hada_status expose(const confirming *of, hada_dataset **even, hada_survey **exposures, hada_error *err)
{
    HADA_TRY(hada_survey_create(exposures, &of->options, of->pairs, HADA_EXPOSURE_EACH, err));
    HADA_TRY(hada_fit_expose_depth(*exposures, &of->options, of->at.depth, of->at.context, of->pairs, err));
    return hada_survey_apply(even, *exposures, of->pairs, err);
}

/* What is left of held-out frames, exposures alike or apart. */
static hada_status left_with(confirming *of, int apart, double *sum, hada_error *err)
{
    hada_dataset *even = NULL;
    hada_survey *exposures = NULL;
    int rows, cols;
    hada_status status = HADA_OK;
    *sum = 0.0;
    hada_look_whole(&of->options, &rows, &cols);
    if (apart)
        HADA_TRY_OR_DONE(expose(of, &even, &exposures, err));
    for (int turn = 0, turns = 1; turn < turns; turn++) { /* of few centred pairs, each is held out once */
        double left = 0.0;
        of->at.first = turn;
        HADA_TRY_OR_DONE(hada_look_take(&of->at, even ? even : of->pairs, err));
        HADA_TRY_OR_DONE(hada_look_left(&of->at, rows, cols, &left, err));
        turns = of->at.centred && of->at.held == 1 ? of->at.count : 1;
        *sum += left / (turns * of->at.held);
        hada_look_return(&of->at);
    }
done:
    hada_look_return(&of->at);
    hada_dataset_destroy(&even);
    hada_survey_destroy(&exposures);
    return status;
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
    const int looks = may_be_apart(survey, exposure);
    double left_alike = INFINITY, left_apart = INFINITY;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(begin(&of, context, fit, survey, pairs, err));
    if (!of.rows)
        goto done;
    if (looks && exposure != HADA_EXPOSURE_EACH)
        HADA_TRY_OR_DONE(left_with(&of, 0, &left_alike, err));
    if (looks)
        HADA_TRY_OR_DONE(left_with(&of, 1, &left_apart, err));
    if (left_apart < SURE * left_alike) {
        HADA_TRY_OR_DONE(hada_survey_create(&exposures, &of.options, pairs, HADA_EXPOSURE_EACH, err));
        hada_survey_choose(survey, survey->rows[of.chosen], exposures);
        for (int z = 0; z < fit->depths; z++)
            HADA_TRY_OR_DONE(hada_fit_expose_depth(survey, fit, z, context, pairs, err));
        HADA_TRY_OR_DONE(hada_fit_level_depths(survey, fit, context, pairs, err));
    } else {
        hada_survey_choose(survey, survey->rows[of.chosen], NULL);
    }
done:
    hada_survey_destroy(&exposures);
    return status;
}

/* What is left of held-out frames of these pairs, with the response and exposures that leave least. */
static hada_status left_of(const hada_fit_options *fit, hada_context *context, const hada_dataset *pairs, double *left,
                           hada_error *err)
{
    confirming of = {0};
    hada_survey *survey = NULL;
    double apart = INFINITY;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_survey_create(&survey, fit, pairs, HADA_EXPOSURE_AUTO, err));
    HADA_TRY_OR_DONE(begin(&of, context, fit, survey, pairs, err));
    if (!of.rows)
        goto done;
    HADA_TRY_OR_DONE(left_with(&of, 0, left, err));
    if (may_be_apart(survey, HADA_EXPOSURE_AUTO))
        HADA_TRY_OR_DONE(left_with(&of, 1, &apart, err));
    *left = fmin(*left, apart);
done:
    hada_survey_destroy(&survey);
    return status;
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
    HADA_TRY(left_of(fit, context, pairs, share, err));
    *share /= variance;
    return HADA_OK;
}

/* The share that is left of held-out frames without the dark level, the light that all hold, or light of each frame's
 * own that is found; infinite where none is. */
static hada_status left_dark(const hada_fit_options *callers, hada_context *context, const hada_dataset *pairs,
                             double *left, hada_error *err)
{
    hada_fit_options fit = *callers;
    hada_dataset *dark = NULL;
    hada_image surface = {0};
    hada_own_light own = HADA_OWN_LIGHT_NONE;
    double *light = NULL;
    hada_status status = HADA_OK;
    *left = INFINITY;
    HADA_TRY_OR_DONE(hada_fit_find_dark(&fit, pairs, &surface, &own, err));
    if (own)
        HADA_TRY_OR_DONE(hada_fit_find_own_light(&fit, pairs, own == HADA_OWN_LIGHT_APART, &light, err));
    if (light)
        HADA_TRY_OR_DONE(hada_dataset_unlit(&dark, pairs, light, fit.channels, err));
    else if (surface.data)
        HADA_TRY_OR_DONE(hada_dataset_mend(&dark, pairs, NULL, &surface, err));
    if (dark || fit.dark > 0.0)
        HADA_TRY_OR_DONE(hada_fit_left_share(&fit, context, dark ? dark : pairs, left, err));
done:
    free(light);
    hada_dataset_destroy(&dark);
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
