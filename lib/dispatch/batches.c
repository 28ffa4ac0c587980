#include "dispatch/batches.h"

#include <string.h>

/* What job->depths holds. */
enum {
    FREE = 0,
    TAKEN = 1,
    DONE = 2, /* its plane is in the result */
    EMPTY = 3 /* its plane is not computed: nothing is there */
};

static void open_batches(hada_frame *frame, const unsigned char *wanted)
{
    hada_job *job = frame->owner;
    hada_dispatcher *dispatcher = job->dispatcher;
    pthread_mutex_lock(&dispatcher->lock);
    for (int z = 0; z < frame->setup->config.depths; z++)
        job->depths[z] = wanted[z] ? FREE : EMPTY;
    job->open = 1;
    pthread_cond_broadcast(&dispatcher->changed);
    pthread_mutex_unlock(&dispatcher->lock);
}

static void close_batches(hada_frame *frame)
{
    hada_job *job = frame->owner;
    hada_dispatcher *dispatcher = job->dispatcher;
    pthread_mutex_lock(&dispatcher->lock);
    job->open = 0;
    while (job->helpers)
        pthread_cond_wait(&dispatcher->changed, &dispatcher->lock);
    pthread_mutex_unlock(&dispatcher->lock);
}

static int count_free(const hada_job *job)
{
    int count = 0;
    for (int z = 0; z < job->frame.setup->config.depths; z++)
        count += job->depths[z] == FREE;
    return count;
}

int hada_batches_left(const hada_job *job)
{
    return job->open && count_free(job);
}

/* The nearest or the farthest free depths that stand together; returns how many. */
static int find_run(const hada_job *job, int farthest, int *first)
{
    const int depths = job->frame.setup->config.depths, step = farthest ? -1 : 1;
    int z = farthest ? depths - 1 : 0;
    while (z >= 0 && z < depths && job->depths[z] != FREE)
        z += step;
    const int begin = z;
    while (z >= 0 && z < depths && job->depths[z] == FREE)
        z += step;
    *first = farthest ? z + 1 : begin;
    return farthest ? begin - z : z - begin;
}

/* Workers without work that could help this one. */
static int count_idle(const hada_dispatcher *dispatcher, const hada_queue_worker *worker)
{
    int idle = 0;
    for (int i = 0; i < dispatcher->worker_count; i++)
        idle += dispatcher->workers[i].idle && hada_worker_helps(&dispatcher->workers[i], worker);
    return idle;
}

/* Half of a worker's part of what is free, so that workers of different speed end together: factoring, S. F. Hummel,
 * E. Schonberg, L. E. Flynn, Communications of the ACM 35(8), 90 (1992). */
static int part_of(int free, int workers)
{
    return (free + 2 * workers - 1) / (2 * workers);
}

/* Never more than `most`, and less where other workers wait for work. */
static int take(hada_job *job, const hada_queue_worker *worker, int helps, int most, int *first)
{
    hada_dispatcher *dispatcher = job->dispatcher;
    pthread_mutex_lock(&dispatcher->lock);
    int count = 0;
    const int free = job->open ? count_free(job) : 0;
    if (free) {
        const int run = find_run(job, helps, first), idle = count_idle(dispatcher, worker);
        count = idle || helps ? part_of(free, idle + 1 + job->helpers) : free;
        count = count < most ? count : most;
        count = count < run ? count : run;
        if (helps)
            *first += run - count;
        memset(job->depths + *first, TAKEN, (size_t)count);
    }
    pthread_mutex_unlock(&dispatcher->lock);
    return count;
}

static int take_near(hada_frame *frame, int most, int *first)
{
    hada_job *job = frame->owner;
    return take(job, job->worker, 0, most, first);
}

int hada_batches_take_far(hada_job *job, const hada_queue_worker *worker, int *first)
{
    return take(job, worker, 1, hada_pipeline_batch(worker->pipeline), first);
}

void hada_batches_put(hada_job *job, hada_queue_worker *worker, int first, int count, int done)
{
    hada_dispatcher *dispatcher = job->dispatcher;
    pthread_mutex_lock(&dispatcher->lock);
    memset(job->depths + first, done ? DONE : FREE, (size_t)count);
    worker->info.batches += (uint64_t)done;
    int ended = 0;
    for (int z = 0; z < job->frame.setup->config.depths; z++)
        ended += job->depths[z] >= DONE;
    hada_frame_progress(&job->frame, 1 + ended);
    pthread_cond_broadcast(&dispatcher->changed);
    pthread_mutex_unlock(&dispatcher->lock);
}

static void put_near(hada_frame *frame, int first, int count, int done)
{
    hada_job *job = frame->owner;
    hada_batches_put(job, job->worker, first, count, done);
}

static int arrived(hada_frame *frame, int first, int wait)
{
    hada_job *job = frame->owner;
    hada_dispatcher *dispatcher = job->dispatcher;
    int count = 0;
    pthread_mutex_lock(&dispatcher->lock);
    while (wait && job->depths[first] == TAKEN)
        pthread_cond_wait(&dispatcher->changed, &dispatcher->lock);
    while (first + count < frame->setup->config.depths && job->depths[first + count] == DONE)
        count++;
    pthread_mutex_unlock(&dispatcher->lock);
    return count;
}

const hada_batches hada_job_batches = {
    .open = open_batches, .take = take_near, .put = put_near, .arrived = arrived, .close = close_batches};
