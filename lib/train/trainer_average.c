/* Several devices: their gradients become one, in a fixed order. */
#include "train/trainer.h"

typedef struct exchange {
    int group;
    hada_content content;
} exchange;

static hada_status read_one(hada_trainer *trainer, int worker, void *user, hada_error *err)
{
    const exchange *what = user;
    hada_worker *own = &trainer->workers[worker];
    return hada_engine_read(own->engine, what->group, what->content, own->values, err);
}

static hada_status write_one(hada_trainer *trainer, int worker, void *user, hada_error *err)
{
    const exchange *what = user;
    return hada_engine_write(trainer->workers[worker].engine, what->group, what->content, trainer->workers->values,
                             err);
}

/* Sums of all workers' values, from the first on, times `factor`. */
static void add_up(hada_trainer *trainer, size_t first, size_t count, double factor)
{
    float *sum = trainer->workers->values;
    for (size_t i = first; i < count; i++) {
        double value = sum[i];
        for (int w = 1; w < trainer->worker_count; w++)
            value += trainer->workers[w].values[i];
        sum[i] = (float)(value * factor);
    }
}

hada_status hada_train_sum_gradients(hada_trainer *trainer, int group, hada_error *err)
{
    exchange what = {group, HADA_CONTENT_GRADIENT};
    if (trainer->worker_count == 1)
        return HADA_OK;
    hada_status status = hada_workers_run(trainer, read_one, &what, err);
    if (status)
        return status;
    add_up(trainer, 0, hada_engine_count(trainer->workers->engine, group, HADA_CONTENT_GRADIENT), 1.0);
    return hada_workers_run(trainer, write_one, &what, err);
}

hada_status hada_train_mean_statistics(hada_trainer *trainer, hada_error *err)
{
    exchange what = {HADA_GROUP_NET, HADA_CONTENT_VALUES};
    if (trainer->worker_count == 1 || !trainer->net || trainer->net->floats == trainer->net->trained)
        return HADA_OK;
    hada_status status = hada_workers_run(trainer, read_one, &what, err);
    if (status)
        return status;
    add_up(trainer, trainer->net->trained, trainer->net->floats, 1.0 / trainer->worker_count);
    return hada_workers_run(trainer, write_one, &what, err);
}
