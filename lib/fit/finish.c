/* The end of a fit: the setting that leave-one-out prefers, a model, and whether refinement pays. */
#include <math.h>
#include <string.h>

#include "fit/fit_model.h"
#include "fit/fit_scores.h"
#include "fit/fitter.h"
#include "refine/admm.h"

/* Refinement of a model whose fit did not measure it: what pays with an exact model of the camera
 * (docs/explanation/learning-a-camera.md). */
#define REFINE_STEPS 12
/* Decibels by which refinement must lead so that filters are not judged in the window: more than judging was seen to
 * gain (docs/explanation/learning-a-camera.md). */
#define ENOUGH_GAIN 3.0

/* The settings (where scored) and the weights outside the window that were compared; places for the trial. */
static hada_status list_scores(hada_fit_scores **out, const hada_fitter *fitter, hada_error *err)
{
    const hada_fit_outside *outside = &fitter->outside;
    hada_fit_scores *scores;
    HADA_TRY(hada_fit_scores_create(out, (size_t)hada_leave_one_out_row_count(&fitter->scores), (size_t)outside->count,
                                    HADA_FIT_TRIAL_ROWS, err));
    scores = *out;
    scores->refinement_count = 0;
    hada_leave_one_out_rows(&fitter->scores, scores->filters);
    for (int s = 0; s < outside->count; s++)
        scores->outsides[s] = (hada_fit_outside_score){
            .outside = outside->weight[s], .psnr = outside->psnr[s], .chosen = s == outside->chosen};
    return HADA_OK;
}

static void set_refinement(hada_model *model, int steps, const hada_refine_weights *weights)
{
    model->info.refine_steps = steps;
    model->info.refine_tv = weights->tv;
    model->info.refine_colour = weights->colour;
    model->info.refine_shrink = weights->tv > 0.0 ? weights->shrink : 0.0;
    model->info.refine_rho = hada_refine_rho(model->info.boundary, weights->tv);
}

/* The weights that options ask for: tv 0 and what photographs favour where they leave them open. */
static hada_refine_weights weights_of(const hada_fit_options *options)
{
    return (hada_refine_weights){fmax(options->refine_tv, 0.0),
                                 options->refine_colour >= 0.0 ? options->refine_colour : HADA_REFINE_COLOUR,
                                 options->refine_shrink >= 0.0 ? options->refine_shrink : HADA_REFINE_SHRINK};
}

/* Tries refinement on the pairs that were kept. The trial compares with the exact fit's filters; where judging them in
 * the window gained more than refinement does, the model keeps the filters. */
static hada_status try_refinement(hada_fitter *fitter, hada_nonnegative *nonnegative, hada_model *model,
                                  hada_fit_scores *scores, hada_error *err)
{
    const hada_fit_trial trial = {.sums = &fitter->sums,
                                  .pair = &fitter->pair,
                                  .nonnegative = nonnegative,
                                  .kept = &fitter->kept,
                                  .model = model,
                                  .tv = fitter->options.refine_tv,
                                  .colour = fitter->options.refine_colour,
                                  .shrink = fitter->options.refine_shrink};
    hada_fit_trial_result result;
    if (!fitter->kept.count)
        return HADA_OK;
    HADA_TRY(hada_fit_trial_run(&trial, &result, err));
    if (result.steps && result.gain <= hada_fit_outside_gain(&fitter->outside)) {
        result.steps = 0;
        result.share = 1.0;
        result.weights.tv = 0.0;
        for (int i = 0; i < result.row_count; i++)
            result.rows[i].chosen = i == 0;
    }
    memcpy(scores->refinements, result.rows, (size_t)result.row_count * sizeof *result.rows);
    scores->refinement_count = (size_t)result.row_count;
    set_refinement(model, result.steps, &result.weights);
    model->info.refine_share = result.share;
    return HADA_OK;
}

/* Solves, and tries on pairs held out whether refinement pays. */
static hada_status solve_and_try(hada_fitter *fitter, hada_model **out, hada_fit_scores **scores, hada_error *err)
{
    const hada_fit_options *options = &fitter->options;
    const hada_model_info *info = &fitter->grid.info;
    hada_nonnegative *nonnegative = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_leave_one_out_share(&fitter->scores, err));
    if (options->nonnegative)
        HADA_TRY_OR_DONE(hada_nonnegative_create(&nonnegative, fitter->grid.slot, info->grid_rows, info->grid_cols,
                                                 info->channels, err));
    HADA_TRY_OR_DONE(hada_fit_model_make(out, &fitter->sums, hada_leave_one_out_best(&fitter->scores),
                                         fitter->outside.filters, &fitter->transfers, nonnegative, err));
    HADA_TRY_OR_DONE(list_scores(scores, fitter, err));
    const hada_refine_weights weights = weights_of(options);
    set_refinement(*out, options->refine_steps < 0 ? REFINE_STEPS : options->refine_steps, &weights);
    if (options->refine_steps >= 0)
        goto done;
    status = try_refinement(fitter, nonnegative, *out, *scores, err);
    if ((status == HADA_ERROR_DEVICE_MEMORY || status == HADA_ERROR_MEMORY) && fitter->grid.communicator.count == 1) {
        /* the model is there; only the trial needed more */
        hada_log(fitter->grid.slot->context, HADA_LOG_WARNING,
                 "no memory to try refinement on the pairs; the model keeps %d steps untried",
                 (*out)->info.refine_steps);
        status = HADA_OK;
    }
done:
    hada_nonnegative_destroy(&nonnegative);
    return status;
}

hada_status hada_fitter_finish(hada_fitter *fitter, hada_model **out, hada_fit_scores **scores, hada_error *err)
{
    hada_fit_scores *own = NULL;
    hada_status status = HADA_OK;
    if (scores)
        *scores = NULL;
    if (!fitter || !out)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_finish: a fitter and out are needed");
    *out = NULL;
    hada_slot_watch(fitter->grid.slot, fitter->options.monitor);
    HADA_TRY_OR_DONE(solve_and_try(fitter, out, &own, err));
    if (scores) {
        *scores = own;
        own = NULL;
    }
done:
    hada_slot_watch(fitter->grid.slot, NULL);
    hada_fit_scores_destroy(&own);
    if (status)
        hada_model_destroy(out);
    return status;
}

hada_status hada_fitter_learn_and_finish(hada_fitter *fitter, hada_fit_show show, void *user, hada_model **out,
                                         hada_fit_scores **scores, hada_error *err)
{
    hada_fit_scores *first = NULL;
    hada_status status = HADA_OK;
    if (scores)
        *scores = NULL;
    if (!fitter || !show || !out)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "hada_fitter_learn_and_finish: a fitter, a function that shows pairs, and out are needed");
    *out = NULL;
    if (!fitter->transfers.otf)
        HADA_TRY_OR_DONE(hada_fitter_learn_cropped(fitter, show, user, err));
    /* refinement is tried where its steps are not given; without that there is nothing to learn before judging */
    if (fitter->options.outside < 0.0 && fitter->options.refine_steps < 0) {
        HADA_TRY_OR_DONE(hada_fitter_finish(fitter, out, &first, err));
        if (hada_fit_scores_gain(first) > ENOUGH_GAIN) {
            if (scores) {
                *scores = first;
                first = NULL;
            }
            goto done;
        }
        hada_model_destroy(out);
    }
    HADA_TRY_OR_DONE(hada_fitter_learn_windowed(fitter, show, user, err));
    HADA_TRY_OR_DONE(hada_fitter_finish(fitter, out, scores, err));
done:
    hada_fit_scores_destroy(&first);
    return status;
}
