#include "train/worker_threads.h"

#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <stdlib.h>

#include "core/alloc.h"

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

hada_status hada_worker_threads_create(hada_worker_threads **out, int count, hada_error *err)
{
    hada_worker_threads *threads = NULL;
    sigset_t all, before;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(hada_allocated(threads = hada_alloc(1, sizeof *threads, "threads", err)));
    HADA_TRY_OR_DONE(
        hada_allocated(threads->members = hada_alloc((size_t)count, sizeof *threads->members, "threads", err)));
    threads->count = count;
    threads->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    threads->begins = (pthread_cond_t)PTHREAD_COND_INITIALIZER;
    threads->ends = (pthread_cond_t)PTHREAD_COND_INITIALIZER;
    sigfillset(&all); /* signals are for the program's own threads */
    pthread_sigmask(SIG_SETMASK, &all, &before);
    for (int i = 0; i < count; i++) {
        member *it = &threads->members[i];
        *it = (member){.threads = threads, .number = i};
        it->started = i && !pthread_create(&it->thread, NULL, serve, it);
    }
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    *out = threads;
done:
    if (status)
        free(threads);
    return status;
}

void hada_worker_threads_destroy(hada_worker_threads **pointer)
{
    hada_worker_threads *threads = pointer ? *pointer : NULL;
    if (!threads)
        return;
    *pointer = NULL;
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
    free(threads->members);
    free(threads);
}

void hada_worker_threads_run(hada_worker_threads *threads, void (*work)(void *user, int member), void *user)
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
