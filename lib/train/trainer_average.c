/* Several devices: their gradients become one, in a fixed order. Each device's thread adds up a part of the values. */
#include <string.h>

#include "train/trainer.h"

/* Values that are added up at a time. */
enum { RUN = 256 };

/* Sums of the values `first` to `end` of a group, times `factor`. */
typedef struct exchange {
    int group;
    hada_content content;
    size_t first, end;
    double factor;
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

/* A run of values of all workers, in the workers' order. */
static void add_run(const hada_trainer *trainer, size_t at, size_t count, double factor)
{
    double sums[RUN];
    float mean[RUN];
    for (size_t i = 0; i < count; i++)
        sums[i] = trainer->workers->values[at + i];
    for (int w = 1; w < trainer->worker_count; w++)
        for (size_t i = 0; i < count; i++)
            sums[i] += trainer->workers[w].values[at + i];
    for (size_t i = 0; i < count; i++)
        mean[i] = (float)(sums[i] * factor);
    for (int w = 0; w < trainer->worker_count; w++)
        memcpy(trainer->workers[w].values + at, mean, count * sizeof *mean);
}

/* A worker's part, for all workers. */
static hada_status add_part(hada_trainer *trainer, int worker, void *user, hada_error *err)
{
    const exchange *what = user;
    const size_t all = what->end - what->first, workers = (size_t)trainer->worker_count;
    const size_t end = what->first + all * ((size_t)worker + 1) / workers;
    (void)err;
    for (size_t at = what->first + all * (size_t)worker / workers; at < end; at += RUN)
        add_run(trainer, at, end - at < RUN ? end - at : RUN, what->factor);
    return HADA_OK;
}

static hada_status share(hada_trainer *trainer, exchange *what, hada_error *err)
{
    hada_status status = hada_workers_run(trainer, open_one, what, err);
    if (!status)
        status = hada_workers_run(trainer, add_part, what, err);
    /* what is open is closed, also after a failure */
    const hada_status closed = hada_workers_run(trainer, close_one, what, status ? NULL : err);
    return status ? status : closed;
}

hada_status hada_train_sum_gradients(hada_trainer *trainer, int group, hada_error *err)
{
    exchange what = {.group = group, .content = HADA_CONTENT_GRADIENT, .factor = 1.0};
    if (trainer->worker_count == 1)
        return HADA_OK;
    what.end = hada_engine_count(trainer->workers->engine, group, what.content);
    return share(trainer, &what, err);
}

hada_status hada_train_mean_statistics(hada_trainer *trainer, hada_error *err)
{
    exchange what = {.group = HADA_GROUP_NET, .content = HADA_CONTENT_VALUES};
    if (trainer->worker_count == 1 || !trainer->net || trainer->net->floats == trainer->net->trained)
        return HADA_OK;
    what.first = trainer->net->trained;
    what.end = trainer->net->floats;
    what.factor = 1.0 / trainer->worker_count;
    return share(trainer, &what, err);
}
