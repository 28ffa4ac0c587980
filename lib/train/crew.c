#include "train/crew.h"

#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <stdlib.h>

#include "core/alloc.h"

typedef struct member {
    hada_crew *crew;
    int number, started;
    pthread_t thread;
} member;

struct hada_crew {
    pthread_mutex_t lock;
    pthread_cond_t begins, ends;
    member *members;
    int count;
    uint64_t turn; /* changes when a turn begins */
    int at_work, stop;
    void (*work)(void *user, int member);
    void *user;
};

static void *serve(void *user)
{
    const member *own = user;
    hada_crew *crew = own->crew;
    uint64_t seen = 0;
    pthread_mutex_lock(&crew->lock);
    for (;;) {
        while (!crew->stop && crew->turn == seen)
            pthread_cond_wait(&crew->begins, &crew->lock);
        if (crew->stop)
            break;
        seen = crew->turn;
        pthread_mutex_unlock(&crew->lock);
        crew->work(crew->user, own->number);
        pthread_mutex_lock(&crew->lock);
        if (!--crew->at_work)
            pthread_cond_signal(&crew->ends);
    }
    pthread_mutex_unlock(&crew->lock);
    return NULL;
}

hada_status hada_crew_create(hada_crew **out, int count, hada_error *err)
{
    hada_crew *crew;
    sigset_t all, before;
    *out = NULL;
    hada_status status = hada_alloc((void **)&crew, 1, sizeof *crew, "threads", err);
    if (!status)
        status = hada_alloc((void **)&crew->members, (size_t)count, sizeof *crew->members, "threads", err);
    if (status) {
        free(crew);
        return status;
    }
    crew->count = count;
    pthread_mutex_init(&crew->lock, NULL);
    pthread_cond_init(&crew->begins, NULL);
    pthread_cond_init(&crew->ends, NULL);
    sigfillset(&all); /* signals are for the program's own threads */
    pthread_sigmask(SIG_SETMASK, &all, &before);
    for (int i = 0; i < count; i++) {
        member *it = &crew->members[i];
        *it = (member){.crew = crew, .number = i};
        it->started = i && !pthread_create(&it->thread, NULL, serve, it);
    }
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    *out = crew;
    return HADA_OK;
}

void hada_crew_destroy(hada_crew **pointer)
{
    hada_crew *crew = pointer ? *pointer : NULL;
    if (!crew)
        return;
    *pointer = NULL;
    pthread_mutex_lock(&crew->lock);
    crew->stop = 1;
    pthread_cond_broadcast(&crew->begins);
    pthread_mutex_unlock(&crew->lock);
    for (int i = 0; i < crew->count; i++)
        if (crew->members[i].started)
            pthread_join(crew->members[i].thread, NULL);
    pthread_cond_destroy(&crew->begins);
    pthread_cond_destroy(&crew->ends);
    pthread_mutex_destroy(&crew->lock);
    free(crew->members);
    free(crew);
}

void hada_crew_run(hada_crew *crew, void (*work)(void *user, int member), void *user)
{
    pthread_mutex_lock(&crew->lock);
    crew->work = work;
    crew->user = user;
    for (int i = 0; i < crew->count; i++)
        crew->at_work += crew->members[i].started;
    crew->turn++;
    pthread_cond_broadcast(&crew->begins);
    pthread_mutex_unlock(&crew->lock);
    for (int i = 0; i < crew->count; i++)
        if (!crew->members[i].started)
            work(user, i);
    pthread_mutex_lock(&crew->lock);
    while (crew->at_work)
        pthread_cond_wait(&crew->ends, &crew->lock);
    pthread_mutex_unlock(&crew->lock);
}
