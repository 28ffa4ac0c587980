/* From the sums of all depths to a model. */
#include "fit/fitter.h"

#include "filter/bank.h"
#include "fit/fit_solve.h"

typedef struct solve_work {
    hada_fit_sums *sums;
    const float *filters;
    const hada_fit_transfers *learned;
    hada_nonnegative *nonnegative;
    hada_buffer out, partial;
    float *blocks, *rows;
    double *trust; /* per channel */
} solve_work;

static hada_status work_create(solve_work *work, hada_error *err)
{
    const hada_fit_grid *grid = work->sums->grid;
    const size_t channels = (size_t)grid->info.channels;
    hada_context *context = grid->slot->context;
    /* `blocks` also takes the partial sums of a reduction, which are fewer */
    HADA_TRY(HADA_NEW_RAW(work->blocks, 2 * grid->stride, "a filter", err));
    HADA_TRY(HADA_NEW_RAW(work->rows, hada_model_info_plane(&grid->info), "the scenes' power", err));
    HADA_TRY(HADA_NEW(work->trust, channels, "a fit", err));
    HADA_TRY(hada_buffer_create(&work->out, context, hada_fit_spectra_bytes(grid, channels), "a depth's filters", err));
    return hada_buffer_create(&work->partial, context, grid->chunks * sizeof(float), "partial sums", err);
}

/* Mean over frequencies of what no linear camera explains, per degree of freedom: the noise's |N|^2. */
static hada_status noise_power(solve_work *work, int z, int channel, double *power, hada_error *err)
{
    const hada_spectrum_layout *layout = &work->sums->grid->layout;
    const hada_fit_depth *depth = &work->sums->depth[z];
    double sum = 0.0;
    HADA_TRY(hada_fit_unexplained(work->sums, channel, depth->scene_energy[channel], &work->partial, work->blocks, &sum,
                                  err));
    *power = depth->pairs > 1 ? sum / ((double)layout->rows * layout->cols) / (double)(depth->pairs - 1) : 0.0;
    return HADA_OK;
}

/* A channel's filter of the depth on the device, to the model's. */
static hada_status solve_filter(solve_work *work, const hada_model *model, int z, int channel, float *filter,
                                hada_error *err)
{
    const hada_fit_setting setting = {model->info.alpha, model->info.lambda};
    const hada_fit_penalty penalty = hada_fit_penalty_of(setting, work->sums->depth[z].raw_energy[channel]);
    const size_t values = 2 * hada_model_plane(model);
    if (work->filters) {
        memcpy(filter, work->filters + (filter - model->filter), values * sizeof *filter);
        return HADA_OK;
    }
    HADA_TRY(hada_fit_solve_filter(work->sums, channel, penalty, work->out.mem, 0, err));
    return hada_fit_read_plane(work->sums->grid, &work->out, 0, work->blocks, filter, "a filter", err);
}

/* The depth on the device: filters, transfer functions and noise of its channels. */
static hada_status solve_depth(solve_work *work, hada_model *model, int z, hada_error *err)
{
    const hada_fit_grid *grid = work->sums->grid;
    const hada_fit_depth *depth = &work->sums->depth[z];
    const size_t values = 2 * hada_model_plane(model), channels = (size_t)model->info.channels;
    const size_t first = (size_t)z * channels;
    for (size_t c = 0; c < channels; c++)
        HADA_TRY(solve_filter(work, model, z, (int)c, model->filter + (first + c) * values, err));
    if (work->learned->otf) {
        memcpy(model->otf + first * values, work->learned->otf + first * values, channels * values * sizeof(float));
        memcpy(model->noise_power + first, work->learned->noise + first, channels * sizeof(double));
        return HADA_OK;
    }
    for (size_t c = 0; c < channels; c++) {
        HADA_TRY(noise_power(work, z, (int)c, &model->noise_power[first + c], err));
        work->trust[c] = hada_nonnegative_trust(model->noise_power[first + c], depth->raw_energy[c]);
    }
    HADA_TRY(hada_fit_solve_transfers(work->sums, work->nonnegative, depth->scene_energy, work->trust, work->out.mem, 0,
                                      err));
    for (size_t c = 0; c < channels; c++)
        HADA_TRY(hada_fit_read_plane(grid, &work->out, c * grid->layout.count, work->blocks,
                                     model->otf + (first + c) * values, "a transfer function", err));
    return HADA_OK;
}

/* What the depth's owner has solved, to all ranks. */
static hada_status give_depth(const hada_fit_sums *sums, hada_model *model, int z, hada_error *err)
{
    const hada_communicator *ranks = &sums->grid->communicator;
    const size_t channels = (size_t)model->info.channels, values = 2 * channels * hada_model_plane(model);
    const int owner = hada_owner(ranks, z);
    HADA_TRY(hada_broadcast(ranks, owner, model->filter + (size_t)z * values, values * sizeof(float), err));
    HADA_TRY(hada_broadcast(ranks, owner, model->otf + (size_t)z * values, values * sizeof(float), err));
    return hada_broadcast(ranks, owner, model->noise_power + (size_t)z * channels, channels * sizeof(double), err);
}

/* Mean over depths and channels of |X|^2 per pair. */
static hada_status scene_power(solve_work *work, hada_model *model, hada_error *err)
{
    const hada_fit_grid *grid = work->sums->grid;
    const size_t plane = hada_model_plane(model);
    const float share = 1.0f / (float)(model->info.depths * model->info.channels);
    for (int c = 0; c < model->info.channels; c++) {
        HADA_TRY(hada_buffer_read(&work->sums->pool[c], grid->slot, HADA_FIT_SCENE_POOL * grid->stride * sizeof(float),
                                  work->blocks, grid->layout.count * sizeof(float), err));
        hada_layout_unpack_real(&grid->layout, work->blocks, work->rows);
        for (size_t i = 0; i < plane; i++)
            model->scene_power[i] += work->rows[i] * share;
    }
    return HADA_OK;
}

static hada_status check_depths(const hada_fit_sums *sums, hada_error *err)
{
    for (int z = 0; z < sums->grid->info.depths; z++)
        if (!sums->depth[z].pairs)
            return hada_fail(err, HADA_ERROR_STATE,
                             "depth %d (%g mm) has no pairs; every depth needs at least one raw frame with its scene",
                             z, sums->grid->distances[z]);
    return HADA_OK;
}

hada_status hada_fit_model_make(hada_model **out, hada_fit_sums *sums, hada_fit_setting setting, const float *filters,
                                const hada_fit_transfers *learned, hada_nonnegative *nonnegative, hada_error *err)
{
    solve_work work = {.sums = sums, .filters = filters, .learned = learned, .nonnegative = nonnegative};
    hada_model_info info = sums->grid->info;
    const size_t channels = (size_t)info.channels;
    double noise = 0.0;
    hada_status status = HADA_OK;
    *out = NULL;
    info.alpha = setting.alpha;
    info.lambda = setting.lambda;
    HADA_TRY_OR_DONE(check_depths(sums, err));
    HADA_TRY_OR_DONE(hada_model_create(out, &info, 1, err));
    HADA_TRY_OR_DONE(work_create(&work, err));
    HADA_TRY_OR_DONE(hada_fit_sums_pool(sums, err));
    for (int z = 0; z < info.depths; z++) {
        if (hada_is_mine(&sums->grid->communicator, z)) {
            HADA_TRY_OR_DONE(hada_fit_sums_select(sums, z, err));
            HADA_TRY_OR_DONE(solve_depth(&work, *out, z, err));
        }
    }
    for (int z = 0; z < info.depths; z++) {
        HADA_TRY_OR_DONE(give_depth(sums, *out, z, err));
        for (size_t c = 0; c < channels; c++)
            noise += (*out)->noise_power[(size_t)z * channels + c];
        (*out)->pairs[z] = (double)sums->depth[z].pairs;
    }
    HADA_TRY_OR_DONE(scene_power(&work, *out, err));
    (*out)->info.noise =
        sqrt(noise / ((double)info.depths * info.channels) / ((double)info.raw_rows * (double)info.raw_cols));
done:
    hada_slot_finish(work.sums->grid->slot, NULL);
    HADA_DESTROY_BUFFERS(&work.out, &work.partial);
    HADA_FREE(work.blocks, work.rows, work.trust);
    if (status)
        hada_model_destroy(out);
    return status;
}
