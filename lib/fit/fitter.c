/* The public face of a fit, as far as the sums and what is chosen on pairs held out. */
#include "fit/fitter.h"

#include <hadalens/response.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/callers.h"
#include "fit/cropped.h"
#include "fit/sums_file.h"
#include "fit/sums_reduce.h"

hada_status hada_model_blank(hada_model **out, const hada_fit_options *callers, hada_error *err)
{
    hada_fit_options sizes;
    hada_model_info info;
    if (!out || !callers)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_model_blank: out and sizes are needed");
    *out = NULL;
    HADA_TRY(HADA_OPTIONS_TAKE(&sizes, callers, hada_fit_options, err));
    HADA_TRY(hada_fit_info(&info, &sizes, err));
    return hada_model_create(out, &info, 0, err);
}

static int all_finite(const float *values, size_t count)
{
    int good = 1;
    for (size_t i = 0; i < count; i++)
        good &= isfinite(values[i]) != 0;
    return good;
}

hada_status hada_model_from_filters(hada_model **out, const hada_fit_options *sizes, const float *filters,
                                    const float *otf, hada_error *err)
{
    hada_model *blank = NULL;
    hada_status status = HADA_OK;
    if (!out || !sizes || !filters)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_model_from_filters: out, sizes and filters are needed");
    *out = NULL;
    HADA_TRY_OR_DONE(hada_model_blank(&blank, sizes, err));
    hada_model_info info = blank->info;
    info.has_otf = otf != NULL;
    HADA_TRY_OR_DONE(hada_model_create(out, &info, 0, err));
    const size_t values = 2 * (size_t)info.depths * (size_t)info.channels * hada_model_plane(*out);
    if (!all_finite(filters, values) || (otf && !all_finite(otf, values)))
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_NOT_FINITE, "filters or transfer functions hold NaN or infinite values"));
    memcpy((*out)->filter, filters, values * sizeof *filters);
    if (otf)
        memcpy((*out)->otf, otf, values * sizeof *otf);
done:
    hada_model_destroy(&blank);
    if (status)
        hada_model_destroy(out);
    return status;
}

static hada_status check_options(const hada_fit_options *options, hada_error *err)
{
    if (options->form != HADA_FORM_COMPLEX && options->form != HADA_FORM_SPLIT)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "pairs give filters of the forms complex and split; matched and wiener are made from point "
                         "spread functions");
    if (!options->distances_mm)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the distances of the depths are needed");
    if (!isfinite(options->alpha) || !isfinite(options->lambda) || !isfinite(options->refine_tv) ||
        !isfinite(options->dark))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "alpha, lambda and the dark level must be finite");
    if (options->scene_response != HADA_AUTO && !hada_response_is_known(options->scene_response))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the response of the scenes, %g, is none (hadalens/response.h)",
                         options->scene_response);
    if (!isfinite(options->refine_colour) ||
        (options->refine_colour >= 0.0 && !hada_refine_colour_known(options->refine_colour)))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "the weight of colour in total variation is %g; it must lie between 1 and %g, or be negative "
                         "to have it chosen",
                         options->refine_colour, HADA_REFINE_MOST_COLOUR);
    if (!isfinite(options->refine_shrink) ||
        (options->refine_shrink >= 0.0 && !hada_refine_shrink_known(options->refine_shrink)))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "the threshold of shrinkage is %g; it must lie between 0 and %g, or be negative to have it "
                         "chosen",
                         options->refine_shrink, HADA_REFINE_MOST_SHRINK);
    if (!(options->outside <= 1.0) || (options->outside >= 0.0 && options->outside < HADA_FIT_LEAST_OUTSIDE))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "the weight outside the window is %g; it must lie between %g and 1, or be negative to have it "
                         "chosen",
                         options->outside, HADA_FIT_LEAST_OUTSIDE);
    if (options->crop_passes > 0 && options->crop_passes < HADA_FIT_LEAST_PASSES)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "crop_passes is %d; it must be at least %d, or 0 for none, or negative to have it chosen",
                         options->crop_passes, HADA_FIT_LEAST_PASSES);
    return HADA_OK;
}

hada_status hada_fitter_create(hada_fitter **out, hada_context *context, const hada_fit_options *callers,
                               hada_error *err)
{
    hada_fitter *fitter = NULL;
    hada_fit_options options;
    hada_status status = HADA_OK;
    if (!out || !context || !callers)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_create: out, a context and options are needed");
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&options, callers, hada_fit_options, err));
    HADA_TRY_OR_DONE(check_options(&options, err));
    HADA_TRY_OR_DONE(hada_allocated(fitter = hada_alloc(1, sizeof *fitter, "a fitter", err)));
    fitter->options = options;
    fitter->options.distances_mm = NULL;
    fitter->options.communicator = NULL; /* the grid has it */
    HADA_TRY_OR_DONE(hada_fit_grid_create(&fitter->grid, context, &options, err));
    HADA_TRY_OR_DONE(hada_leave_one_out_create(&fitter->scores, &fitter->grid, &options, err));
    HADA_TRY_OR_DONE(hada_fit_pair_create(&fitter->pair, &fitter->grid, err));
    HADA_TRY_OR_DONE(hada_fit_sums_create(&fitter->sums, &fitter->grid, err));
done:
    if (status)
        hada_fitter_destroy(&fitter);
    *out = fitter;
    return status;
}

/* What was chosen for other sums. */
static void forget_choices(hada_fitter *fitter)
{
    hada_leave_one_out_forget(&fitter->scores);
    hada_fit_kept_free(&fitter->kept);
    hada_fit_outside_free(&fitter->outside);
    hada_fit_transfers_free(&fitter->transfers);
}

void hada_fitter_destroy(hada_fitter **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_fitter *fitter = *pointer;
    *pointer = NULL;
    if (fitter->grid.slot)
        hada_slot_finish(fitter->grid.slot, NULL);
    hada_fit_transfers_free(&fitter->transfers);
    hada_fit_outside_free(&fitter->outside);
    hada_fit_kept_free(&fitter->kept);
    hada_leave_one_out_destroy(&fitter->scores);
    hada_fit_sums_destroy(&fitter->sums);
    hada_fit_pair_destroy(&fitter->pair);
    hada_fit_grid_destroy(&fitter->grid);
    free(fitter);
}

uint64_t hada_fitter_bytes(const hada_fitter *fitter)
{
    if (!fitter)
        return 0;
    return fitter->pair.bytes + fitter->sums.bytes + fitter->scores.bytes;
}

int64_t hada_fitter_pairs(const hada_fitter *fitter, int depth)
{
    if (!fitter)
        return 0;
    return depth >= 0 && depth < fitter->grid.info.depths ? fitter->sums.depth[depth].pairs : 0;
}

hada_status hada_fitter_add(hada_fitter *fitter, int depth, const hada_image *raw, const hada_image *scene,
                            hada_error *err)
{
    hada_status status = HADA_OK;
    if (!fitter)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_add: a fitter is needed");
    hada_fit_pair *pair = &fitter->pair;
    const uint64_t before = fitter->sums.version;
    HADA_TRY_OR_DONE(hada_fit_pair_check(&fitter->grid, depth, raw, scene, err));
    hada_fit_pair_take(pair, raw, scene);
    HADA_TRY_OR_DONE(hada_fit_pair_transform(pair, pair->raw_pixels, pair->scene_pixels, err));
    HADA_TRY_OR_DONE(hada_fit_sums_add(&fitter->sums, depth, pair, err));
done:
    if (fitter->sums.version != before)
        forget_choices(fitter);
    return status;
}

hada_status hada_fitter_reduce(hada_fitter *fitter, hada_error *err)
{
    if (!fitter)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_reduce: a fitter is needed");
    if (fitter->grid.communicator.count == 1)
        return HADA_OK;
    forget_choices(fitter);
    return hada_fit_sums_reduce(&fitter->sums, err);
}

hada_status hada_fitter_save_sums(hada_fitter *fitter, const char *path, hada_error *err)
{
    if (!fitter || !path)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_save_sums: a fitter and a path are needed");
    return hada_fit_sums_save(&fitter->sums, path, err);
}

hada_status hada_fitter_load_sums(hada_fitter *fitter, const char *path, hada_error *err)
{
    if (!fitter || !path)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_load_sums: a fitter and a path are needed");
    const uint64_t before = fitter->sums.version;
    const hada_status status = hada_fit_sums_load(&fitter->sums, path, err);
    if (fitter->sums.version != before)
        forget_choices(fitter);
    return status;
}

hada_status hada_fitter_create_from_sums(hada_fitter **out, hada_context *context, const char *path,
                                         const hada_fit_options *choices, hada_error *err)
{
    hada_fit_options options;
    hada_tensors *file = NULL;
    hada_status status = HADA_OK;
    if (!out || !context || !path)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_create_from_sums: out, context and path are needed");
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&options, choices, hada_fit_options, err));
    HADA_TRY_OR_DONE(hada_tensors_open(&file, path, err));
    HADA_TRY_OR_DONE(hada_fit_sums_camera(file, path, &options, err));
    HADA_TRY_OR_DONE(hada_fitter_create(out, context, &options, err));
    HADA_TRY_OR_DONE(hada_fitter_load_sums(*out, path, err));
done:
    hada_tensors_close(&file);
    if (status)
        hada_fitter_destroy(out);
    return status;
}

hada_status hada_fitter_score(hada_fitter *fitter, int depth, const hada_image *raw, const hada_image *scene,
                              hada_error *err)
{
    if (!fitter)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_score: a fitter is needed");
    hada_fit_pair *pair = &fitter->pair;
    HADA_TRY(hada_fit_pair_check(&fitter->grid, depth, raw, scene, err));
    const int64_t pairs = fitter->sums.depth[depth].pairs;
    if (!pairs)
        return hada_fail(err, HADA_ERROR_STATE, "a pair was scored at depth %d (%g mm), whose sums are empty", depth,
                         fitter->grid.distances[depth]);
    if (!hada_leave_one_out_wants(&fitter->scores, depth, pairs))
        return HADA_OK;
    hada_fit_outside_free(&fitter->outside); /* alpha and lambda may change */
    HADA_TRY(hada_fit_sums_pool(&fitter->sums, err));
    HADA_TRY(hada_fit_sums_select(&fitter->sums, depth, err));
    hada_fit_pair_take(pair, raw, scene);
    HADA_TRY(hada_fit_pair_transform(pair, pair->raw_pixels, pair->scene_pixels, err));
    HADA_TRY(hada_leave_one_out_add(&fitter->scores, &fitter->sums, pair, depth, err));
    if (fitter->options.refine_steps < 0)
        HADA_TRY(hada_fit_keep(&fitter->kept, pair, depth, err));
    return HADA_OK;
}

hada_status hada_fitter_learn_cropped(hada_fitter *fitter, hada_fit_show show, void *user, hada_error *err)
{
    if (!fitter || !show)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "hada_fitter_learn_cropped: a fitter and a function that shows pairs are needed");
    const hada_fit_options *options = &fitter->options;
    const int passes = options->crop_passes < 0 ? HADA_FIT_CROP_PASSES : options->crop_passes;
    hada_fit_transfers_free(&fitter->transfers);
    if (options->boundary != HADA_BOUNDARY_PADDED || !options->nonnegative || !passes)
        return HADA_OK;
    hada_slot_watch(fitter->grid.slot, options->monitor);
    const hada_status status = hada_fit_transfers_learn(&fitter->transfers, &fitter->sums, &fitter->pair, &fitter->kept,
                                                        passes, show, user, err);
    hada_slot_watch(fitter->grid.slot, NULL);
    return status;
}

hada_status hada_fitter_learn_windowed(hada_fitter *fitter, hada_fit_show show, void *user, hada_error *err)
{
    if (!fitter || !show)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "hada_fitter_learn_windowed: a fitter and a function that shows pairs are needed");
    hada_fit_outside_free(&fitter->outside);
    hada_status status = hada_leave_one_out_share(&fitter->scores, err);
    if (status)
        return status;
    hada_slot_watch(fitter->grid.slot, fitter->options.monitor);
    status = hada_fit_outside_solve(&fitter->outside, &fitter->sums, &fitter->pair,
                                    hada_leave_one_out_best(&fitter->scores), fitter->options.outside, show, user, err);
    hada_slot_watch(fitter->grid.slot, NULL);
    return status;
}
