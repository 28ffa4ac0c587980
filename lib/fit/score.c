/* The second pass: leave-one-out errors of pairs over a grid of alpha and lambda, and the choice. */
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "fit/fitter.h"
#include "runtime/kernel.h"

/* Pairs that are tried: the settings are compared on the same pairs, so a few decide. */
enum { PAIRS_IN_ALL = 8, PAIRS_PER_DEPTH = 2 };

/* Reads partial sums and adds each setting's, in order. */
static hada_status add_up(hada_fitter *fitter, float *partial, size_t count, double factor, double *sums,
                          hada_error *err)
{
    hada_status status =
        hada_buffer_read(&fitter->partial, fitter->slot, 0, partial, HADA_FIT_TRIALS * count * sizeof *partial, err);
    for (size_t s = 0; !status && s < HADA_FIT_TRIALS; s++) {
        double sum = 0.0;
        for (size_t i = 0; i < count; i++)
            sum += partial[s * count + i];
        sums[s] += factor * sum;
    }
    return status;
}

/* The error spectra of HADA_FIT_TRIALS settings from `first` on, into fitter->trial; the leaks into fitter->partial. */
static hada_status enqueue_trial(hada_fitter *fitter, int z, int channel, size_t first, hada_error *err)
{
    const hada_fitter_depth *depth = &fitter->depth[z];
    const size_t local = fitter->context->shape == HADA_SHAPE_LANES ? 1 : 32;
    const size_t global = ((size_t)fitter->chunks + local - 1) / local * local;
    const cl_ulong count = fitter->layout.count, offset = (cl_ulong)channel * count, stride = fitter->stride;
    const cl_ulong vectors = fitter->vectors;
    const cl_int chunks = fitter->chunks;
    const cl_float scale = (cl_float)depth->raw_energy[channel], per_pair = 1.0f / (cl_float)depth->pairs;
    cl_float settings[2 * HADA_FIT_TRIALS];
    int others = 0;
    for (int other = 0; other < fitter->info.depths; other++)
        others += other != z && fitter->depth[other].pairs > 0;
    const cl_float per_other = others ? 1.0f / (cl_float)others : 0.0f;
    for (size_t i = 0; i < HADA_FIT_TRIALS; i++) {
        settings[2 * i] = (cl_float)fitter->alphas[first + i];
        settings[2 * i + 1] = (cl_float)fitter->lambdas[first + i];
    }
    cl_kernel kernel;
    hada_status status = hada_buffer_write(&fitter->settings, fitter->slot, 0, settings, sizeof settings, err);
    if (!status)
        status = hada_slot_kernel(fitter->slot, "fit_score", "fit_trial", fitter->macros, &kernel, err);
    hada_arg args[] = {HADA_ARG(fitter->x.mem),
                       HADA_ARG(fitter->b.mem),
                       HADA_ARG(offset),
                       HADA_ARG(fitter->sums[channel].mem),
                       HADA_ARG(fitter->pool[channel].mem),
                       HADA_ARG(stride),
                       HADA_ARG(fitter->weights.mem),
                       HADA_ARG(fitter->settings.mem),
                       HADA_ARG(scale),
                       HADA_ARG(per_pair),
                       HADA_ARG(per_other),
                       HADA_ARG(fitter->trial.mem),
                       HADA_ARG(count),
                       HADA_ARG(fitter->partial.mem),
                       HADA_ARG(chunks),
                       HADA_ARG(vectors)};
    hada_slot_cost(fitter->slot, 32.0 * (double)vectors * (8.0 + 2.0 * fitter->sum_count + 2.0 * HADA_FIT_TRIALS),
                   160.0 * (double)vectors * HADA_FIT_TRIALS);
    return status
               ? status
               : hada_slot_launch(fitter->slot, kernel, "fit_trial", 1, &global, &local, args, HADA_COUNT(args), err);
}

/* Squared errors within the window, per row, into fitter->partial. */
static hada_status enqueue_energy(hada_fitter *fitter, hada_error *err)
{
    const cl_int rows = fitter->info.window_rows, cols = fitter->info.window_cols;
    const size_t group = fitter->context->shape == HADA_SHAPE_LANES ? 1 : 32;
    const size_t local[] = {group, 1}, global[] = {((size_t)rows + group - 1) / group * group, HADA_FIT_TRIALS};
    cl_kernel kernel;
    hada_status status =
        hada_fft_inverse(fitter->trial_fft, HADA_FIT_TRIALS, fitter->trial.mem, 0, fitter->planes.mem, 0, NULL, err);
    if (!status)
        status = hada_slot_kernel(fitter->slot, "fit_score", "fit_energy", fitter->macros, &kernel, err);
    hada_arg args[] = {HADA_ARG(fitter->planes.mem), HADA_ARG(rows), HADA_ARG(cols), HADA_ARG(fitter->partial.mem)};
    hada_slot_cost(fitter->slot, 4.0 * rows * cols * HADA_FIT_TRIALS, 2.0 * rows * cols * HADA_FIT_TRIALS);
    return status ? status
                  : hada_slot_launch(fitter->slot, kernel, "fit_energy", 2, global, local, args, HADA_COUNT(args), err);
}

/* Leave-one-out errors of the pair in fitter->x and fitter->b, all channels and settings. */
static hada_status score_pair(hada_fitter *fitter, int z, float *partial, double *own, double *others, hada_error *err)
{
    const double per_pixel = 1.0 / ((double)fitter->info.grid_rows * fitter->info.grid_cols);
    hada_status status = HADA_OK;
    for (int c = 0; !status && c < fitter->info.channels; c++)
        for (size_t s = 0; !status && s < (size_t)fitter->setting_count; s += HADA_FIT_TRIALS) {
            status = enqueue_trial(fitter, z, c, s, err);
            if (!status)
                status = add_up(fitter, partial, (size_t)fitter->chunks, per_pixel, others + s, err);
            if (!status)
                status = enqueue_energy(fitter, err);
            if (!status)
                status = add_up(fitter, partial, (size_t)fitter->info.window_rows, 1.0, own + s, err);
        }
    return status;
}

/* PSNR of a squared error summed over the window and its channels, for a peak of 1. */
static double decibels(const hada_fitter *fitter, double sum)
{
    const hada_model_info *info = &fitter->info;
    return -10.0 * log10(fmax(sum / ((double)info->window_rows * info->window_cols * info->channels), 1e-20));
}

hada_status hada_fitter_score(hada_fitter *fitter, int depth, const hada_image *raw, const hada_image *scene,
                              hada_error *err)
{
    float *partial = NULL;
    double *own = NULL;
    if (!fitter)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fitter_score: a fitter is needed");
    hada_status status = hada_fitter_check_pair(fitter, depth, raw, scene, err);
    if (status)
        return status;
    hada_fitter_depth *to = &fitter->depth[depth];
    if (!to->pairs)
        return hada_fail(err, HADA_ERROR_STATE, "a pair was scored at depth %d (%g mm), whose sums are empty", depth,
                         fitter->distances[depth]);
    const int depths = fitter->info.depths, share = (PAIRS_IN_ALL + depths - 1) / depths;
    /* of a single pair nothing would be left; and a few pairs are enough */
    if (to->pairs < 2 || to->scored >= (share > PAIRS_PER_DEPTH ? share : PAIRS_PER_DEPTH))
        return HADA_OK;
    const size_t count = (size_t)fitter->setting_count;
    hada_fitter_drop_judged(fitter); /* alpha and lambda may change */
    status = hada_fitter_prepare_trials(fitter, err);
    if (!status)
        status = hada_fitter_pool(fitter, err);
    if (!status)
        status = hada_fitter_select(fitter, depth, err);
    if (!status)
        status = hada_fitter_stage(fitter, raw, scene, err);
    if (!status)
        status = hada_alloc_raw((void **)&partial, fitter->partial.bytes, 1, "scores", err);
    if (!status)
        status = hada_alloc((void **)&own, 2 * count, sizeof(double), "scores", err);
    if (!status)
        status = score_pair(fitter, depth, partial, own, own + count, err);
    for (size_t s = 0; !status && s < count; s++) {
        to->single[s] += decibels(fitter, own[s]);
        to->twofold[s] += decibels(fitter, own[s] + own[count + s]);
    }
    if (!status)
        status = hada_fitter_keep(fitter, depth, err);
    to->scored += !status;
    free(partial);
    free(own);
    return status;
}

/* Mean PSNR of a setting's held-out pairs, over depths; returns the number of depths with any. */
static int mean_psnr(const hada_fitter *fitter, size_t setting, double *single, double *twofold)
{
    int depths = 0;
    *single = *twofold = 0.0;
    for (int z = 0; z < fitter->info.depths; z++) {
        const hada_fitter_depth *depth = &fitter->depth[z];
        if (!depth->scored)
            continue;
        depths++;
        *single += depth->single[setting] / (double)depth->scored;
        *twofold += depth->twofold[setting] / (double)depth->scored;
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
    for (size_t s = 0; s < (size_t)fitter->distinct; s++) {
        double single, twofold;
        if (!mean_psnr(fitter, s, &single, &twofold))
            return 0;
        *scored = 1;
        if (single + twofold > most) {
            most = single + twofold;
            best = s;
        }
    }
    return best;
}

size_t hada_fitter_choice(const hada_fitter *fitter, double *alpha, double *lambda, int *scored)
{
    const hada_fit_options *options = &fitter->options;
    const size_t best = hada_fitter_best(fitter, scored);
    *alpha = fitter->alphas[best];
    *lambda = fitter->lambdas[best];
    if (!*scored) {
        *alpha = options->alpha >= 0.0 ? options->alpha : HADA_FIT_ALPHA;
        *lambda = options->lambda >= 0.0 ? options->lambda : HADA_FIT_LAMBDA;
    }
    return best;
}

hada_status hada_fitter_rows(const hada_fitter *fitter, size_t best, int scored, hada_fit_row **rows, size_t *count,
                             hada_error *err)
{
    const hada_fitter_judged *judged = &fitter->judged;
    const size_t settings = scored ? (size_t)fitter->distinct : 0, all = settings + (size_t)judged->count;
    *rows = NULL;
    *count = 0;
    hada_status status = all ? hada_alloc((void **)rows, all, sizeof **rows, "the leave-one-out table", err) : HADA_OK;
    if (status)
        return status;
    *count = all;
    for (size_t s = 0; s < settings; s++) {
        hada_fit_row *row = &(*rows)[s];
        row->alpha = fitter->alphas[s];
        row->lambda = fitter->lambdas[s];
        row->chosen = s == best;
        if (!mean_psnr(fitter, s, &row->psnr_single, &row->psnr_double))
            row->psnr_single = row->psnr_double = NAN;
        if (fitter->info.depths == 1)
            row->psnr_double = NAN;
    }
    double alpha, lambda;
    hada_fitter_choice(fitter, &alpha, &lambda, &scored);
    for (int s = 0; s < judged->count; s++) {
        (*rows)[settings + (size_t)s] = (hada_fit_row){.alpha = alpha,
                                                       .lambda = lambda,
                                                       .outside = judged->outside[s],
                                                       .psnr_single = judged->psnr[s],
                                                       .psnr_double = NAN,
                                                       .chosen = s == judged->chosen};
    }
    return HADA_OK;
}
