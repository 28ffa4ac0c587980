/* A frame on its way through a plan: what its lane must know of it. Internal. */
#ifndef HADA_SCHED_TASK_H
#define HADA_SCHED_TASK_H

#include "sched/plan.h"

typedef struct hada_task {
    const hada_plan *plan;
    const hada_image *raw; /* as it came */
    hada_result *result;
    size_t broken;       /* pixels that are not finite */
    hada_image repaired; /* empty where nothing was broken */
    double *levels;      /* per channel: the dark level */
    double energy;       /* refined: of the frame above its dark level */
    double start, watch; /* seconds */
} hada_task;

/* Checks the frame, and makes the result fit with an empty report. After a failure there is nothing to end. */
hada_status hada_task_begin(hada_task *task, const hada_plan *plan, const hada_image *raw, hada_result *result,
                            hada_error *err);

/* The host's part: broken pixels are repaired, dark levels found. */
hada_status hada_task_prepare(hada_task *task, hada_error *err);

/* The frame to work on, after hada_task_prepare(). */
const hada_image *hada_task_frame(const hada_task *task);

/* Frees what the task holds; a result that failed is emptied. */
void hada_task_end(hada_task *task, hada_status status);

#endif
