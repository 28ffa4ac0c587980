/* The end of a fit: choose, solve. */
#include <math.h>
#include <stdlib.h>

#include "fit/fitter.h"
#include "refine/admm.h"

/* Refinement of a model whose fit did not measure it: what pays with an exact model of the camera (docs/filters.md). */
#define REFINE_STEPS 12

/* The trial of refinement compares with the exact fit's filters; where judging them in the window gained more than
 * refinement does, the model keeps the filters. rows: of that trial. */
static void weigh_refinement(const hada_fitter_judged *judged, hada_model *model, hada_fit_row *rows, size_t count)
{
    const double gained = judged->count ? judged->psnr[judged->chosen] - judged->psnr[judged->count - 1] : 0.0;
    double none = 0.0, refined = 0.0;
    for (size_t i = 0; i < count; i++) {
        const double alone = rows[i].psnr_single, both = rows[i].psnr_double;
        const double score = (isfinite(alone) ? alone : 0.0) + (isfinite(both) ? both : 0.0);
        none = i ? none : score;
        refined = rows[i].chosen ? score : refined;
    }
    if (!count || !model->info.refine_steps || refined - none > gained)
        return;
    model->info.refine_steps = 0;
    model->info.refine_tv = 0.0;
    model->info.refine_rho = hada_refine_rho(0.0);
    for (size_t i = 0; i < count; i++)
        rows[i].chosen = i == 0;
}

/* Solves, and tries on pairs held out whether refinement pays. */
static hada_status solve_and_try(hada_fitter *fitter, hada_model **out, hada_fit_row **rows, size_t *row_count,
                                 hada_error *err)
{
    const hada_fit_options *options = &fitter->options;
    const hada_model_info *shape = &fitter->info;
    double alpha, lambda;
    int scored;
    const size_t best = hada_fitter_choice(fitter, &alpha, &lambda, &scored);
    hada_status status = HADA_OK;
    if (options->nonnegative)
        status = hada_nonnegative_create(&fitter->nonnegative, fitter->slot, shape->grid_rows, shape->grid_cols,
                                         shape->channels, err);
    if (!status)
        status = hada_fitter_solve(fitter, alpha, lambda, out, err);
    if (!status)
        status = hada_fitter_rows(fitter, best, scored, rows, row_count, err);
    if (status)
        return status;
    hada_model_info *info = &(*out)->info;
    const size_t before = *row_count;
    info->refine_steps = options->refine_steps < 0 ? REFINE_STEPS : options->refine_steps;
    info->refine_tv = options->refine_tv > 0.0 ? options->refine_tv : 0.0;
    info->refine_rho = hada_refine_rho(info->refine_tv);
    if (options->refine_steps >= 0)
        return HADA_OK;
    status = hada_fit_choose_refinement(fitter, *out, rows, row_count, err);
    if (!status)
        weigh_refinement(&fitter->judged, *out, *rows + before, *row_count - before);
    if (status != HADA_ERROR_DEVICE_MEMORY && status != HADA_ERROR_MEMORY)
        return status;
    /* the model is there; only the trial needed more */
    hada_log(fitter->context, HADA_LOG_WARNING,
             "no memory to try refinement on the pairs; the model keeps %d steps untried", info->refine_steps);
    return HADA_OK;
}

hada_status hada_fitter_finish(hada_fitter *fitter, hada_model **out, hada_fit_row **rows, size_t *row_count,
                               hada_error *err)
{
    hada_fit_row *list = NULL;
    size_t count = 0;
    if (!fitter || !out || (rows && !row_count))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_finish: a fitter, out and row_count are needed");
    *out = NULL;
    const hada_status status = solve_and_try(fitter, out, &list, &count, err);
    hada_nonnegative_destroy(&fitter->nonnegative);
    if (status) {
        hada_model_destroy(out);
        free(list);
        list = NULL;
        count = 0;
    }
    if (rows) {
        *rows = list;
        *row_count = count;
    } else {
        free(list);
    }
    return status;
}
