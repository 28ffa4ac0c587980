/* Workers, and the threads in which they work together. */
#include "train/workers.h"

#include "core/clock.h"
#include "net/enhance.h"

typedef struct member {
    hada_worker_threads *threads;
    int number, started;
    pthread_t thread;
} member;

struct hada_worker_threads {
    pthread_mutex_t lock;
    pthread_cond_t begins, ends;
    member *members;
    int count;
    uint64_t task; /* changes when one begins */
    int at_work, stop;
    void (*work)(void *user, int member);
    void *user;
};

static void *serve(void *user)
{
    const member *own = user;
    hada_worker_threads *threads = own->threads;
    uint64_t last = 0;
    pthread_mutex_lock(&threads->lock);
    for (;;) {
        while (!threads->stop && threads->task == last)
            pthread_cond_wait(&threads->begins, &threads->lock);
        if (threads->stop)
            break;
        last = threads->task;
        pthread_mutex_unlock(&threads->lock);
        threads->work(threads->user, own->number);
        pthread_mutex_lock(&threads->lock);
        if (!--threads->at_work)
            pthread_cond_signal(&threads->ends);
    }
    pthread_mutex_unlock(&threads->lock);
    return NULL;
}

/* Member 0 is the caller; each of the others has a thread, which sleeps between tasks. Where the system gives no thread
 * for a member, the caller does its work as well. */
static hada_status threads_create(hada_worker_threads **out, int count, hada_error *err)
{
    hada_worker_threads *threads = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_NEW(threads, 1, "threads", err));
    HADA_TRY_OR_DONE(HADA_NEW(threads->members, (size_t)count, "threads", err));
    threads->count = count;
    threads->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    threads->begins = (pthread_cond_t)PTHREAD_COND_INITIALIZER;
    threads->ends = (pthread_cond_t)PTHREAD_COND_INITIALIZER;
    for (int i = 0; i < count; i++) {
        member *it = &threads->members[i];
        *it = (member){.threads = threads, .number = i};
        it->started = i && hada_thread_start(&it->thread, serve, it);
    }
    *out = threads;
done:
    if (status)
        free(threads);
    return status;
}

static void threads_destroy(hada_worker_threads **pointer)
{
    hada_worker_threads *threads = hada_taken(pointer);
    if (!threads)
        return;
    pthread_mutex_lock(&threads->lock);
    threads->stop = 1;
    pthread_cond_broadcast(&threads->begins);
    pthread_mutex_unlock(&threads->lock);
    for (int i = 0; i < threads->count; i++)
        if (threads->members[i].started)
            pthread_join(threads->members[i].thread, NULL);
    pthread_cond_destroy(&threads->begins);
    pthread_cond_destroy(&threads->ends);
    pthread_mutex_destroy(&threads->lock);
    HADA_FREE(threads->members, threads);
}

/* work(user, member) for every member at the same time; returns when all are done. No member may wait for another
 * within it. */
static void threads_run(hada_worker_threads *threads, void (*work)(void *user, int member), void *user)
{
    pthread_mutex_lock(&threads->lock);
    threads->work = work;
    threads->user = user;
    for (int i = 0; i < threads->count; i++)
        threads->at_work += threads->members[i].started;
    threads->task++;
    pthread_cond_broadcast(&threads->begins);
    pthread_mutex_unlock(&threads->lock);
    for (int i = 0; i < threads->count; i++)
        if (!threads->members[i].started)
            work(user, i);
    pthread_mutex_lock(&threads->lock);
    while (threads->at_work)
        pthread_cond_wait(&threads->ends, &threads->lock);
    pthread_mutex_unlock(&threads->lock);
}

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
    workers->count = own.shares = count;
    if (count > 1)
        HADA_TRY(threads_create(&workers->threads, count, err));
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
    threads_destroy(&workers->threads);
    hada_buckets_free(&workers->buckets);
    for (int i = 0; i < workers->count; i++)
        destroy_worker(&workers->worker[i]);
    free(workers->worker);
    *workers = (hada_workers){0};
}

typedef struct task {
    hada_workers *workers;
    hada_work work;
    void *user;
} task;

static void run_task(void *user, int number)
{
    const task *what = user;
    hada_worker *worker = &what->workers->worker[number];
    worker->status = what->work(what->workers, number, what->user, &worker->error);
}

hada_status hada_workers_run(hada_workers *workers, hada_work work, void *user, hada_error *err)
{
    if (workers->count == 1)
        return work(workers, 0, user, err);
    threads_run(workers->threads, run_task, &(task){workers, work, user});
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
