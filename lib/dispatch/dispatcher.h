/* Giving frames to workers. Internal. */
#ifndef HADA_DISPATCH_DISPATCHER_H
#define HADA_DISPATCH_DISPATCHER_H

#include "dispatch/state.h"

/* Room for so many workers, to be added one by one, those of a device together. */
hada_status hada_dispatcher_create(hada_dispatcher **out, int workers, hada_error *err);
/* `device` counts the plan's contexts, `number` the queues of a device. */
hada_status hada_dispatcher_add(hada_dispatcher *dispatcher, const hada_setup *setup, const hada_constants *constants,
                                int device, int number, int batch, hada_error *err);

/* The plan goes: cancels all jobs, waits for the threads, destroys the pipelines. */
void hada_dispatcher_stop(hada_dispatcher *dispatcher);
/* Gives back a reference, the plan's or a job's. */
void hada_dispatcher_release(hada_dispatcher *dispatcher);

/* The job waits behind all others; the first one makes the threads. */
hada_status hada_dispatcher_submit(hada_dispatcher *dispatcher, hada_job *job, hada_error *err);
/* Asks it to end; one that waits ends at once. */
void hada_dispatcher_cancel(hada_dispatcher *dispatcher, hada_job *job);

/* A plan of one worker whose thread was never needed works in the caller's: where it is free, it is taken until
 * hada_dispatcher_leave(), and the serial for a frame comes back; else 0. */
uint64_t hada_dispatcher_occupy(hada_dispatcher *dispatcher);
void hada_dispatcher_leave(hada_dispatcher *dispatcher, double busy_seconds);

/* Runs a job's frame on the worker, unless the frame before serves. */
hada_status hada_worker_run(hada_queue_worker *worker, hada_job *job, hada_error *err);

/* Frees what a job holds; a result that failed is emptied. */
void hada_job_release(hada_job *job, hada_status status);

#endif
