/* A queue slot: one thread's place on a device. It owns an in-order queue, for kernels and transfers, and its own
 * kernel objects (clSetKernelArg on a shared kernel is the one OpenCL call that is not thread-safe). Internal.
 *
 * One slot is used by one thread at a time; different slots of a context are independent. */
#ifndef HADA_RUNTIME_SLOT_H
#define HADA_RUNTIME_SLOT_H

#include <hadalens/monitor.h>
#include <stdatomic.h>

#include "runtime/context.h"

typedef struct hada_profile hada_profile;             /* runtime/profile.h */
typedef struct hada_scratch hada_scratch;             /* runtime/memory.h */
typedef struct hada_kernel_object hada_kernel_object; /* runtime/launch.h */

/* What was asked of the device so far. */
typedef struct hada_calls {
    uint64_t launches, transfers, waits, arguments;
    double bytes_up, bytes_down;
} hada_calls;

typedef struct hada_slot {
    hada_context *context;
    cl_command_queue queue; /* NULL on a dry context */
    hada_scratch *scratch;  /* where buffers that may share memory come from; NULL: each has its own */
    int timed; /* 1: the queue keeps the times of its events; some drivers then take longer over each command */
    hada_kernel_object *kernels; /* its own, of all programs, made when first launched */
    hada_profile *profile;       /* NULL: off */
    const char *stage;           /* the current stage, for profiles; a constant text or NULL */
    double cost_bytes, cost_flops;
    hada_calls calls;
    cl_event event;
    const atomic_int *cancelled; /* where set and not 0, launches are refused: HADA_ERROR_CANCELLED */
    const hada_monitor *monitor; /* may be NULL */
    int unasked;                 /* launches since it was asked, and the time that they may take */
    double unasked_seconds, most_unasked;
    cl_event landmark; /* in the queue, where work can be cancelled; NULL: none yet */
    int past_landmark; /* launches since, and the time that they may take */
    double past_seconds;
} hada_slot;

/* Whether its kernels are those for work-groups (hada_kernel_shape). */
static inline int hada_slot_in_groups(const hada_slot *slot)
{
    return slot->context->shape == HADA_SHAPE_GROUPS;
}

hada_status hada_slot_create(hada_slot **out, hada_context *context, hada_error *err);
void hada_slot_destroy(hada_slot **slot); /* waits for commands in flight */

/* From now on launches are refused while *flag is not 0, which another thread may set. NULL: never. */
static inline void hada_slot_cancel_by(hada_slot *slot, const atomic_int *flag)
{
    slot->cancelled = flag;
}

/* The time that launches may take, about, before a monitor is asked (by two cores of a CPU: runtime/launch.c). */
#define HADA_SECONDS_UNASKED 0.5

/* From now on the monitor is asked between launches, every few of which are waited for first, so that little is in
 * flight when it says stop: launches are refused then. For work of one thread that takes long. NULL: nobody is asked.
 */
static inline void hada_slot_watch(hada_slot *slot, const hada_monitor *monitor)
{
    slot->monitor = monitor;
    slot->unasked = 0;
    slot->unasked_seconds = 0.0;
    slot->most_unasked = HADA_SECONDS_UNASKED;
}

/* From now on the queue keeps the times of its events: another one, the first time. Waits for commands in flight. */
hada_status hada_slot_time(hada_slot *slot, hada_error *err);

/* Waits until everything in the queue is done. */
hada_status hada_slot_finish(hada_slot *slot, hada_error *err);

/* For transfers that were waited for: counts it, and nothing is in flight. */
void hada_slot_waited(hada_slot *slot);

/* For profiles (runtime/profile.h turns them on). The stage that the following commands belong to: a constant text. */
static inline void hada_slot_stage(hada_slot *slot, const char *stage)
{
    slot->stage = stage;
}

/* What the next launch needs at least: traffic with the device's memory, and operations. */
static inline void hada_slot_cost(hada_slot *slot, double bytes, double flops)
{
    slot->cost_bytes = bytes;
    slot->cost_flops = flops;
}

/* For transfers, which enqueue themselves: where their event goes (NULL: profiling is off), and that it was enqueued.
 */
static inline cl_event *hada_slot_event(hada_slot *slot)
{
    return slot->profile ? &slot->event : NULL;
}
void hada_slot_moved(hada_slot *slot, const char *name, double bytes);

/* For commands that another library enqueues between the two calls: one row of the profile. */
hada_status hada_slot_span_begin(hada_slot *slot, cl_event *begin, hada_error *err);
hada_status hada_slot_span_end(hada_slot *slot, const char *name, cl_event begin, hada_error *err);

#endif
