/* The frame that was submitted last and its result, for frames that equal it. Internal.
 *
 * Frames are compared when they are submitted, one after the other, so that what is found does not depend on which
 * worker does what. */
#ifndef HADA_DISPATCH_FRAME_CACHE_H
#define HADA_DISPATCH_FRAME_CACHE_H

#include "dispatch/state.h"

typedef struct hada_frame_cache {
    pthread_mutex_t lock; /* held while a frame is compared */
    hada_cache_entry *last;
} hada_frame_cache;

void hada_frame_cache_make(hada_frame_cache *cache);
void hada_frame_cache_free(hada_frame_cache *cache);

/* Before a job is submitted: finds out whether the frame before serves (job->source), else keeps a copy of this one
 * (job->entry). Where the two are nearly equal it waits for the result of the one before. */
hada_status hada_frame_cache_enter(hada_frame_cache *cache, hada_job *job, hada_error *err);

/* In the worker. *reused: 1: the job's source had a result, which is given; 0: the frame is to be computed. */
hada_status hada_frame_cache_reuse(hada_job *job, int *reused, hada_error *err);

/* Round the computing of a frame that is kept. */
void hada_frame_cache_begin(hada_job *job);
void hada_frame_cache_done(hada_job *job, hada_status status);

/* When the job ends. */
void hada_frame_cache_leave(hada_job *job);

#endif
