#include "fit/fit_sums.h"

#include "filter/bank.h"
#include "launch/fit_sums.h"

/* A pair's energy must be at least this for the squares of its dim frequencies not to vanish in single precision, and
 * a depth's energy times the grid's points at most that: no frequency has more, and squares up to 2^127 are floats. */
#define LEAST_ENERGY 0x1p-80
#define MOST_ENERGY  0x1p120

static hada_program_fit_sums program_of(const hada_fit_grid *grid)
{
    return hada_fit_is_split(grid) ? HADA_PROGRAM_FIT_SUMS_SPLIT : HADA_PROGRAM_FIT_SUMS_DEFAULT;
}

static size_t depth_floats(const hada_fit_grid *grid)
{
    return 2 * (size_t)grid->sum_count * grid->stride; /* high and low parts */
}

static hada_status make_depths(hada_fit_sums *sums, hada_error *err)
{
    const size_t depths = (size_t)sums->grid->info.depths, channels = (size_t)sums->grid->info.channels;
    HADA_TRY(HADA_NEW(sums->depth, depths, "a fitter", err));
    for (size_t z = 0; z < depths; z++) {
        HADA_TRY(HADA_NEW(sums->depth[z].raw_energy, channels, "a fitter", err));
        HADA_TRY(HADA_NEW(sums->depth[z].scene_energy, channels, "a fitter", err));
    }
    return HADA_OK;
}

static hada_status make_buffer(hada_fit_sums *sums, hada_buffer *buffer, size_t floats, const char *what,
                               hada_error *err)
{
    hada_status status = hada_buffer_create(buffer, sums->grid->slot->context, floats * sizeof(float), what, err);
    sums->bytes += buffer->bytes;
    return status;
}

static hada_status fill_weights(hada_fit_sums *sums, hada_error *err)
{
    const size_t stride = sums->grid->stride;
    float *values = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(values, stride, "the weights", err));
    hada_layout_weights(&sums->grid->layout, values);
    HADA_TRY_OR_DONE(hada_buffer_write(&sums->weights, sums->grid->slot, 0, values, stride * sizeof *values, err));
done:
    free(values);
    return status;
}

hada_status hada_fit_sums_create(hada_fit_sums *sums, const hada_fit_grid *grid, hada_error *err)
{
    const size_t channels = (size_t)grid->info.channels;
    const size_t pools = hada_fit_is_split(grid) ? HADA_FIT_POOLS_SPLIT : HADA_FIT_POOLS;
    *sums = (hada_fit_sums){.grid = grid, .current = -1};
    HADA_TRY(make_depths(sums, err));
    HADA_TRY(HADA_NEW(sums->sums, channels, "a fitter", err));
    HADA_TRY(HADA_NEW(sums->pool, channels, "a fitter", err));
    for (size_t c = 0; c < channels; c++) {
        HADA_TRY(make_buffer(sums, &sums->sums[c], depth_floats(grid), "the sums of a fit", err));
        HADA_TRY(make_buffer(sums, &sums->pool[c], pools * grid->stride, "the pooled sums of a fit", err));
    }
    HADA_TRY(make_buffer(sums, &sums->weights, grid->stride, "the weights of frequencies", err));
    return fill_weights(sums, err);
}

void hada_fit_sums_destroy(hada_fit_sums *sums)
{
    for (int c = 0; sums->sums && c < sums->grid->info.channels; c++)
        hada_buffer_destroy(&sums->sums[c]);
    for (int c = 0; sums->pool && c < sums->grid->info.channels; c++)
        hada_buffer_destroy(&sums->pool[c]);
    hada_buffer_destroy(&sums->weights);
    for (int z = 0; sums->depth && z < sums->grid->info.depths; z++)
        HADA_FREE(sums->depth[z].sums, sums->depth[z].raw_energy, sums->depth[z].scene_energy);
    HADA_FREE(sums->depth, sums->sums, sums->pool);
    *sums = (hada_fit_sums){0};
}

/* The sums of the current depth back to the host. */
static hada_status put_back(hada_fit_sums *sums, hada_error *err)
{
    const size_t floats = depth_floats(sums->grid), channels = (size_t)sums->grid->info.channels;
    hada_fit_depth *depth = &sums->depth[sums->current];
    if (!depth->sums)
        HADA_TRY(HADA_NEW_RAW(depth->sums, channels * floats, "the sums of a depth", err));
    for (size_t c = 0; c < channels; c++)
        HADA_TRY(hada_buffer_read(&sums->sums[c], sums->grid->slot, 0, depth->sums + c * floats, floats * sizeof(float),
                                  err));
    sums->changed = 0;
    return HADA_OK;
}

hada_status hada_fit_sums_select(hada_fit_sums *sums, int depth, hada_error *err)
{
    const size_t floats = depth_floats(sums->grid), bytes = floats * sizeof(float);
    const float *values = sums->depth[depth].sums;
    hada_slot *slot = sums->grid->slot;
    if (sums->current == depth)
        return HADA_OK;
    if (sums->current >= 0 && sums->changed)
        HADA_TRY(put_back(sums, err));
    sums->current = -1;
    sums->changed = 0;
    for (int c = 0; c < sums->grid->info.channels; c++)
        HADA_TRY(values ? hada_buffer_write(&sums->sums[c], slot, 0, values + (size_t)c * floats, bytes, err)
                        : hada_buffer_clear(&sums->sums[c], slot, 0, bytes, err));
    sums->current = depth;
    return HADA_OK;
}

hada_status hada_fit_sums_borrow(hada_fit_sums *sums, int depth, hada_error *err)
{
    HADA_TRY(hada_fit_sums_select(sums, depth, err));
    if (sums->changed)
        HADA_TRY(put_back(sums, err));
    sums->current = -1; /* the host's copy is the true one */
    return HADA_OK;
}

hada_status hada_fit_sums_accumulate(hada_fit_sums *sums, const hada_fit_pair *pair, double sign, hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    const hada_range range = hada_fit_vectors(grid);
    const double values = (double)grid->vectors * HADA_FIT_VECTOR;
    for (int c = 0; c < grid->info.channels; c++) {
        const hada_fit_image image = hada_fit_image_of(grid, (size_t)c);
        hada_slot_cost(grid->slot, 16.0 * (1.0 + grid->sum_count) * values, (12.0 + 7.0 * grid->sum_count) * values);
        HADA_TRY(hada_launch_fit_pair(grid->slot, program_of(grid), &range, err, .x = pair->scene_spectrum.mem,
                                      .b = pair->raw_spectrum.mem, .sums = sums->sums[c].mem, .image = image,
                                      .sign = (cl_float)sign));
    }
    return HADA_OK;
}

/* New values make the pools worthless. */
static void mark_changed(hada_fit_sums *sums)
{
    sums->changed = 1;
    sums->pooled = 0;
}

static hada_status check_energy(const hada_fit_grid *grid, double energy, double sum, const char *what, hada_error *err)
{
    const double points = (double)grid->info.grid_rows * grid->info.grid_cols;
    if ((energy > 0.0 && energy < LEAST_ENERGY) || (energy + sum) * points > MOST_ENERGY)
        return hada_fail(
            err, HADA_ERROR_NUMERIC,
            "the %s of this pair has values too %s for single precision (root of the sum of squares %.2g); "
            "divide all images of a data set by one number, so that white is about 1",
            what, energy < 1.0 ? "small" : "large", sqrt(energy));
    return HADA_OK;
}

hada_status hada_fit_sums_add(hada_fit_sums *sums, int depth, const hada_fit_pair *pair, hada_error *err)
{
    const int channels = sums->grid->info.channels;
    hada_fit_depth *to = &sums->depth[depth];
    for (int c = 0; c < channels; c++) {
        HADA_TRY(check_energy(sums->grid, pair->raw_energy[c], to->raw_energy[c], "raw frame", err));
        HADA_TRY(check_energy(sums->grid, pair->scene_energy[c], to->scene_energy[c], "scene", err));
    }
    HADA_TRY(hada_fit_sums_select(sums, depth, err));
    mark_changed(sums);
    HADA_TRY(hada_fit_sums_accumulate(sums, pair, 1.0, err));
    for (int c = 0; c < channels; c++) {
        to->raw_energy[c] += pair->raw_energy[c];
        to->scene_energy[c] += pair->scene_energy[c];
    }
    to->pairs++;
    return HADA_OK;
}

hada_status hada_fit_sums_merge(hada_fit_sums *sums, int channel, const hada_buffer *more, hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    const hada_range range = hada_fit_vectors(grid);
    const hada_fit_image image = hada_fit_image_of(grid, 0);
    const double values = (double)grid->vectors * HADA_FIT_VECTOR;
    mark_changed(sums);
    hada_slot_cost(grid->slot, 24.0 * grid->sum_count * values, 14.0 * grid->sum_count * values);
    return hada_launch_fit_merge(grid->slot, program_of(grid), &range, err, .more = more->mem,
                                 .sums = sums->sums[channel].mem, .image = image, .count = grid->sum_count);
}

/* Adds the depth on the device to the pools. */
static hada_status pool_depth(hada_fit_sums *sums, int64_t pairs, hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    const hada_range range = hada_fit_vectors(grid);
    const hada_fit_image image = hada_fit_image_of(grid, 0);
    const double values = (double)grid->vectors * HADA_FIT_VECTOR;
    for (int c = 0; c < grid->info.channels; c++) {
        hada_slot_cost(grid->slot, (hada_fit_is_split(grid) ? 52.0 : 32.0) * values, 6.0 * values);
        HADA_TRY(hada_launch_fit_pool(grid->slot, program_of(grid), &range, err, .sums = sums->sums[c].mem,
                                      .pool = sums->pool[c].mem, .image = image, .per_pair = 1.0f / (float)pairs));
    }
    return HADA_OK;
}

hada_status hada_fit_sums_pool(hada_fit_sums *sums, hada_error *err)
{
    const hada_model_info *info = &sums->grid->info;
    if (sums->pooled)
        return HADA_OK;
    for (int c = 0; c < info->channels; c++)
        HADA_TRY(hada_buffer_clear(&sums->pool[c], sums->grid->slot, 0, sums->pool[c].bytes, err));
    for (int z = 0; z < info->depths; z++) {
        if (!sums->depth[z].pairs)
            continue;
        HADA_TRY(hada_fit_sums_select(sums, z, err));
        HADA_TRY(pool_depth(sums, sums->depth[z].pairs, err));
    }
    sums->pooled = 1;
    return HADA_OK;
}

/* How many pairs each rank has at each depth: [depth][rank]. */
static hada_status count_pairs(const hada_fit_sums *sums, double *pairs, hada_error *err)
{
    const hada_communicator *ranks = &sums->grid->communicator;
    const int depths = sums->grid->info.depths;
    for (int z = 0; z < depths; z++)
        pairs[z * ranks->count + ranks->rank] = (double)sums->depth[z].pairs;
    return hada_reduce(ranks, pairs, (size_t)depths * (size_t)ranks->count, err);
}

/* High and low parts of one sum over the pairs, as they lie one after the other: as doubles, and back. Both parts
 * together have fewer bits than a double. */
static hada_status add_sum(const hada_communicator *ranks, float *parts, double *values, size_t count, hada_error *err)
{
    for (size_t i = 0; i < count; i++)
        values[i] = (double)parts[i] + parts[count + i];
    const hada_status status = hada_reduce(ranks, values, count, err);
    for (size_t i = 0; !status && i < count; i++) {
        parts[i] = (float)values[i];
        parts[count + i] = (float)(values[i] - parts[i]);
    }
    return status;
}

/* A depth of several ranks. */
static hada_status add_depth(const hada_fit_grid *grid, hada_fit_depth *depth, double *values, hada_error *err)
{
    const hada_communicator *ranks = &grid->communicator;
    const size_t channels = (size_t)grid->info.channels, arrays = channels * (size_t)grid->sum_count;
    HADA_TRY(hada_reduce(ranks, depth->raw_energy, channels, err));
    HADA_TRY(hada_reduce(ranks, depth->scene_energy, channels, err));
    for (size_t i = 0; i < arrays; i++)
        HADA_TRY(add_sum(ranks, depth->sums + 2 * i * grid->stride, values, grid->stride, err));
    return HADA_OK;
}

/* A depth of one rank. */
static hada_status give_depth(const hada_fit_grid *grid, hada_fit_depth *depth, int owner, hada_error *err)
{
    const hada_communicator *ranks = &grid->communicator;
    const size_t channels = (size_t)grid->info.channels;
    const size_t floats = channels * 2 * (size_t)grid->sum_count * grid->stride;
    HADA_TRY(hada_broadcast(ranks, owner, depth->raw_energy, channels * sizeof(double), err));
    HADA_TRY(hada_broadcast(ranks, owner, depth->scene_energy, channels * sizeof(double), err));
    return hada_broadcast(ranks, owner, depth->sums, floats * sizeof *depth->sums, err);
}

static hada_status share_depth(hada_fit_sums *sums, int z, const double *pairs, double *values, hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    hada_fit_depth *depth = &sums->depth[z];
    const size_t floats = (size_t)grid->info.channels * 2 * (size_t)grid->sum_count * grid->stride;
    int have = 0, owner = 0;
    depth->pairs = 0;
    for (int r = 0; r < grid->communicator.count; r++) {
        depth->pairs += (int64_t)pairs[r];
        if (pairs[r] > 0.0) {
            have++;
            owner = r;
        }
    }
    if (!have)
        return HADA_OK;
    if (!depth->sums)
        HADA_TRY(HADA_NEW(depth->sums, floats, "the sums of a depth", err));
    return have > 1 ? add_depth(grid, depth, values, err) : give_depth(grid, depth, owner, err);
}

hada_status hada_fit_sums_reduce(hada_fit_sums *sums, hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    const size_t depths = (size_t)grid->info.depths, ranks = (size_t)grid->communicator.count;
    double *pairs = NULL, *values = NULL;
    hada_status status = HADA_OK;
    if (sums->current >= 0)
        HADA_TRY_OR_DONE(hada_fit_sums_borrow(sums, sums->current, err)); /* the host has all of them now */
    sums->pooled = 0;
    HADA_TRY_OR_DONE(HADA_NEW(pairs, depths * ranks, "sums of several ranks", err));
    HADA_TRY_OR_DONE(HADA_NEW(values, grid->stride, "sums of several ranks", err));
    HADA_TRY_OR_DONE(count_pairs(sums, pairs, err));
    for (size_t z = 0; z < depths; z++)
        HADA_TRY_OR_DONE(share_depth(sums, (int)z, pairs + z * ranks, values, err));
done:
    HADA_FREE(pairs, values);
    return status;
}
