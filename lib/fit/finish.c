/* The end of a fit: choose, solve. */
#include <stdlib.h>

#include "fit/fitter.h"
#include "refine/admm.h"

/* Refinement of a model whose fit did not measure it: what pays with an exact model of the camera (docs/filters.md). */
#define REFINE_STEPS 12

/* Solves, and tries on pairs held out whether refinement pays. */
static hada_status solve_and_try(hada_fitter *fitter, double alpha, double lambda, int scored, size_t best,
                                 hada_model **out, hada_fit_row **rows, size_t *row_count, hada_error *err)
{
    const hada_fit_options *options = &fitter->options;
    const hada_model_info *shape = &fitter->info;
    hada_status status = HADA_OK;
    if (options->nonnegative)
        status = hada_nonnegative_create(&fitter->nonnegative, fitter->slot, shape->grid_rows, shape->grid_cols,
                                         shape->channels, err);
    if (!status)
        status = hada_fitter_solve(fitter, alpha, lambda, out, err);
    if (status)
        return status;
    hada_model_info *info = &(*out)->info;
    info->refine_steps = options->refine_steps < 0 ? REFINE_STEPS : options->refine_steps;
    info->refine_tv = options->refine_tv > 0.0 ? options->refine_tv : 0.0;
    info->refine_rho = hada_refine_rho(info->refine_tv);
    if (rows && scored)
        status = hada_fitter_rows(fitter, best, rows, row_count, err);
    if (!status && options->refine_steps < 0) {
        status = hada_fit_choose_refinement(fitter, *out, rows, row_count, err);
        if (status == HADA_ERROR_DEVICE_MEMORY || status == HADA_ERROR_MEMORY) {
            /* the model is there; only the trial needed more */
            hada_log(fitter->context, HADA_LOG_WARNING,
                     "no memory to try refinement on the pairs; the model keeps %d steps untried", info->refine_steps);
            status = HADA_OK;
        }
    }
    return status;
}

hada_status hada_fitter_finish(hada_fitter *fitter, hada_model **out, hada_fit_row **rows, size_t *row_count,
                               hada_error *err)
{
    int scored;
    if (!fitter || !out || (rows && !row_count))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_finish: a fitter, out and row_count are needed");
    *out = NULL;
    if (rows) {
        *rows = NULL;
        *row_count = 0;
    }
    const hada_fit_options *options = &fitter->options;
    const size_t best = hada_fitter_best(fitter, &scored);
    double alpha = fitter->alphas[best], lambda = fitter->lambdas[best];
    if (!scored) {
        alpha = options->alpha >= 0.0 ? options->alpha : HADA_FIT_ALPHA;
        lambda = options->lambda >= 0.0 ? options->lambda : HADA_FIT_LAMBDA;
    }
    const hada_status status = solve_and_try(fitter, alpha, lambda, scored, best, out, rows, row_count, err);
    hada_nonnegative_destroy(&fitter->nonnegative);
    if (status) {
        hada_model_destroy(out);
        if (rows) {
            free(*rows);
            *rows = NULL;
            *row_count = 0;
        }
    }
    return status;
}
