/* The second pass: leave-one-out errors of pairs over a grid of alpha and lambda, and the choice. */
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "fit/fitter.h"
#include "program/kernel.h"

/* Enqueues the errors of one channel of the pair in fitter->x and fitter->b; reads and adds them up in order. */
static hada_status score_channel(hada_fitter *fitter, int z, int channel, float *partial, double *own, double *others,
                                 hada_error *err)
{
    const hada_fitter_depth *depth = &fitter->depth[z];
    const int lanes = fitter->context->shape == HADA_SHAPE_LANES, count = fitter->setting_count;
    const size_t chunks = (size_t)fitter->chunks, group = lanes ? 1 : 32;
    const size_t local[] = {1, group}, global[] = {(size_t)count, (chunks + group - 1) / group * group};
    const cl_ulong offset = (cl_ulong)channel * fitter->layout.count, stride = fitter->stride;
    const cl_ulong vectors = fitter->vectors;
    const cl_int settings = count, chunk_count = fitter->chunks;
    const cl_float scale = (cl_float)depth->raw_energy[channel], per_pair = 1.0f / (cl_float)depth->pairs;
    int others_there = 0;
    for (int other = 0; other < fitter->info.depths; other++)
        others_there += other != z && fitter->depth[other].pairs > 0;
    const cl_float per_other = others_there ? 1.0f / (cl_float)others_there : 0.0f;
    cl_kernel kernel;
    hada_status status = hada_slot_kernel(fitter->slot, "fit_score", "fit_leave_one_out", fitter->macros, &kernel, err);
    hada_arg args[] = {HADA_ARG(fitter->x.mem),
                       HADA_ARG(fitter->b.mem),
                       HADA_ARG(offset),
                       HADA_ARG(fitter->sums[channel].mem),
                       HADA_ARG(fitter->pool[channel].mem),
                       HADA_ARG(stride),
                       HADA_ARG(fitter->weights.mem),
                       HADA_ARG(fitter->settings.mem),
                       HADA_ARG(settings),
                       HADA_ARG(scale),
                       HADA_ARG(per_pair),
                       HADA_ARG(per_other),
                       HADA_ARG(fitter->partial.mem),
                       HADA_ARG(chunk_count),
                       HADA_ARG(vectors)};
    if (!status)
        status =
            hada_slot_launch(fitter->slot, kernel, "fit_leave_one_out", 2, global, local, args, HADA_COUNT(args), err);
    if (!status)
        status = hada_buffer_read(&fitter->partial, fitter->slot, 0, partial, 8 * (size_t)count * chunks, err);
    for (size_t s = 0; !status && s < (size_t)count; s++)
        for (size_t i = 0; i < chunks; i++) {
            own[s] += partial[s * chunks + i];
            others[s] += partial[((size_t)count + s) * chunks + i];
        }
    return status;
}

hada_status hada_fitter_score(hada_fitter *fitter, int depth, const hada_image *raw, const hada_image *scene,
                              hada_error *err)
{
    float *partial = NULL;
    double *own = NULL;
    if (!fitter)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_score: a fitter is needed");
    hada_status status = hada_fitter_transform(fitter, depth, raw, scene, err);
    if (status)
        return status;
    hada_fitter_depth *to = &fitter->depth[depth];
    if (!to->pairs)
        return hada_fail(err, HADA_ERROR_STATE, "a pair was scored at depth %d (%g mm), whose sums are empty", depth,
                         fitter->distances[depth]);
    if (to->pairs < 2)
        return HADA_OK; /* nothing would be left without it */
    const size_t count = (size_t)fitter->setting_count;
    status = hada_fitter_pool(fitter, err);
    if (!status)
        status = hada_fitter_select(fitter, depth, err);
    if (!status)
        status = hada_alloc_raw((void **)&partial, 2 * count * (size_t)fitter->chunks, sizeof(float), "scores", err);
    if (!status)
        status = hada_alloc((void **)&own, 2 * count, sizeof(double), "scores", err);
    for (int c = 0; !status && c < fitter->info.channels; c++)
        status = score_channel(fitter, depth, c, partial, own, own + count, err);
    for (size_t s = 0; !status && s < count; s++) {
        to->own[s] += own[s];
        to->others[s] += own[count + s];
    }
    to->scored += !status;
    free(partial);
    free(own);
    return status;
}

/* Mean squared error per pixel of the window for an error summed over whole half spectra. */
static double mean_square(const hada_fitter *fitter, double sum, double pairs)
{
    const hada_model_info *info = &fitter->info;
    return sum / pairs / ((double)info->grid_rows * info->grid_cols) /
           ((double)info->window_rows * info->window_cols * info->channels);
}

/* Decibels of a setting, means over scored depths; 0 where nothing was scored. */
static int decibels(const hada_fitter *fitter, size_t setting, double *single, double *twofold)
{
    int depths = 0;
    *single = *twofold = 0.0;
    for (int z = 0; z < fitter->info.depths; z++) {
        const hada_fitter_depth *depth = &fitter->depth[z];
        if (!depth->scored)
            continue;
        depths++;
        const double own = mean_square(fitter, depth->own[setting], (double)depth->scored);
        const double both = mean_square(fitter, depth->own[setting] + depth->others[setting], (double)depth->scored);
        *single -= 10.0 * log10(fmax(own, 1e-20));
        *twofold -= 10.0 * log10(fmax(both, 1e-20));
    }
    if (depths) {
        *single /= depths;
        *twofold /= depths;
    }
    return depths;
}

size_t hada_fitter_best(const hada_fitter *fitter, int *scored)
{
    size_t best = 0;
    double most = -INFINITY;
    *scored = 0;
    for (size_t s = 0; s < (size_t)fitter->setting_count; s++) {
        double single, twofold;
        if (!decibels(fitter, s, &single, &twofold))
            return 0;
        *scored = 1;
        if (single + twofold > most) {
            most = single + twofold;
            best = s;
        }
    }
    return best;
}

hada_status hada_fitter_rows(const hada_fitter *fitter, size_t best, hada_fit_row **rows, size_t *count,
                             hada_error *err)
{
    *count = (size_t)fitter->setting_count;
    hada_status status = hada_alloc((void **)rows, *count, sizeof **rows, "the leave-one-out table", err);
    for (size_t s = 0; !status && s < *count; s++) {
        hada_fit_row *row = &(*rows)[s];
        row->alpha = fitter->alphas[s];
        row->lambda = fitter->lambdas[s];
        row->chosen = s == best;
        if (!decibels(fitter, s, &row->psnr_single, &row->psnr_double))
            row->psnr_single = row->psnr_double = NAN;
        if (fitter->info.depths == 1)
            row->psnr_double = NAN;
    }
    return status;
}
