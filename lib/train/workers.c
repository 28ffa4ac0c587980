/* Workers, and how they work together. */
#include "train/workers.h"

#include "core/clock.h"
#include "net/enhance.h"

/* What a worker does while the others do it too. */
struct hada_worker_task {
    hada_workers *workers;
    int number, started;
    hada_work work;
    void *user;
    pthread_t thread;
};

static hada_status make_worker(hada_worker *worker, hada_context *context, const hada_replica_desc *desc, int planes,
                               hada_error *err)
{
    const size_t most = (size_t)desc->at_once, depths = (size_t)desc->model->info.depths;
    HADA_TRY(hada_slot_create(&worker->slot, context, err));
    HADA_TRY(hada_replica_create(&worker->replica, worker->slot, desc, err));
    if (planes)
        HADA_TRY(hada_planes_create(&worker->planes, worker->slot, desc->model, desc->options->compose > 0.0,
                                    hada_enhance_sees_others(desc->net, desc->model->info.channels), err));
    HADA_TRY(HADA_NEW(worker->samples, most, "a step", err));
    HADA_TRY(HADA_NEW(worker->own, most, "a step", err));
    HADA_TRY(HADA_NEW(worker->touched, depths, "a step", err));
    worker->at_once = desc->at_once;
    return HADA_OK;
}

/* Room for what workers exchange: a depth's filters. */
static hada_status make_exchange(hada_workers *workers, const hada_communicator *ranks, hada_error *err)
{
    const int several = workers->count > 1 || hada_ranks(ranks) > 1;
    size_t most = 0;
    for (int g = HADA_GROUP_FILTERS; g < workers->groups; g++) {
        const size_t count = hada_workers_floats(workers, g, HADA_CONTENT_VALUES);
        most = count > most ? count : most;
    }
    for (int i = 0; most && several && i < workers->count; i++)
        HADA_TRY(HADA_NEW_RAW(workers->worker[i].room, most, "averaging", err));
    return HADA_OK;
}

hada_status hada_workers_create(hada_workers *workers, hada_context *const *contexts, int count,
                                const hada_communicator *ranks, const hada_replica_desc *desc, int planes,
                                hada_error *err)
{
    hada_replica_desc own = *desc;
    hada_status status = HADA_OK;
    *workers = (hada_workers){0};
    HADA_TRY(HADA_NEW(workers->worker, (size_t)count, "a trainer", err));
    HADA_TRY(HADA_NEW(workers->tasks, (size_t)count, "a trainer", err));
    workers->count = own.shares = count;
    for (int i = 0; i < count; i++) {
        own.share = i;
        status = make_worker(&workers->worker[i], contexts[i], &own, planes, err);
        if (status && count > 1)
            hada_error_prefix(err, "device %d: ", i);
        HADA_TRY(status);
    }
    workers->groups = hada_worker_parameters(workers->worker)->count;
    workers->ranks = ranks;
    HADA_TRY(make_exchange(workers, ranks, err));
    if (count == 1)
        HADA_TRY(hada_buckets_create(&workers->buckets, ranks, hada_worker_parameters(workers->worker), err));
    return status;
}

static void destroy_worker(hada_worker *worker)
{
    for (int i = 0; i < worker->at_once; i++)
        hada_example_free(&worker->own[i]);
    hada_planes_destroy(&worker->planes);
    hada_replica_destroy(&worker->replica);
    hada_slot_destroy(&worker->slot);
    HADA_FREE(worker->samples, worker->own, worker->touched, worker->room);
}

void hada_workers_destroy(hada_workers *workers)
{
    hada_buckets_free(&workers->buckets);
    for (int i = 0; i < workers->count; i++)
        destroy_worker(&workers->worker[i]);
    HADA_FREE(workers->worker, workers->tasks);
    *workers = (hada_workers){0};
}

static void *run_task(void *user)
{
    const hada_worker_task *own = user;
    hada_worker *worker = &own->workers->worker[own->number];
    worker->status = own->work(own->workers, own->number, own->user, &worker->error);
    return NULL;
}

/* The caller is the first worker's thread, and that of those for which the system gives none. */
hada_status hada_workers_run(hada_workers *workers, hada_work work, void *user, hada_error *err)
{
    if (workers->count == 1)
        return work(workers, 0, user, err);
    for (int i = workers->count - 1; i >= 0; i--) {
        hada_worker_task *task = &workers->tasks[i];
        *task = (hada_worker_task){.workers = workers, .number = i, .work = work, .user = user};
        task->started = i && hada_thread_start(&task->thread, run_task, task);
        if (!task->started)
            run_task(task);
    }
    for (int i = 0; i < workers->count; i++)
        if (workers->tasks[i].started)
            pthread_join(workers->tasks[i].thread, NULL);
    for (int i = 0; i < workers->count; i++)
        if (workers->worker[i].status) {
            if (err)
                *err = workers->worker[i].error;
            return workers->worker[i].status;
        }
    return HADA_OK;
}

size_t hada_workers_floats(const hada_workers *workers, int group, hada_content content)
{
    return hada_parameters_floats(hada_worker_parameters(workers->worker), group, content);
}

int hada_workers_have(const hada_workers *workers, int group)
{
    return hada_workers_floats(workers, group, HADA_CONTENT_VALUES) > 0;
}

hada_status hada_workers_read(hada_workers *workers, int group, hada_content content, float *out, hada_error *err)
{
    const int parts = content == HADA_CONTENT_STATE && group < HADA_GROUP_FILTERS ? workers->count : 1;
    for (int w = 0; w < parts; w++)
        HADA_TRY(hada_parameters_read(hada_worker_parameters(&workers->worker[w]), group, content, out, err));
    return HADA_OK;
}

typedef struct contents {
    int group;
    const float *values, *states;
} contents;

static hada_status write_one(hada_workers *workers, int number, void *user, hada_error *err)
{
    const contents *what = user;
    hada_parameters *parameters = hada_worker_parameters(&workers->worker[number]);
    HADA_TRY(hada_parameters_write(parameters, what->group, HADA_CONTENT_VALUES, what->values, err));
    return hada_parameters_write(parameters, what->group, HADA_CONTENT_STATE, what->states, err);
}

hada_status hada_workers_write(hada_workers *workers, int group, const float *values, const float *states,
                               hada_error *err)
{
    contents what = {group, values, states};
    return hada_workers_have(workers, group) ? hada_workers_run(workers, write_one, &what, err) : HADA_OK;
}
