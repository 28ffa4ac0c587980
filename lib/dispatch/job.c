/* Jobs: frames handed in, asked for and waited for. */
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "core/clock.h"
#include "core/condition.h"
#include "dispatch/batches.h"
#include "dispatch/interop.h"
#include "dispatch/plan.h"
#include "image/pixels.h"

/* What a frame is given as: one of these. */
typedef struct frame_input {
    const hada_image *image;
    const hada_pixels *pixels;
    const hada_cl_frame *device;
} frame_input;

static hada_status check_arguments(const void *plan, const frame_input *input, const void *result, const char *name,
                                   hada_error *err)
{
    if (plan && (input->pixels || input->device || (input->image && input->image->data)) && result)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_ARGUMENT, "%s: a plan, a frame and a result are needed", name);
}

/* The host looks at the values as well. */
static hada_status begin_device(hada_job *job, hada_plan *plan, const hada_cl_frame *callers, hada_result *result,
                                hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(plan->setup.model);
    hada_cl_frame frame;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_interop_take_frame(&frame, plan, callers, err));
    HADA_TRY_OR_DONE(hada_image_create(&job->converted, info->channels, info->raw_rows, info->raw_cols, err));
    HADA_TRY_OR_DONE(hada_interop_read_frame(&frame, plan, &job->converted, err));
    HADA_TRY_OR_DONE(hada_frame_begin(&job->frame, &plan->setup, &job->converted, result, err));
    job->frame.device = frame.pixels;
    job->frame.device_offset = frame.offset;
done:
    if (status)
        hada_image_destroy(&job->converted);
    return status;
}

/* The frame's floats, where it stands in another form. Before there are any, its sizes are checked. */
static hada_status begin_frame(hada_job *job, hada_plan *plan, const frame_input *input, hada_result *result,
                               hada_error *err)
{
    hada_pixels pixels;
    int begun = 0;
    hada_status status = HADA_OK;
    if (input->device)
        return begin_device(job, plan, input->device, result, err);
    if (!input->pixels)
        return hada_frame_begin(&job->frame, &plan->setup, input->image, result, err);
    HADA_TRY_OR_DONE(hada_pixels_take(&pixels, input->pixels, err));
    job->view = (hada_image){pixels.channels, pixels.rows, pixels.cols, NULL};
    HADA_TRY_OR_DONE(hada_frame_begin(&job->frame, &plan->setup, &job->view, result, err));
    begun = 1;
    HADA_TRY_OR_DONE(hada_pixels_view(&pixels, &job->converted, &job->view, err));
done:
    if (status && begun)
        hada_frame_end(&job->frame, HADA_OK); /* the result is as it was */
    return status;
}

/* After a failure there is nothing to release, and the result is as it was. */
static hada_status begin(hada_job *job, hada_plan *plan, const frame_input *input, hada_result *result, hada_error *err)
{
    const size_t depths = (size_t)plan->setup.config.depths;
    hada_status status = HADA_OK;
    *job = (hada_job){.dispatcher = plan->dispatcher};
    HADA_TRY_OR_DONE(hada_allocated(job->depths = hada_alloc(depths, 1, "a frame", err)));
    HADA_TRY_OR_DONE(hada_interop_check_result(plan, result, err));
    HADA_TRY_OR_DONE(begin_frame(job, plan, input, result, err));
    job->frame.batches = &hada_job_batches;
    job->frame.owner = job;
done:
    if (status)
        free(job->depths);
    return status;
}

static hada_status submit(hada_job **out, hada_plan *plan, const frame_input *input, hada_result *result,
                          hada_error *err)
{
    hada_job *job = NULL;
    int begun = 0;
    hada_status status = HADA_OK;
    if (!out)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_job_submit: out is needed");
    *out = NULL;
    HADA_TRY_OR_DONE(check_arguments(plan, input, result, "hada_job_submit", err));
    HADA_TRY_OR_DONE(hada_allocated(job = hada_alloc(1, sizeof *job, "a job", err)));
    HADA_TRY_OR_DONE(begin(job, plan, input, result, err));
    begun = 1;
    HADA_TRY_OR_DONE(hada_frame_cache_enter(&plan->cache, job, err));
    HADA_TRY_OR_DONE(hada_dispatcher_submit(plan->dispatcher, job, err));
    *out = job;
done:
    if (status && begun)
        hada_job_release(job, status);
    if (status)
        free(job);
    return status;
}

hada_status hada_job_submit(hada_job **out, hada_plan *plan, const hada_image *raw, hada_result *result,
                            hada_error *err)
{
    return submit(out, plan, &(frame_input){.image = raw}, result, err);
}

hada_status hada_job_submit_pixels(hada_job **out, hada_plan *plan, const hada_pixels *raw, hada_result *result,
                                   hada_error *err)
{
    return submit(out, plan, &(frame_input){.pixels = raw}, result, err);
}

hada_status hada_job_submit_cl(hada_job **out, hada_plan *plan, const hada_cl_frame *raw, hada_result *result,
                               hada_error *err)
{
    return submit(out, plan, &(frame_input){.device = raw}, result, err);
}

hada_job_state hada_job_poll(const hada_job *job)
{
    pthread_mutex_lock(&job->dispatcher->lock);
    const hada_job_state state = job->state;
    pthread_mutex_unlock(&job->dispatcher->lock);
    return state;
}

double hada_job_progress(const hada_job *job)
{
    return (double)atomic_load(&job->frame.progress) / HADA_PROGRESS;
}

hada_status hada_job_wait(hada_job *job, hada_error *err)
{
    if (!job)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_job_wait: a job is needed");
    hada_dispatcher *dispatcher = job->dispatcher;
    pthread_mutex_lock(&dispatcher->lock);
    while (job->state < HADA_JOB_DONE)
        pthread_cond_wait(&dispatcher->changed, &dispatcher->lock);
    const hada_status status = job->state == HADA_JOB_DONE ? HADA_OK : job->error.status;
    if (status && err)
        *err = job->error;
    pthread_mutex_unlock(&dispatcher->lock);
    return status;
}

hada_job_state hada_job_wait_for(hada_job *job, double seconds)
{
    hada_dispatcher *dispatcher = job->dispatcher;
    const double deadline = hada_seconds() + fmax(seconds, 0.0);
    pthread_mutex_lock(&dispatcher->lock);
    while (job->state < HADA_JOB_DONE && hada_condition_wait_until(&dispatcher->changed, &dispatcher->lock, deadline))
        ;
    const hada_job_state state = job->state;
    pthread_mutex_unlock(&dispatcher->lock);
    return state;
}

void hada_job_cancel(hada_job *job)
{
    if (job)
        hada_dispatcher_cancel(job->dispatcher, job);
}

void hada_job_destroy(hada_job **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_job *job = *pointer;
    *pointer = NULL;
    hada_job_cancel(job);
    hada_job_wait(job, NULL);
    hada_dispatcher_release(job->dispatcher);
    free(job);
}

/* Ends the job. */
static hada_status run_begun(hada_job *job, hada_plan *plan, hada_error *err)
{
    hada_status status = HADA_OK;
    job->worker = &plan->dispatcher->workers[0];
    HADA_TRY_OR_DONE(hada_frame_cache_enter(&plan->cache, job, err));
    HADA_TRY_OR_DONE(hada_worker_run(job->worker, job, err));
done:
    hada_job_release(job, status);
    return status;
}

/* In the caller's thread, on the plan's one worker, which is occupied. */
static hada_status run_here(hada_plan *plan, uint64_t serial, const frame_input *input, hada_result *result,
                            hada_error *err)
{
    hada_job job;
    const double start = hada_seconds();
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(begin(&job, plan, input, result, err));
    job.frame.serial = serial;
    HADA_TRY_OR_DONE(run_begun(&job, plan, err));
done:
    hada_dispatcher_leave(plan->dispatcher, hada_seconds() - start);
    return status;
}

static hada_status run(hada_plan *plan, const frame_input *input, hada_result *result, hada_error *err)
{
    hada_job *job = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(check_arguments(plan, input, result, "hada_plan_run", err));
    const uint64_t serial = hada_dispatcher_occupy(plan->dispatcher);
    if (serial)
        return run_here(plan, serial, input, result, err);
    HADA_TRY_OR_DONE(submit(&job, plan, input, result, err));
    HADA_TRY_OR_DONE(hada_job_wait(job, err));
done:
    hada_job_destroy(&job);
    return status;
}

hada_status hada_plan_run(hada_plan *plan, const hada_image *raw, hada_result *result, hada_error *err)
{
    return run(plan, &(frame_input){.image = raw}, result, err);
}

hada_status hada_plan_run_pixels(hada_plan *plan, const hada_pixels *raw, hada_result *result, hada_error *err)
{
    return run(plan, &(frame_input){.pixels = raw}, result, err);
}

hada_status hada_plan_run_cl(hada_plan *plan, const hada_cl_frame *raw, hada_result *result, hada_error *err)
{
    return run(plan, &(frame_input){.device = raw}, result, err);
}
