/* A frame on its way through a plan: what the lanes that work on it must know. Internal. */
#ifndef HADA_ENGINE_FRAME_H
#define HADA_ENGINE_FRAME_H

#include <stdatomic.h>

#include "dispatch/plan.h"

struct hada_task {
    const hada_plan *plan;
    const hada_image *raw; /* as it came */
    hada_result *result;
    uint64_t serial;       /* no two tasks of a plan have the same; from 1 on */
    size_t broken;         /* pixels that are not finite */
    hada_image repaired;   /* empty where nothing was broken */
    double *levels;        /* per channel: the dark level */
    double energy;         /* refined: of the frame above its dark level */
    double start, watch;   /* seconds */
    atomic_int cancelled;  /* asked to end; launches look at it */
    int work;              /* to do: uploading, a unit for each depth or refinement step, ... */
    atomic_int progress;   /* of HADA_PROGRESS */
    unsigned char *depths; /* linear, per computed depth: see batches.h; the board's lock guards these three */
    int open, helpers;     /* other lanes may take batches; how many are at it */
    atomic_int enhanced, tiles, tiles_left_out; /* planes and tiles of the net, by all lanes */
    hada_task_skip skip;
    hada_kept *kept, *source; /* see frames.h: this frame's copy, or the frame before that serves */
    double source_change;     /* what the latter changes at most: L2 */
};

enum { HADA_PROGRESS = 1000000, HADA_WORK_PURSUIT = 8 };

/* Checks the frame's size. After a failure there is nothing to end. */
hada_status hada_task_begin(hada_task *task, const hada_plan *plan, const hada_image *raw, hada_result *result,
                            hada_error *err);

/* The host's part, in the thread of the lane: the result is made to fit, with an empty report, broken pixels are
 * repaired, dark levels found. May be called again, when a lane failed and another begins anew. */
hada_status hada_task_prepare(hada_task *task, hada_error *err);

/* The frame to work on, after hada_task_prepare(). */
const hada_image *hada_task_frame(const hada_task *task);

/* Whether each frame has a dark level of its own, or the level of all. */
int hada_task_each_level(const hada_plan *plan);
double hada_task_fixed_level(const hada_plan *plan);

/* So much of task->work is done; the progress never falls. */
void hada_task_progress(hada_task *task, int done);

/* HADA_ERROR_CANCELLED when the task was asked to end. */
hada_status hada_task_check(hada_task *task, hada_error *err);

/* Frees what the task holds; a result that failed is emptied. */
void hada_task_end(hada_task *task, hada_status status);

#endif
