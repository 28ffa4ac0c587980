/* The workers: each pulls the next frame, or helps with one that runs, and hands on what it cannot do. */

#include "core/clock.h"
#include "dispatch/plan.h"

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

/* Whether a helper would find any. With the lock held. */
static int batches_left(const hada_job *job)
{
    return job->open && count_free(job);
}

/* The nearest or the farthest run of free depths; returns its length. */
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

static void put_batch(hada_job *job, hada_queue_worker *worker, int first, int count, int done)
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
    put_batch(job, job->worker, first, count, done);
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

hada_status hada_dispatcher_create(hada_dispatcher **out, int workers, hada_error *err)
{
    hada_dispatcher *dispatcher = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(dispatcher, 1, "a plan", err));
    HADA_TRY_OR_DONE(HADA_NEW(dispatcher->workers, (size_t)workers, "a plan", err));
    dispatcher->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    hada_condition_init(&dispatcher->changed);
    dispatcher->references = 1;
    dispatcher->capacity = workers;
done:
    if (status) {
        free(dispatcher);
        dispatcher = NULL;
    }
    *out = dispatcher;
    return status;
}

hada_status hada_dispatcher_add(hada_dispatcher *dispatcher, const hada_setup *setup, const hada_constants *constants,
                                int device, int number, int batch, hada_error *err)
{
    hada_queue_worker *worker = &dispatcher->workers[dispatcher->worker_count];
    *worker = (hada_queue_worker){
        .dispatcher = dispatcher, .context = constants->context, .number = number, .info.device = device};
    HADA_TRY(hada_pipeline_create(&worker->pipeline, setup, constants, batch, err));
    dispatcher->worker_count++;
    dispatcher->alive++;
    return HADA_OK;
}

void hada_dispatcher_release(hada_dispatcher *dispatcher)
{
    pthread_mutex_lock(&dispatcher->lock);
    const int left = --dispatcher->references;
    pthread_mutex_unlock(&dispatcher->lock);
    if (left)
        return;
    pthread_cond_destroy(&dispatcher->changed);
    pthread_mutex_destroy(&dispatcher->lock);
    HADA_FREE(dispatcher->workers, dispatcher);
}

static void push_back(hada_job **list, hada_job *job)
{
    while (*list)
        list = &(*list)->next;
    job->next = NULL;
    *list = job;
}

static void push_front(hada_job **list, hada_job *job)
{
    job->next = *list;
    *list = job;
}

static void take_out(hada_job **list, hada_job *job)
{
    while (*list && *list != job)
        list = &(*list)->next;
    if (*list)
        *list = job->next;
    job->next = NULL;
}

void hada_job_release(hada_job *job, hada_status status)
{
    hada_frame_end(&job->frame, status);
    hada_frame_cache_leave(job);
    hada_image_destroy(&job->copy);
    free(job->depths);
    job->depths = NULL;
}

/* Wakes those who wait for the job. With the lock held. */
static void end(hada_dispatcher *dispatcher, hada_job *job, const hada_error *error)
{
    const hada_status status = error ? error->status : HADA_OK;
    hada_job_release(job, status);
    if (error)
        job->error = *error;
    else
        hada_frame_progress(&job->frame, job->frame.work);
    job->state = !status ? HADA_JOB_DONE : status == HADA_ERROR_CANCELLED ? HADA_JOB_CANCELLED : HADA_JOB_FAILED;
    pthread_cond_broadcast(&dispatcher->changed);
}

static int is_of_the_device(hada_status status)
{
    return status == HADA_ERROR_DEVICE || status == HADA_ERROR_DEVICE_MEMORY || status == HADA_ERROR_BUILD ||
           status == HADA_ERROR_SELF_TEST;
}

/* Without the lock: the receiver of the message may ask for the state of the queues. */
static void tell_loss(hada_dispatcher *dispatcher, const hada_queue_worker *worker, const hada_error *error)
{
    pthread_mutex_lock(&dispatcher->lock);
    const int others = dispatcher->alive > 1;
    pthread_mutex_unlock(&dispatcher->lock);
    hada_log(worker->context, HADA_LOG_WARNING, "queue %d of device %d (%s) is out of use: %s%s", worker->number,
             worker->info.device, worker->context->info.name, error->message,
             others ? "; the others take over its work" : "");
}

/* The worker goes out of use. When it was the last one, all may try again: the next frame is not to blame. Returns how
 * many are left now. */
static int lose(hada_dispatcher *dispatcher, hada_queue_worker *worker)
{
    const int left = --dispatcher->alive;
    worker->info.lost = 1;
    for (int i = 0; !left && i < dispatcher->worker_count; i++) {
        dispatcher->workers[i].info.lost = 0;
        dispatcher->alive++;
    }
    return left;
}

hada_status hada_worker_run(hada_queue_worker *worker, hada_job *job, hada_error *err)
{
    int reused;
    hada_status status = hada_frame_cache_reuse(job, &reused, err);
    if (status || reused)
        return status;
    hada_frame_cache_begin(job);
    status = hada_pipeline_run(worker->pipeline, &job->frame, err);
    hada_frame_cache_done(job, status);
    return status;
}

static void run_frame(hada_dispatcher *dispatcher, hada_queue_worker *worker, hada_job *job)
{
    hada_error error = {0};
    take_out(&dispatcher->waiting, job);
    push_back(&dispatcher->running, job);
    job->state = HADA_JOB_RUNNING;
    job->worker = worker;
    hada_frame_cache_take(job);
    worker->info.frames++;
    pthread_mutex_unlock(&dispatcher->lock);
    const double start = hada_seconds();
    const hada_status status = hada_worker_run(worker, job, &error);
    const double busy = hada_seconds() - start;
    if (is_of_the_device(status))
        tell_loss(dispatcher, worker, &error);
    pthread_mutex_lock(&dispatcher->lock);
    worker->info.busy_seconds += busy;
    job->worker = NULL;
    take_out(&dispatcher->running, job);
    if (!is_of_the_device(status)) {
        end(dispatcher, job, status ? &error : NULL);
        return;
    }
    if (!job->error.status)
        job->error = error; /* the first failure is reported */
    if (lose(dispatcher, worker)) {
        push_front(&dispatcher->waiting, job);
        pthread_cond_broadcast(&dispatcher->changed);
    } else {
        error = job->error;
        end(dispatcher, job, &error);
    }
}

static hada_job *find_help(const hada_dispatcher *dispatcher, const hada_queue_worker *worker)
{
    for (hada_job *job = dispatcher->running; job; job = job->next)
        if (hada_worker_helps(worker, job->worker) && batches_left(job))
            return job;
    return NULL;
}

static hada_status help_once(hada_queue_worker *worker, hada_job *job, hada_error *err)
{
    int first;
    const int count = take(job, worker, 1, hada_pipeline_batch(worker->pipeline), &first);
    if (!count)
        return HADA_OK;
    const hada_status status = hada_pipeline_help(worker->pipeline, &job->frame, first, count, err);
    put_batch(job, worker, first, count, !status);
    return status;
}

static void help(hada_dispatcher *dispatcher, hada_queue_worker *worker, hada_job *job)
{
    hada_error error = {0};
    job->helpers++;
    pthread_mutex_unlock(&dispatcher->lock);
    const double start = hada_seconds();
    const hada_status status = help_once(worker, job, &error);
    const double busy = hada_seconds() - start;
    const int lost = status && status != HADA_ERROR_CANCELLED;
    if (lost)
        tell_loss(dispatcher, worker, &error);
    pthread_mutex_lock(&dispatcher->lock);
    worker->info.busy_seconds += busy;
    job->helpers--;
    pthread_cond_broadcast(&dispatcher->changed);
    if (lost)
        lose(dispatcher, worker);
}

static void *work(void *argument)
{
    hada_queue_worker *worker = argument;
    hada_dispatcher *dispatcher = worker->dispatcher;
    pthread_mutex_lock(&dispatcher->lock);
    while (!dispatcher->closing) {
        const int able = !worker->info.lost && !dispatcher->occupied;
        hada_job *job;
        if (able && dispatcher->waiting) {
            run_frame(dispatcher, worker, dispatcher->waiting);
        } else if (able && (job = find_help(dispatcher, worker))) {
            help(dispatcher, worker, job);
        } else {
            worker->idle = able;
            pthread_cond_wait(&dispatcher->changed, &dispatcher->lock);
            worker->idle = 0;
        }
    }
    pthread_mutex_unlock(&dispatcher->lock);
    return NULL;
}

/* A thread for each worker, once. With the lock held. */
static hada_status start_threads(hada_dispatcher *dispatcher, hada_error *err)
{
    for (int i = 0; !dispatcher->threads && i < dispatcher->worker_count; i++) {
        hada_queue_worker *worker = &dispatcher->workers[i];
        if (!worker->has_thread)
            worker->has_thread = hada_thread_start(&worker->thread, work, worker);
        if (!worker->has_thread)
            return hada_fail(err, HADA_ERROR_MEMORY, "the system gives no more threads; use fewer queues");
    }
    dispatcher->threads = 1;
    return HADA_OK;
}

hada_status hada_dispatcher_submit(hada_dispatcher *dispatcher, hada_job *job, hada_error *err)
{
    pthread_mutex_lock(&dispatcher->lock);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(start_threads(dispatcher, err));
    dispatcher->references++;
    job->frame.serial = ++dispatcher->serial;
    push_back(&dispatcher->waiting, job);
    pthread_cond_broadcast(&dispatcher->changed);
done:
    pthread_mutex_unlock(&dispatcher->lock);
    return status;
}

int hada_dispatcher_fills(hada_dispatcher *dispatcher, const hada_result *result)
{
    int fills = 0;
    pthread_mutex_lock(&dispatcher->lock);
    const hada_job *const lists[] = {dispatcher->waiting, dispatcher->running};
    for (int k = 0; k < 2; k++)
        for (const hada_job *job = lists[k]; job; job = job->next)
            fills |= job->frame.result == result;
    pthread_mutex_unlock(&dispatcher->lock);
    return fills;
}

void hada_dispatcher_cancel(hada_dispatcher *dispatcher, hada_job *job)
{
    pthread_mutex_lock(&dispatcher->lock);
    const int ended = job->state >= HADA_JOB_DONE;
    if (!ended)
        atomic_store(&job->frame.cancelled, 1);
    if (!ended && !job->worker) {
        hada_error error;
        hada_frame_check(&job->frame, &error);
        take_out(&dispatcher->waiting, job);
        end(dispatcher, job, &error);
    }
    pthread_mutex_unlock(&dispatcher->lock);
}

void hada_dispatcher_stop(hada_dispatcher *dispatcher)
{
    const hada_error cancelled = {HADA_ERROR_CANCELLED, 0, "the job's plan was destroyed", ""};
    pthread_mutex_lock(&dispatcher->lock);
    while (dispatcher->waiting) {
        hada_job *job = dispatcher->waiting;
        take_out(&dispatcher->waiting, job);
        end(dispatcher, job, &cancelled);
    }
    for (hada_job *job = dispatcher->running; job; job = job->next)
        atomic_store(&job->frame.cancelled, 1);
    dispatcher->closing = 1;
    pthread_cond_broadcast(&dispatcher->changed);
    pthread_mutex_unlock(&dispatcher->lock);
    for (int i = 0; i < dispatcher->worker_count; i++) {
        hada_queue_worker *worker = &dispatcher->workers[i];
        if (worker->has_thread)
            pthread_join(worker->thread, NULL);
    }
    for (int i = 0; i < dispatcher->worker_count; i++)
        hada_pipeline_destroy(&dispatcher->workers[i].pipeline);
}

uint64_t hada_dispatcher_occupy(hada_dispatcher *dispatcher)
{
    uint64_t serial = 0;
    pthread_mutex_lock(&dispatcher->lock);
    if (dispatcher->worker_count == 1 && !dispatcher->threads && !dispatcher->occupied) {
        dispatcher->occupied = 1;
        dispatcher->workers[0].info.frames++;
        serial = ++dispatcher->serial;
    }
    pthread_mutex_unlock(&dispatcher->lock);
    return serial;
}

void hada_dispatcher_leave(hada_dispatcher *dispatcher, double busy_seconds)
{
    pthread_mutex_lock(&dispatcher->lock);
    dispatcher->occupied = 0;
    dispatcher->workers[0].info.busy_seconds += busy_seconds;
    pthread_cond_broadcast(&dispatcher->changed);
    pthread_mutex_unlock(&dispatcher->lock);
}
