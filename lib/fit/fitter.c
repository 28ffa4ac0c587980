/* Fitters: making, freeing, and moving the sums of depths between host and device. */
#include "fit/fitter.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/options.h"
#include "filter/layout.h"
#include "runtime/kernel.h"

enum { GROUP = 64 };

/* What is tried: the weight of the other depths makes lambda less important, so not every combination is worth its
 * time. */
typedef struct setting {
    double alpha, lambda;
} setting;
static const setting several[] = {{0.0, 1e-6},  {0.0, 1e-5},  {0.0, 1e-4}, {0.0, 1e-3}, {0.0, 1e-2},
                                  {0.03, 1e-5}, {0.03, 1e-3}, {0.1, 1e-4}, {0.3, 1e-4}, {1.0, 1e-4}};
static const setting lambdas[] = {{0.0, 1e-6}, {0.0, 1e-5}, {0.0, 3e-5}, {0.0, 1e-4}, {0.0, 3e-4},
                                  {0.0, 1e-3}, {0.0, 3e-3}, {0.0, 1e-2}, {0.0, 3e-2}, {0.0, 1e-1}};
static const setting alphas[] = {{0.0, 0.0}, {0.03, 0.0}, {0.1, 0.0}, {0.3, 0.0}, {1.0, 0.0}};
static const setting one[] = {{0.0, 0.0}};

void hada_fit_options_defaults(hada_fit_options *options, size_t size)
{
    const hada_fit_options own = {.size = sizeof own,
                                  .boundary = HADA_BOUNDARY_CIRCULAR,
                                  .form = HADA_FORM_COMPLEX,
                                  .alpha = -1.0,
                                  .lambda = -1.0,
                                  .outside = -1.0,
                                  .refine_steps = -1,
                                  .refine_tv = -1.0,
                                  .nonnegative = 1};
    HADA_OPTIONS_GIVE(options, size, &own);
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
    if (!(options->outside <= 1.0) || (options->outside >= 0.0 && options->outside < HADA_FIT_LEAST_OUTSIDE))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "the weight outside the window is %g; it must lie between %g and 1, or be negative to have it "
                         "chosen",
                         options->outside, HADA_FIT_LEAST_OUTSIDE);
    return HADA_OK;
}

/* The settings to score, less what the caller fixed. One depth has no others, so alpha means nothing there. */
static hada_status make_settings(hada_fitter *fitter, hada_error *err)
{
    const hada_fit_options *options = &fitter->options;
    const int fixed_alpha = options->alpha >= 0.0 || options->depths == 1, fixed_lambda = options->lambda >= 0.0;
    const setting *list = fixed_alpha ? (fixed_lambda ? one : lambdas) : fixed_lambda ? alphas : several;
    fitter->distinct = (int)(list == one ? 1 : list == alphas ? HADA_COUNT(alphas) : HADA_COUNT(several));
    fitter->setting_count = (fitter->distinct + HADA_FIT_TRIALS - 1) / HADA_FIT_TRIALS * HADA_FIT_TRIALS;
    const size_t count = (size_t)fitter->setting_count;
    hada_status status = hada_alloc((void **)&fitter->alphas, count, sizeof(double), "settings", err);
    if (!status)
        status = hada_alloc((void **)&fitter->lambdas, count, sizeof(double), "settings", err);
    for (int i = 0; !status && i < fitter->setting_count; i++) {
        const setting *from = &list[i < fitter->distinct ? i : fitter->distinct - 1];
        fitter->alphas[i] = fixed_alpha ? fmax(options->alpha, 0.0) : from->alpha;
        fitter->lambdas[i] = fixed_lambda ? options->lambda : from->lambda;
    }
    return status;
}

static hada_status make_host_side(hada_fitter *fitter, hada_error *err)
{
    const hada_model_info *info = &fitter->info;
    const size_t channels = (size_t)info->channels, settings = (size_t)fitter->setting_count;
    const size_t raw = (size_t)info->raw_rows * (size_t)info->raw_cols;
    const size_t window = (size_t)info->window_rows * (size_t)info->window_cols;
    hada_status status = hada_alloc_raw((void **)&fitter->raw_pixels, channels * raw, 4, "a raw frame", err);
    if (!status)
        status = hada_alloc_raw((void **)&fitter->scene_pixels, channels * window, 4, "a scene", err);
    if (!status)
        status = hada_alloc_raw((void **)&fitter->room, raw, 4, "a raw frame", err);
    if (!status)
        status = hada_alloc((void **)&fitter->raw_energy, channels, sizeof(double), "a fitter", err);
    if (!status)
        status = hada_alloc((void **)&fitter->scene_energy, channels, sizeof(double), "a fitter", err);
    if (!status)
        status = hada_alloc((void **)&fitter->depth, (size_t)info->depths, sizeof *fitter->depth, "a fitter", err);
    for (int z = 0; !status && z < info->depths; z++) {
        hada_fitter_depth *depth = &fitter->depth[z];
        status = hada_alloc((void **)&depth->raw_energy, channels, sizeof(double), "a fitter", err);
        if (!status)
            status = hada_alloc((void **)&depth->scene_energy, channels, sizeof(double), "a fitter", err);
        if (!status)
            status = hada_alloc((void **)&depth->single, settings, sizeof(double), "a fitter", err);
        if (!status)
            status = hada_alloc((void **)&depth->twofold, settings, sizeof(double), "a fitter", err);
    }
    return status;
}

hada_fft_desc hada_fitter_describe(const hada_fitter *fitter, hada_fft_direction direction, int window)
{
    const hada_model_info *info = &fitter->info;
    const hada_geometry *at = &fitter->geometry;
    const int rows = window ? info->window_rows : info->raw_rows, cols = window ? info->window_cols : info->raw_cols;
    return (hada_fft_desc){.direction = direction,
                           .rows = info->grid_rows,
                           .cols = info->grid_cols,
                           .batch = info->channels,
                           .row0 = window ? at->window_row : at->raw_row,
                           .col0 = window ? at->window_col : at->raw_col,
                           .real_rows = rows,
                           .real_cols = cols,
                           .real_pitch = (size_t)cols,
                           .real_distance = (size_t)rows * (size_t)cols};
}

static hada_status make_buffer(hada_fitter *fitter, hada_buffer *buffer, size_t bytes, const char *what,
                               hada_error *err)
{
    hada_status status = hada_buffer_create(buffer, fitter->context, bytes, what, err);
    fitter->bytes += buffer->bytes;
    return status;
}

static hada_status make_device_side(hada_fitter *fitter, hada_error *err)
{
    const hada_fft_desc raw = hada_fitter_describe(fitter, HADA_FFT_FORWARD, 0);
    const hada_fft_desc scene = hada_fitter_describe(fitter, HADA_FFT_FORWARD, 1);
    const size_t channels = (size_t)fitter->info.channels;
    hada_status status = hada_fft_create(&fitter->raw_fft, fitter->slot, &raw, err);
    if (!status)
        status = hada_fft_create(&fitter->scene_fft, fitter->slot, &scene, err);
    if (status)
        return status;
    fitter->bytes += hada_fft_bytes(fitter->context, &raw) + hada_fft_bytes(fitter->context, &scene);
    fitter->layout = *hada_fft_plan_layout(fitter->raw_fft);
    fitter->vectors = (fitter->layout.count + 7) / 8;
    fitter->stride = (fitter->vectors + GROUP - 1) / GROUP * GROUP * 8;
    fitter->chunks = (int)((fitter->vectors + HADA_FIT_CHUNK - 1) / HADA_FIT_CHUNK);
    const size_t pools = fitter->sum_count == HADA_FIT_SUMS ? 3 : 5, spectra = channels * fitter->layout.count * 8 + 64;
    status = make_buffer(fitter, &fitter->raw, channels * raw.real_distance * 4, "a raw frame", err);
    if (!status)
        status = make_buffer(fitter, &fitter->scene, channels * scene.real_distance * 4, "a scene", err);
    if (!status)
        status = make_buffer(fitter, &fitter->b, spectra, "a raw frame's spectrum", err);
    if (!status)
        status = make_buffer(fitter, &fitter->x, spectra, "a scene's spectrum", err);
    for (size_t c = 0; !status && c < channels; c++) {
        status = make_buffer(fitter, &fitter->sums[c], 8 * (size_t)fitter->sum_count * fitter->stride,
                             "the sums of a fit", err);
        if (!status)
            status = make_buffer(fitter, &fitter->pool[c], 4 * pools * fitter->stride, "the pooled sums of a fit", err);
    }
    if (!status)
        status = make_buffer(fitter, &fitter->weights, 4 * fitter->stride, "the weights of frequencies", err);
    if (!status)
        status = make_buffer(fitter, &fitter->settings, 8 * HADA_FIT_TRIALS, "settings", err);
    const size_t sums = (size_t)(fitter->chunks > fitter->info.window_rows ? fitter->chunks : fitter->info.window_rows);
    if (!status)
        status = make_buffer(fitter, &fitter->partial, 4 * HADA_FIT_TRIALS * sums, "partial sums", err);
    return status;
}

static hada_status fill_weights(hada_fitter *fitter, hada_error *err)
{
    float *values;
    hada_status status = hada_alloc((void **)&values, fitter->stride, sizeof *values, "the weights", err);
    if (status)
        return status;
    hada_layout_weights(&fitter->layout, values);
    status = hada_buffer_write(&fitter->weights, fitter->slot, 0, values, fitter->stride * sizeof *values, err);
    free(values);
    return status;
}

hada_status hada_fitter_create(hada_fitter **out, hada_context *context, const hada_fit_options *callers,
                               hada_error *err)
{
    hada_fitter *fitter;
    hada_fit_options own, *options = &own;
    if (!out || !context || !callers)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_create: out, a context and options are needed");
    *out = NULL;
    hada_fit_options_init(options);
    hada_status status = HADA_OPTIONS_TAKE(options, callers, hada_fit_options, err);
    if (!status)
        status = check_options(options, err);
    if (status)
        return status;
    hada_model_info info = {.depths = options->depths,
                            .channels = options->channels,
                            .form = options->form,
                            .boundary = options->boundary,
                            .dark = options->dark,
                            .has_otf = 1,
                            .distances_mm = options->distances_mm};
    status = hada_model_set_sizes(&info, options->raw_rows, options->raw_cols, options->window_rows,
                                  options->window_cols, err);
    if (!status)
        status = hada_model_info_check(&info, err);
    if (!status)
        status = hada_alloc((void **)&fitter, 1, sizeof *fitter, "a fitter", err);
    if (status)
        return status;
    fitter->context = context;
    fitter->options = *options;
    fitter->info = info;
    fitter->current = -1;
    fitter->sum_count = options->form == HADA_FORM_SPLIT ? HADA_FIT_SUMS_SPLIT : HADA_FIT_SUMS;
    fitter->macros = options->form == HADA_FORM_SPLIT ? "-DFIT_SPLIT=1" : "";
    const size_t depths = (size_t)info.depths, channels = (size_t)info.channels;
    status = hada_geometry_of(&info, &fitter->geometry, err);
    if (!status)
        status = hada_alloc((void **)&fitter->distances, depths, sizeof(double), "the distances", err);
    if (!status) {
        memcpy(fitter->distances, options->distances_mm, depths * sizeof(double));
        fitter->options.distances_mm = fitter->info.distances_mm = fitter->distances;
        status = hada_alloc((void **)&fitter->sums, channels, sizeof *fitter->sums, "a fitter", err);
    }
    if (!status)
        status = hada_alloc((void **)&fitter->pool, channels, sizeof *fitter->pool, "a fitter", err);
    if (!status)
        status = make_settings(fitter, err);
    if (!status)
        status = make_host_side(fitter, err);
    if (!status)
        status = hada_slot_create(&fitter->slot, context, err);
    if (!status)
        status = make_device_side(fitter, err);
    if (!status)
        status = fill_weights(fitter, err);
    if (status)
        hada_fitter_destroy(&fitter);
    *out = fitter;
    return status;
}

void hada_fitter_destroy(hada_fitter **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_fitter *fitter = *pointer;
    *pointer = NULL;
    if (fitter->slot)
        hada_slot_finish(fitter->slot, NULL);
    hada_fft_destroy(&fitter->raw_fft);
    hada_fft_destroy(&fitter->scene_fft);
    hada_fft_destroy(&fitter->trial_fft);
    hada_nonnegative_destroy(&fitter->nonnegative);
    hada_buffer *single[] = {&fitter->raw,      &fitter->scene,   &fitter->b,     &fitter->x,     &fitter->weights,
                             &fitter->settings, &fitter->partial, &fitter->trial, &fitter->planes};
    for (size_t i = 0; i < HADA_COUNT(single); i++)
        hada_buffer_destroy(single[i]);
    for (int c = 0; c < fitter->info.channels; c++) {
        if (fitter->sums)
            hada_buffer_destroy(&fitter->sums[c]);
        if (fitter->pool)
            hada_buffer_destroy(&fitter->pool[c]);
    }
    for (int z = 0; fitter->depth && z < fitter->info.depths; z++) {
        free(fitter->depth[z].sums);
        free(fitter->depth[z].raw_energy);
        free(fitter->depth[z].scene_energy);
        free(fitter->depth[z].single);
        free(fitter->depth[z].twofold);
    }
    hada_fitter_drop_kept(fitter);
    hada_fitter_drop_judged(fitter);
    void *arrays[] = {fitter->sums,         fitter->pool,       fitter->depth,       fitter->distances,
                      fitter->alphas,       fitter->lambdas,    fitter->room,        fitter->raw_pixels,
                      fitter->scene_pixels, fitter->raw_energy, fitter->scene_energy};
    for (size_t i = 0; i < HADA_COUNT(arrays); i++)
        free(arrays[i]);
    hada_slot_destroy(&fitter->slot);
    free(fitter);
}

hada_status hada_fitter_prepare_trials(hada_fitter *fitter, hada_error *err)
{
    hada_fft_desc desc = hada_fitter_describe(fitter, HADA_FFT_INVERSE, 1);
    hada_status status = HADA_OK;
    if (fitter->planes.mem)
        return HADA_OK;
    desc.batch = HADA_FIT_TRIALS;
    if (!fitter->trial_fft) {
        status = hada_fft_create(&fitter->trial_fft, fitter->slot, &desc, err);
        fitter->bytes += status ? 0 : hada_fft_bytes(fitter->context, &desc);
    }
    if (!status && !fitter->trial.mem)
        status = make_buffer(fitter, &fitter->trial, HADA_FIT_TRIALS * fitter->layout.count * 8 + 64,
                             "leave-one-out spectra", err);
    if (!status)
        status =
            make_buffer(fitter, &fitter->planes, HADA_FIT_TRIALS * desc.real_distance * 4, "leave-one-out errors", err);
    return status;
}

uint64_t hada_fitter_bytes(const hada_fitter *fitter)
{
    return fitter->bytes;
}

int64_t hada_fitter_pairs(const hada_fitter *fitter, int depth)
{
    return depth >= 0 && depth < fitter->info.depths ? fitter->depth[depth].pairs : 0;
}

hada_status hada_fitter_launch(hada_fitter *fitter, const char *file, const char *name, const hada_arg *args,
                               size_t arg_count, hada_error *err)
{
    cl_kernel kernel;
    const size_t local = GROUP, global = (fitter->vectors + GROUP - 1) / GROUP * GROUP;
    hada_status status = hada_slot_kernel(fitter->slot, file, name, fitter->macros, &kernel, err);
    return status ? status : hada_slot_launch(fitter->slot, kernel, name, 1, &global, &local, args, arg_count, err);
}

hada_status hada_fitter_put_back(hada_fitter *fitter, hada_error *err)
{
    const size_t count = 2 * (size_t)fitter->sum_count * fitter->stride, channels = (size_t)fitter->info.channels;
    hada_fitter_depth *depth = &fitter->depth[fitter->current];
    hada_status status = HADA_OK;
    if (!depth->sums)
        status = hada_alloc_raw((void **)&depth->sums, channels * count, sizeof(float), "the sums of a depth", err);
    for (size_t c = 0; !status && c < channels; c++)
        status = hada_buffer_read(&fitter->sums[c], fitter->slot, 0, depth->sums + c * count, count * 4, err);
    if (!status)
        fitter->changed = 0;
    return status;
}

hada_status hada_fitter_select(hada_fitter *fitter, int depth, hada_error *err)
{
    const size_t count = 2 * (size_t)fitter->sum_count * fitter->stride;
    hada_status status = HADA_OK;
    if (fitter->current == depth)
        return HADA_OK;
    if (fitter->current >= 0 && fitter->changed)
        status = hada_fitter_put_back(fitter, err);
    if (status)
        return status;
    fitter->current = -1;
    for (int c = 0; !status && c < fitter->info.channels; c++)
        status = fitter->depth[depth].sums
                     ? hada_buffer_write(&fitter->sums[c], fitter->slot, 0,
                                         fitter->depth[depth].sums + (size_t)c * count, count * 4, err)
                     : hada_buffer_clear(&fitter->sums[c], fitter->slot, 0, count * 4, err);
    if (!status)
        fitter->current = depth;
    fitter->changed = 0;
    return status;
}

hada_status hada_fitter_pool(hada_fitter *fitter, hada_error *err)
{
    hada_status status = HADA_OK;
    if (fitter->pooled)
        return HADA_OK;
    for (int c = 0; !status && c < fitter->info.channels; c++)
        status = hada_buffer_clear(&fitter->pool[c], fitter->slot, 0, fitter->pool[c].bytes, err);
    for (int z = 0; !status && z < fitter->info.depths; z++) {
        if (!fitter->depth[z].pairs)
            continue;
        status = hada_fitter_select(fitter, z, err);
        const cl_float per_pair = 1.0f / (float)fitter->depth[z].pairs;
        const cl_ulong stride = fitter->stride, vectors = fitter->vectors;
        for (int c = 0; !status && c < fitter->info.channels; c++) {
            hada_arg args[] = {HADA_ARG(fitter->sums[c].mem), HADA_ARG(fitter->pool[c].mem), HADA_ARG(stride),
                               HADA_ARG(per_pair), HADA_ARG(vectors)};
            hada_slot_cost(fitter->slot, (fitter->sum_count > 4 ? 416.0 : 256.0) * (double)vectors,
                           48.0 * (double)vectors);
            status = hada_fitter_launch(fitter, "fit_sums", "fit_pool", args, HADA_COUNT(args), err);
        }
    }
    fitter->pooled = !status;
    return status;
}
