/* A plan: what is known of a model and its options, and the workers that take its frames. Internal.
 *
 * A worker is a pipeline with a thread. One lock guards the lists of frames and the workers, but not the frames
 * themselves, which belong to the worker that runs them; one condition signals every change. Jobs may outlive their
 * plan, so the dispatcher is freed with the last of them. */
#ifndef HADA_DISPATCH_PLAN_H
#define HADA_DISPATCH_PLAN_H

#include <hadalens/job.h>
#include <pthread.h>

#include "emitters/emitters.h"
#include "engine/pipeline.h"

typedef struct hada_dispatcher hada_dispatcher;
typedef struct hada_cache_entry hada_cache_entry; /* dispatch/frame_cache.c */

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
    hada_frame frame; /* its owner is the job */
    hada_image copy;  /* on the host, of a frame that is given on the device */
    hada_dispatcher *dispatcher;
    hada_job *next; /* in one of the dispatcher's lists */
    hada_job_state state;
    hada_error error;
    hada_queue_worker *worker;        /* that runs the frame; NULL while it waits */
    unsigned char *depths;            /* per computed depth: who has it (dispatch/dispatcher.c) */
    int open, helpers;                /* other workers may take batches; how many are at it */
    hada_cache_entry *entry, *source; /* of this frame, or of the previous one where that is equal */
    hada_cache_entry *chooser; /* of the frame that finds the weight of total variation for this one; NULL: none */
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
    int closing;                       /* the plan is being destroyed */
};

/* Pipelines of one device do not help each other: it is busy with them already. */
static inline int hada_worker_helps(const hada_queue_worker *worker, const hada_queue_worker *owner)
{
    return worker->info.device != owner->info.device;
}

/* Two frames that later ones depend on (dispatch/frame_cache.c): the last one submitted, for frames that equal it, and
 * the one that found the weight of total variation, for frames that use this weight. Whether a frame depends on either
 * is decided when it is submitted, one frame after the other, so the answer does not depend on the workers. */
typedef struct hada_frame_cache {
    pthread_mutex_t lock; /* held while a frame is compared */
    hada_cache_entry *last, *chosen;
    int keeps; /* so many further frames have their results kept */
} hada_frame_cache;

void hada_frame_cache_make(hada_frame_cache *cache);
void hada_frame_cache_free(hada_frame_cache *cache);

/* Before a job is submitted: the job gets the last frame as its source, or becomes the last frame itself. It also gets
 * the frame that finds its weight, or becomes that frame for later ones. */
hada_status hada_frame_cache_enter(hada_frame_cache *cache, hada_job *job, hada_error *err);

/* In the worker. *reused: 1: the source's result was copied; 0: the frame is to be computed. */
hada_status hada_frame_cache_reuse(hada_job *job, int *reused, hada_error *err);

/* A worker takes the job: in the order of submission, so that frames wait only for frames that run. */
void hada_frame_cache_take(hada_job *job);

/* Before and after a frame is computed, and when its job ends. The frame gets the weight that was kept for it, once
 * that is found. */
void hada_frame_cache_begin(hada_job *job);
void hada_frame_cache_done(hada_job *job, hada_status status);
void hada_frame_cache_leave(hada_job *job);

struct hada_plan {
    hada_setup setup;
    hada_frame_cache cache;
    hada_constants **constants; /* one a context */
    int contexts;
    hada_dispatcher *dispatcher;
    pthread_mutex_t points_lock; /* of the next */
    hada_point_optics *points;   /* NULL until emitters of a frame are asked for */
};

/* Room for so many workers, to be added one by one, those of a device together. */
hada_status hada_dispatcher_create(hada_dispatcher **out, int workers, hada_error *err);
/* `device` counts the plan's contexts, `number` the queues of a device. */
hada_status hada_dispatcher_add(hada_dispatcher *dispatcher, const hada_setup *setup, const hada_constants *constants,
                                int device, int number, int batch, hada_error *err);

/* For the end of the plan: cancels all jobs, waits for the threads, destroys the pipelines. */
void hada_dispatcher_stop(hada_dispatcher *dispatcher);
/* Drops a reference, the plan's or a job's. */
void hada_dispatcher_release(hada_dispatcher *dispatcher);

/* Adds the job at the end of the queue; the first job makes the threads. */
hada_status hada_dispatcher_submit(hada_dispatcher *dispatcher, hada_job *job, hada_error *err);
/* Whether a job that has not ended fills the result. */
int hada_dispatcher_fills(hada_dispatcher *dispatcher, const hada_result *result);
/* Asks the job to end; one that waits ends at once. */
void hada_dispatcher_cancel(hada_dispatcher *dispatcher, hada_job *job);

/* A plan with one worker and no thread yet works in the caller's thread: if the worker is free, reserves it until
 * hada_dispatcher_leave() and returns a serial for the frame; else returns 0. */
uint64_t hada_dispatcher_occupy(hada_dispatcher *dispatcher);
void hada_dispatcher_leave(hada_dispatcher *dispatcher, double busy_seconds);

/* Runs a job's frame on the worker, or copies the result of an equal one. */
hada_status hada_worker_run(hada_queue_worker *worker, hada_job *job, hada_error *err);

/* Frees what a job holds; a result that failed is emptied. */
void hada_job_release(hada_job *job, hada_status status);

/* Batches of depths that workers take from a job's frame: what the engine asks for (engine/frame.h).
 *
 * The worker that runs the frame takes from the near end, so that it can push what it computed to the focus at once;
 * workers of other devices that help take from the far end and leave their planes in the result. */
extern const hada_batches hada_job_batches;

#endif
