/* The end of a fit: what pairs held out choose, what is learned from them beside the sums, and a model. */

#include "fit/cropped.h"
#include "fit/fitter.h"
#include "refine/admm.h"

/* Refinement of a model whose fit did not measure it: what pays with an exact model of the camera
 * (docs/explanation/learning-a-camera.md). */
#define REFINE_STEPS 12
/* Decibels by which refinement must lead so that filters are not judged in the window: more than judging was seen to
 * gain (docs/explanation/learning-a-camera.md). */
#define ENOUGH_GAIN 3.0

/* Pairs whose errors are found: so many in all, and at least so many of each depth. The settings are compared on the
 * same pairs, so a few decide (docs/explanation/learning-a-camera.md). */
enum { SCORED_IN_ALL = 8, SCORED_PER_DEPTH = 2 };

void hada_fit_forget(hada_fitter *fitter)
{
    hada_leave_one_out_forget(&fitter->scores);
    hada_fit_kept_free(&fitter->kept);
    fitter->weighted = 0;
    hada_fit_outside_free(&fitter->outside);
    hada_fit_transfers_free(&fitter->transfers);
    fitter->rows = (hada_fit_rows){0};
}

hada_status hada_fit_score_pair(hada_fitter *fitter, int depth, int number, const hada_image *raw,
                                const hada_image *scene, const hada_image *weights, hada_error *err)
{
    hada_fit_pair *pair = &fitter->pair;
    HADA_TRY(hada_fit_pair_check(&fitter->grid, depth, raw, scene, err));
    HADA_TRY(hada_fit_sums_pool(&fitter->sums, err));
    HADA_TRY(hada_fit_sums_select(&fitter->sums, depth, err));
    hada_fit_pair_take(pair, raw, scene, weights);
    fitter->weighted |= pair->weighted;
    HADA_TRY(hada_fit_pair_transform(pair, pair->raw_pixels, pair->scene_pixels, err));
    HADA_TRY(hada_leave_one_out_add(&fitter->scores, &fitter->sums, pair, depth, err));
    return fitter->options.refine_steps < 0 ? hada_fit_keep(&fitter->kept, pair, depth, number, err) : HADA_OK;
}

static hada_status fit_score_pairs(hada_fitter *fitter, const hada_dataset *pairs, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(pairs);
    const int share = (SCORED_IN_ALL + info->depths - 1) / info->depths;
    const int most = share < SCORED_PER_DEPTH ? SCORED_PER_DEPTH : share;
    hada_pair pair = {0};
    hada_status status = HADA_OK;
    long total = 0;
    for (int z = 0; z < info->depths; z++)
        total += hada_least(info->counts[z], most);
    hada_progress progress = hada_progress_begin(fitter->options.monitor, "leave-one-out", total);
    for (int z = 0; z < info->depths; z++) {
        const int count = hada_least(info->counts[z], most);
        for (int i = 0; i < count; i++) {
            const int number = (int)((long)i * info->counts[z] / count); /* evenly spread */
            HADA_TRY_OR_DONE(hada_pair_take(&pair, pairs, z, number, err));
            status = hada_fit_score_pair(fitter, z, number, pair.raw, pair.scene, pair.weights, err);
            if (status)
                hada_pair_name(pairs, z, number, err);
            HADA_TRY_OR_DONE(status);
            hada_pair_return(&pair);
            HADA_TRY_OR_DONE(hada_progress_step(&progress, NULL, err));
        }
    }
    HADA_TRY_OR_DONE(hada_leave_one_out_share(&fitter->scores, err));
done:
    hada_pair_return(&pair);
    hada_progress_end(&progress);
    return status;
}

hada_status hada_fit_learn_cropped(hada_fitter *fitter, const hada_dataset *pairs, hada_error *err)
{
    const hada_fit_options *options = &fitter->options;
    const int circular = options->boundary == HADA_BOUNDARY_CIRCULAR;
    const int lacks = options->mosaic != HADA_MOSAIC_NONE || (circular && fitter->weighted); /* much inside the frame */
    const int times = lacks ? HADA_FIT_CROP_MOSAIC : 1;
    const int passes = options->crop_passes < 0 ? times * HADA_FIT_CROP_PASSES : options->crop_passes;
    hada_fit_reader from;
    hada_status status = HADA_OK;
    hada_fit_transfers_free(&fitter->transfers);
    if ((circular && !lacks) || !options->nonnegative || !passes) /* frames show all light of the scenes */
        return HADA_OK;
    HADA_TRY(hada_fit_reader_create(&from, pairs, &fitter->pair, options->monitor,
                                    "looks at pairs, for the light beyond the sensor", err));
    status = hada_fit_transfers_learn(&fitter->transfers, &fitter->sums, &from, &fitter->kept, passes, err);
    hada_fit_reader_destroy(&from);
    return status;
}

hada_status hada_fit_learn_windowed(hada_fitter *fitter, const hada_dataset *pairs, hada_error *err)
{
    hada_fit_reader from;
    hada_status status = HADA_OK;
    hada_fit_outside_free(&fitter->outside);
    HADA_TRY(hada_fit_reader_create(&from, pairs, &fitter->pair, fitter->options.monitor,
                                    "looks at pairs, to judge in the window", err));
    status = hada_fit_outside_solve(&fitter->outside, &fitter->sums, &from, hada_leave_one_out_best(&fitter->scores),
                                    fitter->options.outside, err);
    hada_fit_reader_destroy(&from);
    return status;
}

hada_fit_scores hada_fit_rows_list(hada_fit_rows *rows)
{
    for (int i = 0; i < rows->filters; i++)
        rows->filter_list[i] = &rows->filter[i];
    for (int i = 0; i < rows->outsides; i++)
        rows->outside_list[i] = &rows->outside[i];
    for (int i = 0; i < rows->refinements; i++)
        rows->refinement_list[i] = &rows->refinement[i];
    return (hada_fit_scores){rows->filter_list, rows->outside_list, rows->refinement_list};
}

/* The settings (where pairs were scored) and the weights outside the window that were compared. */
static void fill_rows(hada_fitter *fitter)
{
    const hada_fit_outside *outside = &fitter->outside;
    hada_fit_rows *rows = &fitter->rows;
    *rows = (hada_fit_rows){.filters = hada_leave_one_out_row_count(&fitter->scores), .outsides = outside->count};
    hada_leave_one_out_rows(&fitter->scores, rows->filter);
    for (int s = 0; s < outside->count; s++)
        rows->outside[s] = (hada_fit_outside_score){
            .outside = outside->weight[s], .psnr = outside->psnr[s], .chosen = s == outside->chosen};
}

/* Decibels by which the chosen refinement leads the linear filters, one depth occupied; 0 where it was not tried. */
static double refinement_gain(const hada_fit_rows *rows)
{
    double gain = 0.0;
    for (int i = 1; i < rows->refinements; i++)
        if (rows->refinement[i].chosen)
            gain = rows->refinement[i].psnr_single - rows->refinement[0].psnr_single;
    return isfinite(gain) ? gain : 0.0;
}

static void set_refinement(hada_model *model, int steps, const hada_refine_weights *weights)
{
    model->info.refine_steps = steps;
    model->info.refine_tv = weights->tv;
    model->info.refine_colour = weights->colour;
    model->info.refine_ridge = weights->tv > 0.0 ? weights->ridge : 0.0;
    model->info.refine_rho = hada_refine_rho(model->info.boundary, weights->tv);
}

/* The weights that options ask for: tv 0 and what photographs favour where they leave them open. */
static hada_refine_weights weights_of(const hada_fit_options *options)
{
    return (hada_refine_weights){fmax(options->refine_tv, 0.0),
                                 options->refine_colour >= 0.0 ? options->refine_colour : HADA_REFINE_COLOUR,
                                 options->refine_ridge >= 0.0 ? options->refine_ridge : HADA_REFINE_RIDGE};
}

/* Tries refinement on the pairs that were kept. The trial compares with the exact fit's filters; where judging them in
 * the window gained more than refinement does, the model keeps the filters. */
static hada_status try_refinement(hada_fitter *fitter, hada_nonnegative *nonnegative, hada_model *model,
                                  hada_error *err)
{
    const hada_fit_trial trial = {.sums = &fitter->sums,
                                  .pair = &fitter->pair,
                                  .nonnegative = nonnegative,
                                  .kept = &fitter->kept,
                                  .model = model,
                                  .tv = fitter->options.refine_tv,
                                  .colour = fitter->options.refine_colour,
                                  .ridge = fitter->options.refine_ridge};
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
    memcpy(fitter->rows.refinement, result.rows, (size_t)result.row_count * sizeof *result.rows);
    fitter->rows.refinements = result.row_count;
    set_refinement(model, result.steps, &result.weights);
    if (result.weights.tv > 0.0) {
        model->info.refine_noise = result.noise.of_light;
        model->info.refine_noise_largest = result.noise.of_largest;
    }
    model->info.refine_share = result.share;
    return HADA_OK;
}

hada_status hada_fit_solve(hada_fitter *fitter, hada_model **out, hada_error *err)
{
    const hada_fit_options *options = &fitter->options;
    const hada_model_info *info = &fitter->grid.info;
    const hada_refine_weights weights = weights_of(options);
    hada_nonnegative *nonnegative = NULL;
    hada_status status = HADA_OK;
    fill_rows(fitter);
    if (options->nonnegative)
        HADA_TRY_OR_DONE(hada_nonnegative_create(&nonnegative, fitter->grid.slot, info->grid_rows, info->grid_cols,
                                                 info->channels, err));
    HADA_TRY_OR_DONE(hada_fit_model_make(out, &fitter->sums, hada_leave_one_out_best(&fitter->scores),
                                         fitter->outside.filters, &fitter->transfers, nonnegative, err));
    set_refinement(*out, options->refine_steps < 0 ? REFINE_STEPS : options->refine_steps, &weights);
    if (options->refine_steps >= 0)
        goto done;
    status = try_refinement(fitter, nonnegative, *out, err);
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

/* Holds a data set against the sums. *complete: it has all of their pairs; *spare: a pair of each depth can be left out
 * of the sums. */
static hada_status compare(const hada_fitter *fitter, const hada_dataset *pairs, int *complete, int *spare,
                           hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(pairs);
    if (info->depths != fitter->grid.info.depths)
        return hada_fail(err, HADA_ERROR_STATE, "the data set has %d depths, the fit %d", info->depths,
                         fitter->grid.info.depths);
    *complete = *spare = 1;
    for (int z = 0; z < info->depths; z++) {
        const int64_t in_sums = fitter->sums.depth[z].pairs;
        if (info->counts[z] > in_sums)
            return hada_fail(err, HADA_ERROR_STATE, "depth %d (%g mm) has %d pairs, but only %lld are in the sums", z,
                             fitter->grid.distances[z], info->counts[z], (long long)in_sums);
        *complete &= info->counts[z] == in_sums;
        *spare &= in_sums > 1;
    }
    return HADA_OK;
}

static hada_status learn_and_solve(hada_fitter *fitter, const hada_dataset *pairs, hada_model **out, hada_error *err)
{
    const hada_fit_options *options = &fitter->options;
    int complete = 0, spare = 0;
    if (pairs)
        HADA_TRY(compare(fitter, pairs, &complete, &spare, err));
    if (spare && options->leave_one_out)
        HADA_TRY(fit_score_pairs(fitter, pairs, err));
    if (complete)
        HADA_TRY(hada_fit_learn_cropped(fitter, pairs, err));
    if (!complete || (!options->leave_one_out && options->outside < 0.0))
        return hada_fit_solve(fitter, out, err);
    /* refinement is tried where its steps are open; otherwise there is nothing to know before judging */
    if (options->outside < 0.0 && options->refine_steps < 0) {
        HADA_TRY(hada_fit_solve(fitter, out, err));
        if (refinement_gain(&fitter->rows) > ENOUGH_GAIN)
            return HADA_OK;
        hada_model_destroy(out);
    }
    HADA_TRY(hada_fit_learn_windowed(fitter, pairs, err));
    return hada_fit_solve(fitter, out, err);
}

hada_status hada_fitter_finish(hada_fitter *fitter, const hada_dataset *pairs, hada_model **out, hada_error *err)
{
    HADA_NEED(fitter && out, err);
    *out = NULL;
    hada_fit_forget(fitter);
    hada_slot_watch(fitter->grid.slot, fitter->options.monitor);
    const hada_status status = learn_and_solve(fitter, pairs, out, err);
    hada_slot_watch(fitter->grid.slot, NULL);
    if (status)
        hada_model_destroy(out);
    return status;
}
