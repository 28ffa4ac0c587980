/* What a survey of small copies chose, compared with the crop in the model: the response of the scenes, and exposures.
 */
#include "fit/look.h"

/* Another response than the survey's must leave so much less of held-out frames: than linear, than others, and where
 * the pairs gave the dark level as well, which a power nearly makes up for. */
#define SURE           0.7
#define NEARLY_SURE    0.97
#define SURE_WITH_DARK 0.5

/* Responses that are compared on the largest grid, exposures alike or apart. */
typedef struct confirming {
    hada_look *at;
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
    hada_look_return(of->at);
    HADA_TRY_OR_DONE(hada_look_take(of->at, even ? even : of->pairs, err));
    HADA_TRY_OR_DONE(hada_look_left(
        of->at, hada_look_side(options->raw_rows, circular ? 1 : options->window_rows, HADA_OVERHANGS - 1),
        hada_look_side(options->raw_cols, circular ? 1 : options->window_cols, HADA_OVERHANGS - 1), &of->left[row],
        err));
done:
    hada_look_return(of->at);
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
    hada_look at = {.context = context, .options = &of.options, .depth = hada_look_depth(fit, pairs)};
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
    hada_look_return(&at);
    return status;
}
