/* A lane: one queue of a device, with all that a frame needs on its way. Internal.
 *
 * A lane is used by one thread at a time; the lanes of a plan are independent and only read what they share. */
#ifndef HADA_ENGINE_PIPELINE_H
#define HADA_ENGINE_PIPELINE_H

#include <hadalens/job.h>
#include <pthread.h>

#include "classic/classic.h"
#include "engine/constants.h"
#include "engine/frame.h"
#include "filter/hadamard.h"
#include "focus/focus.h"
#include "net/enhance.h"
#include "refine/admm.h"
#include "refine/pursuit.h"

struct hada_lane {
    const hada_plan *plan;
    const hada_share *share;
    int number; /* among the lanes of its device */
    int batch;  /* depths at once; becomes smaller where memory is short */
    hada_slot *slot;
    hada_room room; /* scratch of the parts below */
    hada_hadamard *stage;
    hada_meter *meter; /* NULL where spectra are not measured */
    hada_pursuit *pursuit;
    hada_refiner *refiner; /* this or the next, or neither */
    hada_classic *classic;
    hada_focus *focus;
    hada_enhance *enhance; /* NULL where no net is used */
    hada_buffer planes;    /* linear: a batch, [depth][channel][window] */
    hada_buffer pictures;  /* all-in-focus image, then distance map */
    int *occupied;         /* room for a list of computed depths */
    uint64_t holds;        /* serial of the task whose spectrum stands in the stage; 0: none */

    /* the board's lock guards these */
    hada_queue_info info;
    pthread_t thread;
    int has_thread, idle;
};

/* Lane `number` of a device; `device` counts the plan's contexts. */
hada_status hada_lane_create(hada_lane **out, const hada_plan *plan, const hada_share *share, int device, int number,
                             hada_error *err);
void hada_lane_destroy(hada_lane **lane); /* waits for its queue */

/* Places for all scratch of a lane, by the steps that need it; nothing is allocated. */
hada_status hada_lane_plan_memory(hada_room *room, const hada_context *context, const hada_model *model,
                                  const hada_plan_shape *shape, int batch, hada_error *err);
size_t hada_lane_planes_bytes(const hada_model_info *info, const hada_plan_shape *shape, int batch);
size_t hada_lane_pictures_bytes(const hada_model_info *info);

/* Bytes of device memory that a lane holds, and would hold if no buffers shared room. */
hada_status hada_lane_bytes(const hada_context *context, const hada_model *model, const hada_plan_shape *shape,
                            int batch, uint64_t *bytes, uint64_t *apart, hada_error *err);

/* Depths at once that fit a device: its memory and its largest allocation. */
int hada_lane_batch(const hada_context *context, const hada_model *model, const hada_plan_shape *shape, int queues);

/* Takes a begun task through all stages; its result is complete then. Where the device's memory is short it is tried
 * again in smaller batches. After a failure the lane is ready for the next one. */
hada_status hada_lane_run(hada_lane *lane, hada_task *task, hada_error *err);

/* One batch of depths of a frame that another lane has. */
hada_status hada_lane_help(hada_lane *lane, hada_task *task, hada_error *err);

/* Whether a lane may help with the frames of another: not on the same device, which is busy with them already. */
int hada_lane_helps(const hada_lane *lane, const hada_lane *owner);

/* The lane's parts are there: made again after hada_lane_clear(). */
hada_status hada_lane_ready(hada_lane *lane, hada_error *err);
void hada_lane_clear(hada_lane *lane);
/* After a failure: nothing is in the queue, and what it left behind is not trusted. */
void hada_lane_stumble(hada_lane *lane);

/* The stages; each leaves its seconds in the report. */

/* Frame and spectrum stand in the Hadamard stage; the task is prepared. */
hada_status hada_lane_upload(hada_lane *lane, hada_task *task, hada_error *err);
/* The same for a prepared task; nothing is done where the lane has it already. */
hada_status hada_lane_expose(hada_lane *lane, hada_task *task, hada_error *err);

/* Planes by the linear filters in batches, each into the result and into the focus. */
hada_status hada_lane_linear(hada_lane *lane, hada_task *task, hada_error *err);

/* Planes of the occupied depths, refined jointly, into the result and into the focus. */
hada_status hada_lane_refined(hada_lane *lane, hada_task *task, hada_error *err);

/* Planes of the `count` depths in lane->occupied by a classic method, in hada_classic_planes(lane->classic). */
hada_status hada_lane_classic(hada_lane *lane, hada_task *task, int count, hada_error *err);

/* The transfer functions, the spectrum and the frame that stands in the stage. */
hada_refine_data hada_lane_refine_data(const hada_lane *lane);

/* Which computed depths the frame in the stage occupies: lane->occupied[0 .. *count - 1], ascending. */
hada_status hada_lane_pursue(hada_lane *lane, hada_task *task, int *count, hada_error *err);
hada_status hada_lane_make_pursuit(hada_lane *lane, hada_error *err);

/* The model's net: a lane's own, the bytes of that, and `count` planes of a frame through it, in place. Nothing where
 * the plan uses none. */
hada_status hada_lane_enhance_make(hada_lane *lane, hada_error *err);
uint64_t hada_lane_enhance_bytes(const hada_context *context, const hada_model *model, const hada_plan_shape *shape);
hada_status hada_lane_enhance(hada_lane *lane, hada_task *task, cl_mem planes, int count, hada_error *err);

/* All-in-focus image and distance map from what was pushed to the focus, into the result. */
hada_status hada_lane_pictures(hada_lane *lane, hada_task *task, hada_error *err);

/* Waits for the queue and adds the time since the last call to *seconds. */
hada_status hada_lane_watch(hada_lane *lane, hada_task *task, double *seconds, hada_error *err);

#endif
