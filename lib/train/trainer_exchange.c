/* Several devices: their gradients become one, in a fixed order, and what each has updated goes to all. */
#include <string.h>

#include "train/trainer.h"

/* Values that are added up at a time, and sums of squares side by side. */
enum { RUN = 256, LANES = 8 };

typedef struct exchange {
    int group;
    hada_content content;
} exchange;

static hada_status open_one(hada_trainer *trainer, int worker, void *user, hada_error *err)
{
    const exchange *what = user;
    hada_worker *own = &trainer->workers[worker];
    return hada_engine_open(own->engine, what->group, what->content, own->room, &own->values, err);
}

static hada_status close_one(hada_trainer *trainer, int worker, void *user, hada_error *err)
{
    const exchange *what = user;
    hada_worker *own = &trainer->workers[worker];
    float *values = own->values;
    own->values = NULL;
    return values ? hada_engine_close(own->engine, what->group, what->content, values, err) : HADA_OK;
}

/* Opens a group on all workers, does something with it, and closes it, also after a failure. */
static hada_status with_open(hada_trainer *trainer, exchange *what, hada_work work, hada_error *err)
{
    hada_status status = hada_workers_run(trainer, open_one, what, err);
    if (!status)
        status = hada_workers_run(trainer, work, what, err);
    const hada_status closed = hada_workers_run(trainer, close_one, what, status ? NULL : err);
    return status ? status : closed;
}

/* The sums of a run of values over all workers; returns that of their squares. */
static double add_run(const hada_trainer *trainer, size_t at, size_t count, float sums[RUN])
{
    float squares[LANES] = {0.0f};
    double all = 0.0;
    memcpy(sums, trainer->workers->values + at, count * sizeof *sums);
    memset(sums + count, 0, (RUN - count) * sizeof *sums);
    for (int w = 1; w < trainer->worker_count; w++) {
        const float *more = trainer->workers[w].values + at;
        for (size_t i = 0; i < count; i++)
            sums[i] += more[i];
    }
    for (size_t i = 0; i < RUN; i += LANES)
        for (size_t k = 0; k < LANES; k++)
            squares[k] += sums[i + k] * sums[i + k];
    for (size_t k = 0; k < LANES; k++)
        all += squares[k];
    return all;
}

/* A worker's part of a net's gradient, which no other needs; of filters each adds up a part for all. */
static hada_status add_part(hada_trainer *trainer, int worker, void *user, hada_error *err)
{
    const exchange *what = user;
    hada_worker *own = &trainer->workers[worker];
    const size_t workers = (size_t)trainer->worker_count;
    const int shared = what->group < HADA_GROUP_FILTERS;
    hada_part part = hada_engine_part(own->engine, what->group);
    float sums[RUN];
    (void)err;
    if (!shared) {
        const size_t all = hada_engine_count(own->engine, what->group, what->content);
        part.first = all * (size_t)worker / workers;
        part.count = all * ((size_t)worker + 1) / workers - part.first;
    }
    own->squares = 0.0;
    for (size_t done = 0; done < part.count; done += RUN) {
        const size_t at = part.first + done, count = part.count - done < RUN ? part.count - done : RUN;
        own->squares += add_run(trainer, at, count, sums);
        for (int w = 0; w < trainer->worker_count; w++)
            if (w == worker || !shared)
                memcpy(trainer->workers[w].values + at, sums, count * sizeof *sums);
    }
    return HADA_OK;
}

hada_status hada_train_sum_gradients(hada_trainer *trainer, int group, double *squares, hada_error *err)
{
    exchange what = {group, HADA_CONTENT_GRADIENT};
    if (trainer->worker_count == 1)
        return HADA_OK;
    const hada_status status = with_open(trainer, &what, add_part, err);
    for (int w = 0; !status && w < trainer->worker_count; w++)
        *squares += trainer->workers[w].squares;
    return status;
}

/* What the others have updated. */
static void take_parts(hada_trainer *trainer, int worker, int group)
{
    for (int w = 0; w < trainer->worker_count; w++) {
        const hada_part part = hada_engine_part(trainer->workers[w].engine, group);
        if (w != worker)
            memcpy(trainer->workers[worker].values + part.first, trainer->workers[w].values + part.first,
                   part.count * sizeof(float));
    }
}

/* A worker's share of the statistics of batch norms, behind the parameters, for all workers. */
static void average_statistics(hada_trainer *trainer, int worker)
{
    const size_t first = trainer->net->trained, all = trainer->net->floats - first;
    const size_t workers = (size_t)trainer->worker_count, end = first + all * ((size_t)worker + 1) / workers;
    for (size_t i = first + all * (size_t)worker / workers; i < end; i++) {
        double sum = 0.0;
        for (int w = 0; w < trainer->worker_count; w++)
            sum += trainer->workers[w].values[i];
        for (int w = 0; w < trainer->worker_count; w++)
            trainer->workers[w].values[i] = (float)(sum / trainer->worker_count);
    }
}

static hada_status share_one(hada_trainer *trainer, int worker, void *user, hada_error *err)
{
    const exchange *what = user;
    (void)err;
    take_parts(trainer, worker, what->group);
    if (what->group == HADA_GROUP_NET)
        average_statistics(trainer, worker);
    return HADA_OK;
}

hada_status hada_train_share_values(hada_trainer *trainer, int group, hada_error *err)
{
    exchange what = {group, HADA_CONTENT_VALUES};
    if (trainer->worker_count == 1 || group >= HADA_GROUP_FILTERS)
        return HADA_OK;
    return with_open(trainer, &what, share_one, err);
}

hada_status hada_trainer_read(hada_trainer *trainer, int group, hada_content content, float *out, hada_error *err)
{
    const int parts = content == HADA_CONTENT_STATE && group < HADA_GROUP_FILTERS ? trainer->worker_count : 1;
    hada_status status = HADA_OK;
    for (int w = 0; !status && w < parts; w++)
        status = hada_engine_read(trainer->workers[w].engine, group, content, out, err);
    return status;
}
