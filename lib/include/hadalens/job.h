/* Hadalens: frames in flight, on several queues and devices.
 *
 * A plan made with several contexts, or with several queues a device, works on many frames at once: each queue pulls
 * the next frame as soon as it is free, or, where no frame waits, a batch of depths of a frame that another device has
 * in hand (linear filters; a refined frame goes to one queue whole). So a faster device takes more, and transfers of
 * one frame overlap with computing another. Results are the same bits whoever did what, as long as the devices round
 * alike (parts of one device do).
 *
 * A device that fails hands what it had to the others; where memory is short it tries smaller batches first. Both are
 * told as warnings in the log of its context. A job fails only when no device is left, with the first error that it
 * met; then all of them may try the next job.
 *
 * Threads: jobs of a plan may be submitted, asked and waited for from any threads. The first job makes a thread for
 * each queue; hada_plan_run() on a plan of one queue without jobs works in the caller's.
 * docs/explanation/architecture.md */
#ifndef HADALENS_JOB_H
#define HADALENS_JOB_H

#include <hadalens/reconstruct.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hada_job hada_job;

typedef enum hada_job_state {
    HADA_JOB_WAITING = 0,
    HADA_JOB_RUNNING = 1,
    HADA_JOB_DONE = 2,
    HADA_JOB_FAILED = 3,
    HADA_JOB_CANCELLED = 4
} hada_job_state;

/* Hands a frame in and returns at once. `raw` and `result` stay the caller's and must not be touched until the job has
 * ended; a result used again keeps its memory, that of a job that did not end well is empty. Frames of one plan start
 * in the order of submission; with HADA_SKIP_FRAMES each is compared with the one submitted before it, and which ones
 * take a weight that is kept (refine_tv of hada_plan_options) goes by that order, too. A frame of the wrong size is
 * refused here (HADA_ERROR_MODEL), as is a result that another job of the plan fills (HADA_ERROR_STATE); other faults
 * of a frame are the job's. */
HADA_API hada_status hada_job_submit(hada_job **out, hada_plan *plan, const hada_image *raw, hada_result *result,
                                     hada_error *err);

/* As hada_job_submit(), of pixels in any form. 8 and 16 bits, and floats with any strides, become dense floats on the
 * device; the pixels stay the caller's and must not be touched until the job has ended. */
HADA_API hada_status hada_job_submit_pixels(hada_job **out, hada_plan *plan, const hada_pixels *raw,
                                            hada_result *result, hada_error *err);

HADA_API hada_job_state hada_job_poll(const hada_job *job);

/* Part done, 0 to 1, by counted work; never falls. */
HADA_API double hada_job_progress(const hada_job *job);

/* Waits for the end. HADA_OK, or what the job failed with; HADA_ERROR_CANCELLED after hada_job_cancel() and where the
 * plan was destroyed before the job was done. May be called again, with the same answer. */
HADA_API hada_status hada_job_wait(hada_job *job, hada_error *err);

/* Waits for the end for so many seconds at most, and returns the state: for callers that look elsewhere meanwhile. */
HADA_API hada_job_state hada_job_wait_for(hada_job *job, double seconds);

/* Asks the job to end; returns at once. A job that waits ends at once; one that runs ends between two kernels, after
 * those that are on the device already. A job that was done stays done. */
HADA_API void hada_job_cancel(hada_job *job);

/* Cancels, waits, and frees. */
HADA_API void hada_job_destroy(hada_job **job);

/* What each queue of a plan did so far. */
typedef struct hada_queue_info {
    int device;               /* index of the device */
    uint64_t frames, batches; /* frames begun, batches of depths done (also for frames of others) */
    double busy_seconds;
    int lost; /* 1: it failed and is out of use until no queue is left */
} hada_queue_info;
/* Fills up to `capacity` entries; returns the number of queues. */
HADA_API int hada_plan_queues(const hada_plan *plan, hada_queue_info *info, int capacity);

#ifdef __cplusplus
}
#endif
#endif
