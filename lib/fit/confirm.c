/* What a survey of small copies chose, compared with the crop in the model: the response of the scenes, and exposures.
 */
#include <float.h>
#include <hadalens/response.h>

#include "fit/look.h"
#include "image/pixels.h"

/* Another response than the survey's must leave so much less of held-out frames: than linear, than others, and where
 * the pairs gave the dark level as well, which a power nearly makes up for. */
#define SURE           0.7
#define NEARLY_SURE    0.97
#define SURE_WITH_DARK 0.5
/* Frames that are encoded leave so much less of their energy once they are decoded: 0.001 to 0.7 on simulated cameras,
 * 1.4 to 1700 where they were linear. */
#define ENCODED 0.9
/* Where decoded frames leave so much more, a dark level or light makes no difference to that. */
#define SPOILT 2.0
/* Frames that are nowhere brighter are not encoded: 10 or 12 bits in a file of 16. */
#define DIM 0.1

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
                         const hada_dataset *pairs, hada_error *err)
{
    *of = (confirming){.options = *fit, .survey = survey, .pairs = pairs};
    of->at = (hada_look){.context = context, .options = &of->options, .depth = hada_look_depth(fit, pairs)};
    if (of->at.depth == fit->depths)
        return HADA_OK;
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
    HADA_TRY(hada_fit_expose_depth(*exposures, &of->options, of->at.depth, of->at.context, of->pairs, err));
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
    HADA_TRY_OR_DONE(begin(&of, context, fit, survey, pairs, err));
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
            HADA_TRY_OR_DONE(hada_fit_expose_depth(survey, fit, z, context, pairs, err));
        HADA_TRY_OR_DONE(hada_fit_level_depths(survey, fit, context, pairs, err));
    } else {
        hada_survey_choose(survey, survey->rows[alike], NULL);
    }
done:
    free(of.left);
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
    int row;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_survey_create(&survey, fit, pairs, HADA_EXPOSURE_AUTO, err));
    HADA_TRY_OR_DONE(begin(&of, context, fit, survey, pairs, err));
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
