/* Fitters: options, sums of pairs, and models of given filters. */
#include "fit/fitter.h"

#include <hadalens/response.h>

#include "core/clock.h"
#include "io/folder.h"

static int all_finite(const float *values, size_t count)
{
    int good = 1;
    for (size_t i = 0; i < count; i++)
        good &= isfinite(values[i]) != 0;
    return good;
}

/* Copies filters or transfer functions, unless there are none. */
static hada_status copy_values(float *to, const float *values, size_t count, hada_error *err)
{
    if (!values)
        return HADA_OK;
    if (!all_finite(values, count))
        return hada_fail(err, HADA_ERROR_NOT_FINITE, "filters or transfer functions hold NaN or infinite values");
    memcpy(to, values, count * sizeof *to);
    return HADA_OK;
}

hada_status hada_model_from_filters(hada_model **out, const hada_fit_options *callers, const float *filters,
                                    const float *otf, hada_error *err)
{
    hada_fit_options sizes;
    hada_model_info info;
    hada_status status = HADA_OK;
    HADA_NEED(out && callers, err);
    *out = NULL;
    hada_fit_options_init(&sizes);
    HADA_TRY(HADA_OPTIONS_TAKE(&sizes, callers, hada_fit_options, err));
    HADA_TRY(hada_fit_info(&info, &sizes, err));
    info.has_otf = otf != NULL;
    HADA_TRY(hada_model_create(out, &info, 0, err));
    const size_t count = 2 * (size_t)info.depths * (size_t)info.channels * hada_model_plane(*out);
    HADA_TRY_OR_DONE(copy_values((*out)->filter, filters, count, err));
    HADA_TRY_OR_DONE(copy_values((*out)->otf, otf, count, err));
done:
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
    if (!hada_model_weight_is_given(options->alpha) || !hada_model_weight_is_given(options->lambda) ||
        !hada_model_weight_is_given(options->refine_tv) || !hada_model_weight_is_given(options->refine_steps) ||
        options->refine_steps > HADA_MODEL_MOST_STEPS || !hada_model_weight_is_given(options->dark))
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "options.alpha is %g, lambda %g, refine_tv %g, refine_steps %d and dark %g: they are HADA_AUTO, "
            "or 0 to %g, and at most %d steps",
            options->alpha, options->lambda, options->refine_tv, options->refine_steps, options->dark,
            HADA_MODEL_MOST_WEIGHT, HADA_MODEL_MOST_STEPS);
    if (options->scene_response != HADA_AUTO && !hada_response_is_known(options->scene_response))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the response of the scenes, %g, is none (hadalens/response.h)",
                         options->scene_response);
    if (options->refine_colour != HADA_AUTO && !hada_refine_colour_known(options->refine_colour))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "the weight of colour in total variation is %g; it must lie between 1 and %g, or be "
                         "HADA_AUTO to have it chosen",
                         options->refine_colour, HADA_REFINE_MOST_COLOUR);
    if (options->refine_ridge != HADA_AUTO && !hada_refine_ridge_known(options->refine_ridge))
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "the strength of the learned regulariser is %g; it must lie between 0 and %g, or be HADA_AUTO to have it "
            "chosen",
            options->refine_ridge, HADA_REFINE_MOST_RIDGE);
    if (options->outside != HADA_AUTO && !(options->outside >= HADA_FIT_LEAST_OUTSIDE && options->outside <= 1.0))
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "the weight outside the window is %g; it must lie between %g and 1, or be HADA_AUTO to have it "
            "chosen",
            options->outside, HADA_FIT_LEAST_OUTSIDE);
    if (options->crop_passes && options->crop_passes != HADA_AUTO && options->crop_passes < HADA_FIT_LEAST_PASSES)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "crop_passes is %d; it must be at least %d, or 0 for none, or HADA_AUTO to have it chosen",
                         options->crop_passes, HADA_FIT_LEAST_PASSES);
    return HADA_OK;
}

static hada_status create(hada_fitter **out, hada_context *context, const hada_fit_options *options, hada_error *err)
{
    hada_fitter *fitter = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(check_options(options, err));
    HADA_TRY_OR_DONE(HADA_NEW(fitter, 1, "a fitter", err));
    fitter->options = *options;
    fitter->options.distances_mm = NULL;
    fitter->options.sums = NULL;
    fitter->options.communicator = NULL; /* the grid has it */
    HADA_TRY_OR_DONE(hada_fit_grid_create(&fitter->grid, context, options, err));
    HADA_TRY_OR_DONE(HADA_NEW(fitter->pairs, (size_t)options->depths, "a fitter", err));
    HADA_TRY_OR_DONE(hada_leave_one_out_create(&fitter->scores, &fitter->grid, options, err));
    HADA_TRY_OR_DONE(hada_fit_pair_create(&fitter->pair, &fitter->grid, err));
    HADA_TRY_OR_DONE(hada_fit_sums_create(&fitter->sums, &fitter->grid, err));
done:
    if (status)
        hada_fitter_destroy(&fitter);
    *out = fitter;
    return status;
}

hada_status hada_fitter_create(hada_fitter **out, hada_context *context, const hada_fit_options *callers,
                               hada_error *err)
{
    hada_fit_options options;
    hada_tensors *file = NULL;
    hada_status status = HADA_OK;
    HADA_NEED(out && context && callers, err);
    *out = NULL;
    hada_fit_options_init(&options);
    HADA_TRY(HADA_OPTIONS_TAKE(&options, callers, hada_fit_options, err));
    if (options.sums) {
        HADA_TRY_OR_DONE(hada_tensors_open(&file, options.sums, err));
        HADA_TRY_OR_DONE(hada_fit_sums_camera(file, options.sums, &options, err));
    }
    HADA_TRY_OR_DONE(create(out, context, &options, err));
    if (file)
        HADA_TRY_OR_DONE(hada_fitter_load_sums(*out, options.sums, err));
done:
    hada_tensors_close(&file);
    if (status)
        hada_fitter_destroy(out);
    return status;
}

void hada_fitter_destroy(hada_fitter **pointer)
{
    hada_fitter *fitter = hada_taken(pointer);
    if (!fitter)
        return;
    if (fitter->grid.slot)
        hada_slot_finish(fitter->grid.slot, NULL);
    hada_fit_transfers_free(&fitter->transfers);
    hada_fit_outside_free(&fitter->outside);
    hada_fit_kept_free(&fitter->kept);
    hada_leave_one_out_destroy(&fitter->scores);
    hada_fit_sums_destroy(&fitter->sums);
    hada_fit_pair_destroy(&fitter->pair);
    hada_fit_grid_destroy(&fitter->grid);
    HADA_FREE(fitter->pairs, fitter);
}

const hada_fitter_info *hada_fitter_get_info(hada_fitter *fitter)
{
    if (!fitter)
        return NULL;
    for (int z = 0; z < fitter->grid.info.depths; z++)
        fitter->pairs[z] = fitter->sums.depth[z].pairs;
    fitter->list = hada_fit_rows_list(&fitter->rows);
    fitter->info = (hada_fitter_info){.depths = fitter->grid.info.depths,
                                      .distances_mm = fitter->grid.distances,
                                      .bytes = fitter->pair.bytes + fitter->sums.bytes + fitter->scores.bytes,
                                      .pairs = fitter->pairs,
                                      .scores = &fitter->list};
    return &fitter->info;
}

hada_status hada_fitter_add_pair(hada_fitter *fitter, int depth, const hada_image *raw, const hada_image *scene,
                                 hada_error *err)
{
    hada_fit_pair *pair = &fitter->pair;
    HADA_TRY(hada_fit_pair_check(&fitter->grid, depth, raw, scene, err));
    hada_fit_pair_take(pair, raw, scene, NULL);
    HADA_TRY(hada_fit_pair_transform(pair, pair->raw_pixels, pair->scene_pixels, err));
    return hada_fit_sums_add(&fitter->sums, depth, pair, err);
}

/* Distances of one depth differ by rounding alone. */
#define SAME_DISTANCE 1e-9

/* The fitter's depth of a data set's; -1: it has none at that distance. */
static int depth_of(const hada_fitter *fitter, double distance_mm)
{
    for (int z = 0; z < fitter->grid.info.depths; z++)
        if (fabs(fitter->grid.distances[z] - distance_mm) <= SAME_DISTANCE * distance_mm)
            return z;
    return -1;
}

/* Whole depths are dealt to ranks where none then has over so much of its fair share of pairs, as sums of a depth that
 * are one rank's are handed on as they are. Otherwise each depth's pairs are shared. */
#define FAIR 1.1

static int deals_depths(const hada_communicator *ranks, const hada_dataset_info *info)
{
    const int count = hada_ranks(ranks);
    long most = 0;
    for (int r = 0; r < count; r++) {
        long load = 0;
        for (int z = r; z < info->depths; z += count)
            load += info->counts[z];
        most = load > most ? load : most;
    }
    return (double)most * count <= FAIR * info->pairs;
}

/* This rank's pairs of a depth. */
typedef struct range {
    int begin, end;
} range;

static range share_of(const hada_communicator *ranks, const hada_dataset_info *info, int z)
{
    const int count = info->counts[z];
    if (deals_depths(ranks, info))
        return (range){0, hada_is_mine(ranks, z) ? count : 0};
    return (range){(int)hada_share_begin(ranks, count, hada_rank(ranks)),
                   (int)hada_share_begin(ranks, count, hada_rank(ranks) + 1)};
}

/* Pairs that are added from a data set, and when sums were saved. */
typedef struct adding {
    hada_fitter *fitter;
    const hada_dataset *pairs;
    const hada_dataset_info *info;
    const hada_fit_part *part;
    double saved, took; /* seconds: the time of the last save, and what it took */
    hada_progress progress;
} adding;

/* A save may take a twentieth of the time. */
enum { SAVE_SHARE = 20 };

static hada_status save_part(adding *of, hada_error *err)
{
    const hada_fit_part *part = of->part;
    const double now = hada_seconds();
    if (!part->path || now - of->saved < part->seconds || now - of->saved < SAVE_SHARE * of->took)
        return HADA_OK;
    const hada_status status = hada_fit_sums_save(&of->fitter->sums, part->path, 1, err);
    of->saved = hada_seconds();
    of->took = of->saved - now;
    return status;
}

/* Pairs that an interrupted fit has added already. */
static hada_status resume(adding *of, hada_error *err)
{
    const hada_fit_part *part = of->part;
    if (!part->path || !part->resume || !hada_path_is_file(part->path))
        return HADA_OK;
    HADA_TRY(hada_named(hada_fitter_load_sums(of->fitter, part->path, err), part->path, err));
    for (int z = 0; z < of->info->depths; z++) {
        const range mine = share_of(&of->fitter->grid.communicator, of->info, z);
        if (of->fitter->sums.depth[depth_of(of->fitter, of->info->distances_mm[z])].pairs > mine.end - mine.begin)
            return hada_fail(err, HADA_ERROR_STATE,
                             "%s holds more pairs than the data set: it belongs to another one; remove it, or leave "
                             "out options.resume",
                             part->path);
    }
    return HADA_OK;
}

static hada_status add_one(const adding *of, int z, int i, hada_error *err)
{
    hada_pair pair;
    HADA_TRY(hada_pair_take(&pair, of->pairs, z, i, err));
    if (i + 1 < of->info->counts[z])
        hada_pair_expect(of->pairs, z, i + 1);
    const hada_status status =
        hada_fitter_add_pair(of->fitter, depth_of(of->fitter, of->info->distances_mm[z]), pair.raw, pair.scene, err);
    if (status)
        hada_pair_name(of->pairs, z, i, err);
    hada_pair_return(&pair);
    return status;
}

/* This rank's pairs that are not in the sums yet. */
static hada_status add_share(adding *of, hada_error *err)
{
    for (int z = 0; z < of->info->depths; z++) {
        const range mine = share_of(&of->fitter->grid.communicator, of->info, z);
        const int64_t there =
            of->part->path ? of->fitter->sums.depth[depth_of(of->fitter, of->info->distances_mm[z])].pairs : 0;
        for (int i = mine.begin; i < mine.end; i++) {
            if (i - mine.begin >= there) {
                HADA_TRY(add_one(of, z, i, err));
                HADA_TRY(save_part(of, err));
            }
            HADA_TRY(hada_progress_step(&of->progress, NULL, err));
        }
    }
    return HADA_OK;
}

static hada_status check_pairs(const hada_fitter *fitter, const hada_dataset_info *info, hada_error *err)
{
    if (fitter->reduced)
        return hada_fail(err, HADA_ERROR_STATE, "the sums are those of all ranks: nothing more can be added to them");
    if (info->mosaic != fitter->grid.info.mosaic)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "the colour filter mosaic of the data set is not that of this fit: give both options.mosaic");
    if (info->downsample != fitter->grid.info.downsample || info->sensor_mosaic != fitter->grid.info.sensor_mosaic)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "the data set bins its frames by %d, this fit expects %d: give both options.downsample, and "
                         "the same mosaic",
                         info->downsample, fitter->grid.info.downsample);
    for (int z = 0; z < info->depths; z++)
        if (depth_of(fitter, info->distances_mm[z]) < 0)
            return hada_fail(err, HADA_ERROR_ARGUMENT, "this fit has no depth at %g mm, as the data set has",
                             info->distances_mm[z]);
    return HADA_OK;
}

hada_status hada_fitter_add_part(hada_fitter *fitter, const hada_dataset *pairs, const hada_fit_part *part,
                                 hada_error *err)
{
    adding of = {
        .fitter = fitter, .pairs = pairs, .info = hada_dataset_get_info(pairs), .part = part, .saved = hada_seconds()};
    long total = 0;
    hada_status status = HADA_OK;
    HADA_TRY(check_pairs(fitter, of.info, err));
    if (part->path)
        HADA_TRY(hada_fit_sums_check_part(part->path, err));
    for (int z = 0; z < of.info->depths; z++) {
        const range mine = share_of(&fitter->grid.communicator, of.info, z);
        total += mine.end - mine.begin;
    }
    of.progress = hada_progress_begin(fitter->options.monitor, "pairs", total);
    HADA_TRY_OR_DONE(resume(&of, err));
    status = add_share(&of, err);
    if (status == HADA_ERROR_CANCELLED && part->path)
        hada_fit_sums_save(&fitter->sums, part->path, 1,
                           NULL); /* the caller gets 'cancelled', whatever becomes of it */
    HADA_TRY_OR_DONE(status);
    HADA_TRY_OR_DONE(hada_fitter_reduce(fitter, err));
done:
    hada_progress_end(&of.progress);
    return status;
}

hada_status hada_fitter_add(hada_fitter *fitter, const hada_dataset *pairs, hada_error *err)
{
    static const hada_fit_part none = {0};
    HADA_NEED(fitter && pairs, err);
    return hada_fitter_add_part(fitter, pairs, &none, err);
}

hada_status hada_fitter_reduce(hada_fitter *fitter, hada_error *err)
{
    if (fitter->grid.communicator.count == 1)
        return HADA_OK;
    fitter->reduced = 1;
    return hada_fit_sums_reduce(&fitter->sums, err);
}

hada_status hada_fitter_save_sums(hada_fitter *fitter, const char *path, hada_error *err)
{
    HADA_NEED(fitter && path, err);
    return hada_fit_sums_save(&fitter->sums, path, 0, err);
}

hada_status hada_fitter_load_sums(hada_fitter *fitter, const char *path, hada_error *err)
{
    HADA_NEED(fitter && path, err);
    return hada_fit_sums_load(&fitter->sums, path, err);
}
