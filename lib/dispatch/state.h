/* What a plan's dispatcher knows: the frames that wait, those that run, and the workers that look for them. Internal.
 *
 * A worker is a pipeline with a thread. One lock guards all of it but the frames themselves, which belong to the worker
 * that runs them; one condition tells of every change. Jobs may outlive their plan, so the state goes with the last. */
#ifndef HADA_DISPATCH_STATE_H
#define HADA_DISPATCH_STATE_H

#include <hadalens/job.h>
#include <pthread.h>

#include "engine/pipeline.h"

typedef struct hada_dispatcher hada_dispatcher;
typedef struct hada_cache_entry hada_cache_entry; /* dispatch/frame_cache.h */

typedef struct hada_queue_worker {
    hada_dispatcher *dispatcher;
    hada_pipeline *pipeline;
    hada_context *context;
    int number; /* among those of its device */
    hada_queue_info info;
    pthread_t thread;
    int has_thread, idle;
} hada_queue_worker;

struct hada_job {
    hada_frame frame;           /* its owner is the job */
    hada_image converted, view; /* of a frame that was given in another form; the latter owns nothing */
    hada_dispatcher *dispatcher;
    hada_job *next; /* in one of the dispatcher's lists */
    hada_job_state state;
    hada_error error;
    hada_queue_worker *worker;        /* that runs the frame; NULL while it waits */
    unsigned char *depths;            /* per computed depth: who has it (dispatch/batches.c) */
    int open, helpers;                /* other workers may take batches; how many are at it */
    hada_cache_entry *entry, *source; /* this frame's copy, or the frame before that serves (dispatch/frame_cache.h) */
    double source_change;             /* what the latter changes at most: L2 */
};

struct hada_dispatcher {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    int references;    /* the plan and its jobs */
    hada_job *waiting; /* in the order of submission */
    hada_job *running; /* oldest first */
    uint64_t serial;   /* of the last frame */
    hada_queue_worker *workers;
    int capacity, worker_count, alive; /* workers that are to be, that are, and that are not lost */
    int threads;                       /* workers have threads */
    int occupied;                      /* the plan's one worker works in a caller's thread */
    int closing;                       /* the plan goes */
};

/* Pipelines of one device do not help each other: it is busy with them already. */
static inline int hada_worker_helps(const hada_queue_worker *worker, const hada_queue_worker *owner)
{
    return worker->info.device != owner->info.device;
}

#endif
