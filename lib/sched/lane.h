/* A lane: one queue of a device, with all that a frame needs on its way. Internal.
 *
 * A lane is used by one thread at a time; the lanes of a plan are independent and only read what they share. */
#ifndef HADA_SCHED_LANE_H
#define HADA_SCHED_LANE_H

#include "filter/hadamard.h"
#include "focus/focus.h"
#include "refine/admm.h"
#include "refine/pursuit.h"
#include "sched/share.h"
#include "sched/task.h"

struct hada_lane {
    const hada_plan *plan;
    const hada_share *share;
    hada_slot *slot;
    hada_hadamard *stage;
    hada_pursuit *pursuit;
    hada_refiner *refiner;
    hada_focus *focus;
    hada_buffer planes;   /* linear: a batch, [depth][channel][window] */
    hada_buffer pictures; /* all-in-focus image, then distance map */
    int *occupied;        /* room for a list of computed depths */
};

hada_status hada_lane_create(hada_lane **out, const hada_plan *plan, const hada_share *share, hada_error *err);
void hada_lane_destroy(hada_lane **lane); /* waits for its queue */

/* Bytes of device memory that a lane holds. */
uint64_t hada_lane_bytes(const hada_context *context, const hada_model *model, const hada_plan_shape *shape);

/* Takes a begun task through all stages; its result is complete then. After a failure the lane is ready for the next
 * one. */
hada_status hada_lane_run(hada_lane *lane, hada_task *task, hada_error *err);

/* The stages; each leaves its seconds in the report. */

/* Frame and spectrum stand in the Hadamard stage. */
hada_status hada_lane_upload(hada_lane *lane, hada_task *task, hada_error *err);

/* Planes by the linear filters in batches, each into the result and into the focus. */
hada_status hada_lane_linear(hada_lane *lane, hada_task *task, hada_error *err);

/* Planes of the occupied depths, refined jointly, into the result and into the focus. */
hada_status hada_lane_refined(hada_lane *lane, hada_task *task, hada_error *err);

/* Which computed depths the frame in the stage occupies: lane->occupied[0 .. *count - 1], ascending. */
hada_status hada_lane_pursue(hada_lane *lane, hada_task *task, int *count, hada_error *err);
hada_status hada_lane_make_pursuit(hada_lane *lane, hada_error *err);

/* All-in-focus image and distance map from what was pushed to the focus, into the result. */
hada_status hada_lane_pictures(hada_lane *lane, hada_task *task, hada_error *err);

/* Waits for the queue and adds the time since the last call to *seconds. */
hada_status hada_lane_watch(hada_lane *lane, hada_task *task, double *seconds, hada_error *err);

#endif
