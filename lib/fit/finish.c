/* The end of a fit: the setting that leave-one-out prefers, a model, and whether refinement pays. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "fit/fit_model.h"
#include "fit/fitter.h"
#include "refine/admm.h"

/* Refinement of a model whose fit did not measure it: what pays with an exact model of the camera (docs/filters.md). */
#define REFINE_STEPS 12
/* Decibels by which refinement must lead so that filters are not judged in the window: more than judging was seen to
 * gain (docs/filters.md). */
#define ENOUGH_GAIN 3.0

/* The rows of a table, in parts. */
typedef struct table {
    hada_fit_row *rows;
    size_t count;
} table;

static hada_fit_row *append(table *all, size_t count, hada_error *err)
{
    hada_fit_row *rows = realloc(all->rows, (all->count + count) * sizeof *rows);
    if (!rows) {
        hada_fail(err, HADA_ERROR_MEMORY, "no memory for the leave-one-out table");
        return NULL;
    }
    all->rows = rows;
    all->count += count;
    return rows + all->count - count;
}

/* Rows for the settings (where scored) and for the weights outside the window that were compared. */
static hada_status list_filters(const hada_fitter *fitter, table *all, hada_error *err)
{
    const hada_fit_outside *outside = &fitter->outside;
    const hada_fit_setting setting = hada_leave_one_out_best(&fitter->scores);
    const int settings = hada_leave_one_out_row_count(&fitter->scores);
    if (!settings && !outside->count)
        return HADA_OK;
    hada_fit_row *rows = append(all, (size_t)settings + (size_t)outside->count, err);
    if (!rows)
        return HADA_ERROR_MEMORY;
    hada_leave_one_out_rows(&fitter->scores, rows);
    for (int s = 0; s < outside->count; s++)
        rows[settings + s] = (hada_fit_row){.alpha = setting.alpha,
                                            .lambda = setting.lambda,
                                            .outside = outside->weight[s],
                                            .psnr_single = outside->psnr[s],
                                            .psnr_double = NAN,
                                            .chosen = s == outside->chosen};
    return HADA_OK;
}

static void set_refinement(hada_model *model, int steps, const hada_refine_weights *weights)
{
    model->info.refine_steps = steps;
    model->info.refine_tv = weights->tv;
    model->info.refine_colour = weights->colour;
    model->info.refine_rho = hada_refine_rho(model->info.boundary, weights->tv);
}

/* The weights that options ask for: tv 0 and colour HADA_REFINE_COLOUR where they leave them open. */
static hada_refine_weights weights_of(const hada_fit_options *options)
{
    return (hada_refine_weights){fmax(options->refine_tv, 0.0),
                                 options->refine_colour >= 0.0 ? options->refine_colour : HADA_REFINE_COLOUR};
}

/* Tries refinement on the pairs that were kept. The trial compares with the exact fit's filters; where judging them in
 * the window gained more than refinement does, the model keeps the filters. */
static hada_status try_refinement(hada_fitter *fitter, hada_nonnegative *nonnegative, hada_model *model, table *all,
                                  hada_error *err)
{
    const hada_fit_trial trial = {.sums = &fitter->sums,
                                  .pair = &fitter->pair,
                                  .nonnegative = nonnegative,
                                  .kept = &fitter->kept,
                                  .model = model,
                                  .tv = fitter->options.refine_tv,
                                  .colour = fitter->options.refine_colour};
    hada_fit_trial_result result;
    hada_status status = HADA_OK;
    if (!fitter->kept.count)
        return HADA_OK;
    HADA_TRY(hada_fit_trial_run(&trial, &result, err));
    hada_fit_row *rows = append(all, (size_t)result.row_count, err);
    if (!rows)
        return HADA_ERROR_MEMORY;
    if (result.steps && result.gain <= hada_fit_outside_gain(&fitter->outside)) {
        result.steps = 0;
        result.share = 1.0;
        result.weights.tv = 0.0;
        for (int i = 0; i < result.row_count; i++)
            result.rows[i].chosen = i == 0;
    }
    memcpy(rows, result.rows, (size_t)result.row_count * sizeof *rows);
    set_refinement(model, result.steps, &result.weights);
    model->info.refine_share = result.share;
done:
    return status;
}

/* Solves, and tries on pairs held out whether refinement pays. */
static hada_status solve_and_try(hada_fitter *fitter, hada_model **out, table *all, hada_error *err)
{
    const hada_fit_options *options = &fitter->options;
    const hada_model_info *info = &fitter->grid.info;
    hada_nonnegative *nonnegative = NULL;
    hada_status status = HADA_OK;
    if (options->nonnegative)
        HADA_TRY(hada_nonnegative_create(&nonnegative, fitter->grid.slot, info->grid_rows, info->grid_cols,
                                         info->channels, err));
    HADA_TRY(hada_fit_model_make(out, &fitter->sums, hada_leave_one_out_best(&fitter->scores), fitter->outside.filters,
                                 &fitter->transfers, nonnegative, err));
    HADA_TRY(list_filters(fitter, all, err));
    const hada_refine_weights weights = weights_of(options);
    set_refinement(*out, options->refine_steps < 0 ? REFINE_STEPS : options->refine_steps, &weights);
    if (options->refine_steps >= 0)
        goto done;
    status = try_refinement(fitter, nonnegative, *out, all, err);
    if (status == HADA_ERROR_DEVICE_MEMORY || status == HADA_ERROR_MEMORY) {
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

hada_status hada_fitter_finish(hada_fitter *fitter, hada_model **out, hada_fit_row **rows, size_t *row_count,
                               hada_error *err)
{
    table all = {0};
    if (!fitter || !out || (rows && !row_count))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_finish: a fitter, out and row_count are needed");
    *out = NULL;
    const hada_status status = solve_and_try(fitter, out, &all, err);
    if (status)
        hada_model_destroy(out);
    if (status || !rows) {
        free(all.rows);
        all = (table){0};
    }
    if (rows) {
        *rows = all.rows;
        *row_count = all.count;
    }
    return status;
}

/* By how much the trial found refinement better than the linear filters, in decibels, one depth occupied; 0 where it
 * was not tried. */
static double refinement_gain(const hada_fit_row *rows, size_t count)
{
    double linear = NAN, gain = 0.0;
    for (size_t i = 0; i < count; i++) {
        if (!(rows[i].refine_rho > 0.0))
            continue;
        if (!isfinite(linear))
            linear = rows[i].psnr_single;
        if (rows[i].chosen)
            gain = rows[i].psnr_single - linear;
    }
    return isfinite(gain) ? gain : 0.0;
}

hada_status hada_fitter_learn_and_finish(hada_fitter *fitter, hada_fit_show show, void *user, hada_model **out,
                                         hada_fit_row **rows, size_t *row_count, hada_error *err)
{
    hada_status status = HADA_OK;
    if (!fitter || !show || !out || !rows || !row_count)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "hada_fitter_learn_and_finish: a fitter, a function that shows pairs, out and rows are "
                         "needed");
    if (!fitter->transfers.otf)
        HADA_TRY(hada_fitter_learn_cropped(fitter, show, user, err));
    /* refinement is tried where its steps are not given; without that there is nothing to learn before judging */
    if (fitter->options.outside < 0.0 && fitter->options.refine_steps < 0) {
        HADA_TRY(hada_fitter_finish(fitter, out, rows, row_count, err));
        if (refinement_gain(*rows, *row_count) > ENOUGH_GAIN)
            return HADA_OK;
        hada_model_destroy(out);
        free(*rows);
        *rows = NULL;
        *row_count = 0;
    }
    HADA_TRY(hada_fitter_learn_windowed(fitter, show, user, err));
    HADA_TRY(hada_fitter_finish(fitter, out, rows, row_count, err));
done:
    return status;
}

void hada_fit_rows_destroy(hada_fit_row **rows)
{
    if (!rows)
        return;
    free(*rows);
    *rows = NULL;
}
