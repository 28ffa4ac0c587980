/* From sums to a model. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "filter/layout.h"
#include "fit/fitter.h"
#include "runtime/kernel.h"

/* Frequencies where scenes had less light than this part of their mean are not trusted with a transfer function. */
#define LEAST_SCENE 1e-6

typedef struct solve_work {
    hada_buffer out;
    float *blocks, *rows;
    double *trust; /* per channel */
} solve_work;

/* Mean over frequencies of what no linear camera explains, per degree of freedom: the noise's |N|^2. */
static hada_status noise_power(hada_fitter *fitter, int channel, double least, int64_t pairs, double *power,
                               float *partial, hada_error *err)
{
    const size_t group = fitter->context->shape == HADA_SHAPE_LANES ? 1 : 32, chunks = (size_t)fitter->chunks;
    const size_t global = (chunks + group - 1) / group * group;
    const cl_ulong stride = fitter->stride, vectors = fitter->vectors;
    const cl_float floor_value = (cl_float)least;
    const cl_int chunk_count = fitter->chunks;
    cl_kernel kernel;
    double sum = 0.0;
    hada_status status = hada_slot_kernel(fitter->slot, "fit_score", "fit_unexplained", fitter->macros, &kernel, err);
    hada_arg args[] = {HADA_ARG(fitter->sums[channel].mem),
                       HADA_ARG(stride),
                       HADA_ARG(fitter->weights.mem),
                       HADA_ARG(floor_value),
                       HADA_ARG(fitter->partial.mem),
                       HADA_ARG(chunk_count),
                       HADA_ARG(vectors)};
    hada_slot_cost(fitter->slot, 160.0 * (double)vectors, 64.0 * (double)vectors);
    if (!status)
        status =
            hada_slot_launch(fitter->slot, kernel, "fit_unexplained", 1, &global, &group, args, HADA_COUNT(args), err);
    if (!status)
        status = hada_buffer_read(&fitter->partial, fitter->slot, 0, partial, chunks * 4, err);
    for (size_t i = 0; !status && i < chunks; i++)
        sum += partial[i];
    *power = pairs > 1 ? sum / ((double)fitter->layout.rows * fitter->layout.cols) / (double)(pairs - 1) : 0.0;
    return status;
}

hada_status hada_fitter_read_plane(hada_fitter *fitter, const hada_buffer *from, size_t at, float *blocks, float *to,
                                   const char *what, hada_error *err)
{
    const size_t plane = hada_model_info_plane(&fitter->info), bytes = fitter->layout.count * 2 * sizeof(float);
    hada_status status = hada_buffer_read(from, fitter->slot, at * 2 * sizeof(float), blocks, bytes, err);
    if (status)
        return status;
    hada_layout_unpack(&fitter->layout, blocks, to);
    float sum = 0.0f; /* x - x is 0 for finite x alone */
    for (size_t i = 0; i < 2 * plane; i++)
        sum += to[i] - to[i];
    return sum == 0.0f ? HADA_OK
                       : hada_fail(err, HADA_ERROR_NUMERIC,
                                   "%s came out not finite; the raw frames are nearly dark at some frequencies: give a "
                                   "lambda above 0",
                                   what);
}

hada_status hada_fitter_solve_filter(hada_fitter *fitter, int channel, double alpha, double ridge, cl_mem out,
                                     size_t at, hada_error *err)
{
    const cl_ulong stride = fitter->stride, vectors = fitter->vectors, offset = at;
    const cl_float weight = (cl_float)alpha, added = (cl_float)ridge;
    hada_arg args[] = {HADA_ARG(fitter->sums[channel].mem),
                       HADA_ARG(fitter->pool[channel].mem),
                       HADA_ARG(stride),
                       HADA_ARG(weight),
                       HADA_ARG(added),
                       HADA_ARG(out),
                       HADA_ARG(offset),
                       HADA_ARG(vectors)};
    hada_slot_cost(fitter->slot, (fitter->sum_count > 4 ? 384.0 : 192.0) * (double)vectors, 40.0 * (double)vectors);
    return hada_fitter_launch(fitter, "fit_solve", "fit_filter", args, HADA_COUNT(args), err);
}

/* From the pairs alone. */
static hada_status free_transfer(hada_fitter *fitter, int channel, double scene_energy, cl_mem out, size_t at,
                                 hada_error *err)
{
    const cl_ulong stride = fitter->stride, vectors = fitter->vectors, offset = at;
    const cl_float least = (cl_float)(LEAST_SCENE * scene_energy);
    hada_arg args[] = {HADA_ARG(fitter->sums[channel].mem),
                       HADA_ARG(stride),
                       HADA_ARG(least),
                       HADA_ARG(out),
                       HADA_ARG(offset),
                       HADA_ARG(vectors)};
    hada_slot_cost(fitter->slot, 160.0 * (double)vectors, 24.0 * (double)vectors);
    return hada_fitter_launch(fitter, "fit_solve", "fit_transfer", args, HADA_COUNT(args), err);
}

hada_status hada_fitter_solve_transfers(hada_fitter *fitter, const double *scene_energy, const double *trust,
                                        cl_mem out, size_t at, hada_error *err)
{
    hada_nonnegative_rule rule;
    hada_status status = HADA_OK;
    hada_nonnegative_rule_init(&rule);
    if (fitter->nonnegative)
        return hada_nonnegative_solve(fitter->nonnegative, &rule, fitter->info.channels, fitter->sums, fitter->stride,
                                      scene_energy, trust, out, at, err);
    for (int c = 0; !status && c < fitter->info.channels; c++)
        status = free_transfer(fitter, c, scene_energy[c], out, at + (size_t)c * fitter->layout.count, err);
    return status;
}

/* The depth on the device: filters, transfer functions and noise of its channels. */
static hada_status solve_depth(hada_fitter *fitter, solve_work *work, hada_model *model, int z, hada_error *err)
{
    const hada_fitter_depth *depth = &fitter->depth[z];
    const size_t plane = hada_model_plane(model), channels = (size_t)model->info.channels;
    const size_t first = (size_t)z * channels;
    hada_status status = HADA_OK;
    for (size_t c = 0; !status && c < channels; c++) {
        float *filter = model->filter + (first + c) * plane * 2;
        if (fitter->judged.filters)
            memcpy(filter, fitter->judged.filters + (first + c) * plane * 2, 2 * plane * sizeof *filter);
        else
            status = hada_fitter_solve_filter(fitter, (int)c, model->info.alpha,
                                              model->info.lambda * depth->raw_energy[c], work->out.mem, 0, err);
        if (!status && !fitter->judged.filters)
            status = hada_fitter_read_plane(fitter, &work->out, 0, work->blocks, filter, "a filter", err);
        if (!status)
            status = noise_power(fitter, (int)c, LEAST_SCENE * depth->scene_energy[c], depth->pairs,
                                 &model->noise_power[first + c], work->blocks, err);
    }
    for (size_t c = 0; !status && c < channels; c++)
        work->trust[c] = hada_nonnegative_trust(model->noise_power[first + c], depth->raw_energy[c]);
    if (!status)
        status = hada_fitter_solve_transfers(fitter, depth->scene_energy, work->trust, work->out.mem, 0, err);
    for (size_t c = 0; !status && c < channels; c++)
        status = hada_fitter_read_plane(fitter, &work->out, c * fitter->layout.count, work->blocks,
                                        model->otf + (first + c) * plane * 2, "a transfer function", err);
    return status;
}

/* Mean over depths and channels of |X|^2 per pair. */
static hada_status scene_power(hada_fitter *fitter, solve_work *work, hada_model *model, hada_error *err)
{
    const size_t plane = hada_model_plane(model);
    const float share = 1.0f / (float)(model->info.depths * model->info.channels);
    hada_status status = HADA_OK;
    for (int c = 0; !status && c < model->info.channels; c++) {
        status = hada_buffer_read(&fitter->pool[c], fitter->slot, 2 * fitter->stride * sizeof(float), work->blocks,
                                  fitter->layout.count * sizeof(float), err);
        if (status)
            break;
        hada_layout_unpack_real(&fitter->layout, work->blocks, work->rows);
        for (size_t i = 0; i < plane; i++)
            model->scene_power[i] += work->rows[i] * share;
    }
    return status;
}

hada_status hada_fitter_solve(hada_fitter *fitter, double alpha, double lambda, hada_model **out, hada_error *err)
{
    solve_work work = {0};
    hada_model_info info = fitter->info;
    *out = NULL;
    for (int z = 0; z < info.depths; z++)
        if (!fitter->depth[z].pairs)
            return hada_fail(err, HADA_ERROR_STATE,
                             "depth %d (%g mm) has no pairs; every depth needs at least one raw frame with its scene",
                             z, fitter->distances[z]);
    info.alpha = alpha;
    info.lambda = lambda;
    hada_status status = hada_model_create(out, &info, 1, err);
    if (status)
        return status;
    hada_model *model = *out;
    const size_t plane = hada_model_plane(model), channels = (size_t)info.channels;
    /* `blocks` also takes the partial sums of a reduction, which are fewer */
    status = hada_alloc_raw((void **)&work.blocks, 2 * fitter->stride, sizeof(float), "a filter", err);
    if (!status)
        status = hada_alloc_raw((void **)&work.rows, plane, sizeof(float), "the scenes' power", err);
    if (!status)
        status = hada_alloc((void **)&work.trust, channels, sizeof(double), "a fit", err);
    if (!status)
        status = hada_buffer_create(&work.out, fitter->context, channels * fitter->layout.count * 8 + 64,
                                    "a depth's filters", err);
    if (!status)
        status = hada_fitter_pool(fitter, err);
    double noise = 0.0;
    for (int z = 0; !status && z < info.depths; z++) {
        status = hada_fitter_select(fitter, z, err);
        if (!status)
            status = solve_depth(fitter, &work, model, z, err);
        for (size_t c = 0; !status && c < channels; c++)
            noise += model->noise_power[(size_t)z * channels + c];
        model->pairs[z] = (double)fitter->depth[z].pairs;
    }
    if (!status)
        status = scene_power(fitter, &work, model, err);
    model->info.noise =
        sqrt(noise / ((double)info.depths * info.channels) / ((double)info.raw_rows * (double)info.raw_cols));
    hada_slot_finish(fitter->slot, NULL);
    hada_buffer_destroy(&work.out);
    free(work.blocks);
    free(work.rows);
    free(work.trust);
    if (status)
        hada_model_destroy(out);
    return status;
}
