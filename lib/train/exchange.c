/* Gradients and values between workers and ranks, and the last good ones on the host. */
#include "train/workers.h"

#include <xxhash.h>

#include "core/callers.h"

/* Values that are added up at a time, and sums of squares side by side. */
enum { RUN = 256, LANES = 8 };

typedef struct exchange {
    int group;
    hada_content content;
} exchange;

static hada_status open_one(hada_workers *workers, int worker, void *user, hada_error *err)
{
    const exchange *what = user;
    hada_worker *own = &workers->worker[worker];
    return hada_parameters_open(hada_worker_parameters(own), what->group, what->content, own->room, &own->values, err);
}

static hada_status close_one(hada_workers *workers, int worker, void *user, hada_error *err)
{
    const exchange *what = user;
    hada_worker *own = &workers->worker[worker];
    float *values = own->values;
    own->values = NULL;
    return values ? hada_parameters_close(hada_worker_parameters(own), what->group, what->content, values, err)
                  : HADA_OK;
}

/* What follows among ranks, while the group is open. */
typedef hada_status (*among_ranks_of)(hada_workers *workers, const exchange *what, hada_error *err);

/* Opens a group on all workers, does something with it (NULL: nothing), and closes it, also after a failure. */
static hada_status with_open(hada_workers *workers, exchange *what, hada_work work, among_ranks_of among_ranks,
                             hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_workers_run(workers, open_one, what, err));
    if (work)
        HADA_TRY_OR_DONE(hada_workers_run(workers, work, what, err));
    if (hada_ranks(workers->ranks) > 1)
        HADA_TRY_OR_DONE(among_ranks(workers, what, err));
done:;
    const hada_status closed = hada_workers_run(workers, close_one, what, status ? NULL : err);
    return status ? status : closed;
}

/* The sum of squares of a run, in lanes that compilers keep in vector registers. */
static double squares_of_run(const float run[RUN])
{
    float squares[LANES] = {0.0f};
    double all = 0.0;
    for (size_t i = 0; i < RUN; i += LANES)
        for (size_t k = 0; k < LANES; k++)
            squares[k] += run[i + k] * run[i + k];
    for (size_t k = 0; k < LANES; k++)
        all += squares[k];
    return all;
}

/* The sums of a run of values over all workers; returns that of their squares. */
static double add_run(const hada_workers *workers, size_t at, size_t count, float sums[RUN])
{
    memcpy(sums, workers->worker->values + at, count * sizeof *sums);
    memset(sums + count, 0, (RUN - count) * sizeof *sums);
    for (int w = 1; w < workers->count; w++) {
        const float *more = workers->worker[w].values + at;
        for (size_t i = 0; i < count; i++)
            sums[i] += more[i];
    }
    return squares_of_run(sums);
}

/* The sum of squares of values, in runs as above. */
static double squares_of(const float *values, size_t count)
{
    const size_t whole = count / RUN * RUN;
    float last[RUN] = {0.0f};
    double all = 0.0;
    for (size_t at = 0; at < whole; at += RUN)
        all += squares_of_run(values + at);
    memcpy(last, values + whole, (count - whole) * sizeof *last);
    return all + squares_of_run(last);
}

/* A worker's part of a net's gradient, which no other needs; of filters each adds up a part for all. */
static hada_status add_part(hada_workers *workers, int worker, void *user, hada_error *err)
{
    const exchange *what = user;
    hada_worker *own = &workers->worker[worker];
    const size_t shares = (size_t)workers->count;
    const int shared = what->group < HADA_GROUP_FILTERS;
    hada_part part = hada_worker_parameters(own)->group[what->group].part;
    float sums[RUN];
    (void)err;
    if (!shared) {
        const size_t all = hada_parameters_floats(hada_worker_parameters(own), what->group, what->content);
        part.first = all * (size_t)worker / shares;
        part.count = all * ((size_t)worker + 1) / shares - part.first;
    }
    own->squares = 0.0;
    for (size_t done = 0; done < part.count; done += RUN) {
        const size_t at = part.first + done, count = part.count - done < RUN ? part.count - done : RUN;
        own->squares += add_run(workers, at, count, sums);
        for (int w = 0; w < workers->count; w++)
            if (w == worker || !shared)
                memcpy(workers->worker[w].values + at, sums, count * sizeof *sums);
    }
    return HADA_OK;
}

static hada_status reduce_part(const hada_workers *workers, float *values, hada_part part, hada_error *err)
{
    for (size_t done = 0; done < part.count; done += HADA_BUCKET) {
        const size_t count = part.count - done < HADA_BUCKET ? part.count - done : HADA_BUCKET;
        HADA_TRY(hada_reduce_floats(workers->ranks, values + part.first + done, count, err));
    }
    return HADA_OK;
}

/* After the workers' own sums, those of all ranks: of a net's gradient each worker's part, of filters the whole. */
static hada_status reduce_gradient(hada_workers *workers, const exchange *what, hada_error *err)
{
    hada_buckets *buckets = &workers->buckets;
    const int shared = what->group < HADA_GROUP_FILTERS;
    hada_status status = HADA_OK;
    for (int w = 0; w < (shared ? workers->count : 1); w++) {
        hada_worker *own = &workers->worker[w];
        hada_parameters *parameters = hada_worker_parameters(own);
        const hada_part part = shared ? parameters->group[what->group].part
                                      : (hada_part){0, hada_parameters_floats(parameters, what->group, what->content)};
        if (what->group == HADA_GROUP_NET && buckets->full)
            memcpy(own->values, buckets->values, part.count * sizeof *own->values);
        else
            HADA_TRY_OR_DONE(reduce_part(workers, own->values, part, err));
        own->squares = squares_of(own->values + part.first, part.count);
        for (int k = 1; !shared && k < workers->count; k++) {
            memcpy(workers->worker[k].values, own->values, part.count * sizeof *own->values);
            workers->worker[k].squares = 0.0;
        }
    }
done:
    if (what->group == HADA_GROUP_NET)
        buckets->full = 0;
    return status;
}

hada_status hada_exchange_gradients(hada_workers *workers, int group, double *squares, hada_error *err)
{
    exchange what = {group, HADA_CONTENT_GRADIENT};
    if (workers->count * hada_ranks(workers->ranks) == 1)
        return HADA_OK;
    HADA_TRY(with_open(workers, &what, workers->count > 1 ? add_part : NULL, reduce_gradient, err));
    for (int w = 0; w < workers->count; w++)
        *squares += workers->worker[w].squares;
    return HADA_OK;
}

/* What the others have updated. */
static void take_parts(hada_workers *workers, int worker, int group)
{
    for (int w = 0; w < workers->count; w++) {
        const hada_part part = hada_worker_parameters(&workers->worker[w])->group[group].part;
        if (w != worker)
            memcpy(workers->worker[worker].values + part.first, workers->worker[w].values + part.first,
                   part.count * sizeof(float));
    }
}

/* A worker's share of the statistics of batch norms, behind the parameters, for all workers. */
static void average_statistics(hada_workers *workers, int worker)
{
    const hada_parameter_group *net = &hada_worker_parameters(workers->worker)->group[HADA_GROUP_NET];
    const size_t first = net->trained, all = net->floats - first;
    const size_t shares = (size_t)workers->count, end = first + all * ((size_t)worker + 1) / shares;
    for (size_t i = first + all * (size_t)worker / shares; i < end; i++) {
        double sum = 0.0;
        for (int w = 0; w < workers->count; w++)
            sum += workers->worker[w].values[i];
        for (int w = 0; w < workers->count; w++)
            workers->worker[w].values[i] = (float)(sum / workers->count);
    }
}

/* The statistics of all ranks' batch norms. */
static hada_status reduce_statistics(hada_workers *workers, const exchange *what, hada_error *err)
{
    const hada_parameter_group *net = &hada_worker_parameters(workers->worker)->group[what->group];
    const size_t first = net->trained, count = net->floats - first;
    const float ranks = (float)hada_ranks(workers->ranks);
    float *own = workers->worker->values + first;
    if (what->group != HADA_GROUP_NET)
        return HADA_OK;
    HADA_TRY(hada_reduce_floats(workers->ranks, own, count, err));
    for (size_t i = 0; i < count; i++)
        own[i] /= ranks;
    for (int w = 1; w < workers->count; w++)
        memcpy(workers->worker[w].values + first, own, count * sizeof *own);
    return HADA_OK;
}

static hada_status share_one(hada_workers *workers, int worker, void *user, hada_error *err)
{
    const exchange *what = user;
    (void)err;
    take_parts(workers, worker, what->group);
    if (what->group == HADA_GROUP_NET)
        average_statistics(workers, worker);
    return HADA_OK;
}

hada_status hada_exchange_values(hada_workers *workers, int group, hada_error *err)
{
    exchange what = {group, HADA_CONTENT_VALUES};
    const hada_parameter_group *net = &hada_worker_parameters(workers->worker)->group[group];
    const int averages = group == HADA_GROUP_NET && net->trained < net->floats && hada_ranks(workers->ranks) > 1;
    if (group >= HADA_GROUP_FILTERS || (workers->count == 1 && !averages))
        return HADA_OK;
    return with_open(workers, &what, share_one, reduce_statistics, err);
}

/* The last good values and states. */

hada_status hada_snapshot_create(hada_snapshot *snapshot, hada_workers *workers, const hada_train_progress *progress,
                                 hada_error *err)
{
    const size_t groups = (size_t)workers->groups;
    *snapshot = (hada_snapshot){.groups = workers->groups};
    HADA_TRY(HADA_NEW(snapshot->values, groups, "a snapshot", err));
    HADA_TRY(HADA_NEW(snapshot->states, groups, "a snapshot", err));
    HADA_TRY(HADA_NEW(snapshot->dirty, groups, "a snapshot", err));
    HADA_TRY(HADA_NEW(snapshot->group_steps, groups, "a snapshot", err));
    for (int g = 0; g < workers->groups; g++) {
        HADA_TRY(HADA_NEW_RAW(snapshot->values[g], hada_workers_floats(workers, g, HADA_CONTENT_VALUES),
                              "a copy of the parameters", err));
        HADA_TRY(HADA_NEW_RAW(snapshot->states[g], hada_workers_floats(workers, g, HADA_CONTENT_STATE),
                              "a copy of the optimiser's state", err));
        snapshot->dirty[g] = 1;
    }
    return hada_snapshot_take(snapshot, workers, progress, err);
}

void hada_snapshot_free(hada_snapshot *snapshot)
{
    for (int g = 0; g < snapshot->groups; g++) {
        if (snapshot->values)
            free(snapshot->values[g]);
        if (snapshot->states)
            free(snapshot->states[g]);
    }
    HADA_FREE(snapshot->values, snapshot->states, snapshot->dirty, snapshot->group_steps);
    *snapshot = (hada_snapshot){0};
}

/* Devices of different kinds round differently, so that ranks would drift apart: all go on with what the first has.
 * Hashes are compared, which takes no more than reading. */
static hada_status agree(hada_snapshot *snapshot, hada_workers *workers, int group, hada_error *err)
{
    float *values = snapshot->values[group], *states = snapshot->states[group];
    const size_t value_bytes = hada_workers_floats(workers, group, HADA_CONTENT_VALUES) * sizeof *values;
    const size_t state_bytes = hada_workers_floats(workers, group, HADA_CONTENT_STATE) * sizeof *states;
    if (hada_ranks(workers->ranks) == 1)
        return HADA_OK;
    const uint64_t own = XXH3_64bits_withSeed(states, state_bytes, XXH3_64bits(values, value_bytes));
    uint64_t first = own;
    HADA_TRY(hada_broadcast(workers->ranks, 0, &first, sizeof first, err));
    const int differs = first != own;
    double differing = differs;
    HADA_TRY(hada_reduce(workers->ranks, &differing, 1, err));
    if (differing == 0.0)
        return HADA_OK;
    HADA_TRY(hada_broadcast(workers->ranks, 0, values, value_bytes, err));
    HADA_TRY(hada_broadcast(workers->ranks, 0, states, state_bytes, err));
    return differs ? hada_snapshot_give(snapshot, workers, group, err) : HADA_OK;
}

hada_status hada_snapshot_take(hada_snapshot *snapshot, hada_workers *workers, const hada_train_progress *progress,
                               hada_error *err)
{
    for (int g = 0; g < workers->groups; g++) {
        if (!snapshot->dirty[g] || !hada_workers_have(workers, g))
            continue;
        HADA_TRY(hada_workers_read(workers, g, HADA_CONTENT_VALUES, snapshot->values[g], err));
        HADA_TRY(hada_workers_read(workers, g, HADA_CONTENT_STATE, snapshot->states[g], err));
        HADA_TRY(agree(snapshot, workers, g, err));
        snapshot->dirty[g] = 0;
    }
    snapshot->step = progress->step;
    memcpy(snapshot->group_steps, progress->group_steps, (size_t)workers->groups * sizeof *snapshot->group_steps);
    return HADA_OK;
}

hada_status hada_snapshot_give(const hada_snapshot *snapshot, hada_workers *workers, int group, hada_error *err)
{
    return hada_workers_write(workers, group, snapshot->values[group], snapshot->states[group], err);
}

hada_status hada_snapshot_restore(hada_snapshot *snapshot, hada_workers *workers, hada_train_progress *progress,
                                  hada_error *err)
{
    for (int g = 0; g < workers->groups; g++) {
        /* Batch norms change with every forward pass in training, not with updates alone. */
        if (snapshot->dirty[g] || g == HADA_GROUP_NET)
            HADA_TRY(hada_snapshot_give(snapshot, workers, g, err));
        snapshot->dirty[g] = 0;
    }
    progress->step = snapshot->step;
    memcpy(progress->group_steps, snapshot->group_steps, (size_t)workers->groups * sizeof *snapshot->group_steps);
    return HADA_OK;
}
