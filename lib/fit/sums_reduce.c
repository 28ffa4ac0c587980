#include "fit/sums_reduce.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"

/* How many pairs each rank has at each depth: [depth][rank]. */
static hada_status count_pairs(const hada_fit_sums *sums, double *pairs, hada_error *err)
{
    const hada_communicator *ranks = &sums->grid->communicator;
    const int depths = sums->grid->info.depths;
    for (int z = 0; z < depths; z++)
        pairs[z * ranks->count + ranks->rank] = (double)sums->depth[z].pairs;
    return hada_reduce(ranks, pairs, (size_t)depths * (size_t)ranks->count, err);
}

/* High and low parts of one sum over the pairs, as they stand one after the other: as doubles, and back. Both parts
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
        HADA_TRY(hada_allocated(depth->sums = hada_alloc(floats, sizeof(float), "the sums of a depth", err)));
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
    HADA_TRY_OR_DONE(hada_allocated(pairs = hada_alloc(depths * ranks, sizeof *pairs, "sums of several ranks", err)));
    HADA_TRY_OR_DONE(hada_allocated(values = hada_alloc(grid->stride, sizeof *values, "sums of several ranks", err)));
    HADA_TRY_OR_DONE(count_pairs(sums, pairs, err));
    for (size_t z = 0; z < depths; z++)
        HADA_TRY_OR_DONE(share_depth(sums, (int)z, pairs + z * ranks, values, err));
done:
    free(pairs);
    free(values);
    return status;
}
