/* The frame that was submitted last and its result, for frames that equal it. Internal.
 *
 * Frames are compared when they are submitted, one after the other, so that what is found does not depend on which
 * lane does what. */
#ifndef HADA_DISPATCH_FRAME_CACHE_H
#define HADA_DISPATCH_FRAME_CACHE_H

#include <hadalens/reconstruct.h>
#include <pthread.h>

#include "core/error.h"

typedef struct hada_plan hada_plan;
typedef struct hada_task hada_task;

/* A frame and what became of it; shared by the plan and the tasks that need it. */
typedef struct hada_kept hada_kept;

typedef struct hada_frames {
    pthread_mutex_t lock; /* held while a frame is compared */
    hada_kept *last;
} hada_frames;

void hada_frames_make(hada_frames *frames);
void hada_frames_free(hada_frames *frames);

/* Before the task is handed in: finds out whether the frame before serves (task->source), else
 * keeps a copy of this one (task->kept). Where the two are nearly equal it waits for the result of the one before. */
hada_status hada_frames_enter(hada_frames *frames, hada_task *task, hada_error *err);

/* Host bytes that a plan's frames take. */
uint64_t hada_frames_bytes(uint64_t frame, uint64_t result);

/* In the lane. If the task has a source with a result: gives that and returns 1. 0: the frame is to be computed. */
int hada_frames_reuse(hada_task *task, hada_status *status, hada_error *err);

/* Round the computing of a frame that is kept. */
void hada_frames_begin(hada_task *task);
void hada_frames_done(hada_task *task, hada_status status);

/* When the task ends. */
void hada_frames_leave(hada_task *task);

#endif
