/* Jobs: frames handed in, asked for and waited for. */

#include "core/callers.h"
#include "core/clock.h"
#include "dispatch/plan.h"
#include "engine/frame.h"
#include "image/pixels.h"

cl_command_queue hada_plan_cl_queue(const hada_plan *plan, int index)
{
    if (!plan || index < 0 || index >= plan->dispatcher->worker_count)
        return NULL;
    const hada_slot *slot = hada_pipeline_slot(plan->dispatcher->workers[index].pipeline);
    return slot ? slot->queue : NULL;
}

static hada_status check_plan(const hada_plan *plan, hada_error *err)
{
    return plan->contexts == 1 ? HADA_OK
                               : hada_fail(err, HADA_ERROR_UNSUPPORTED,
                                           "buffers on the device belong to one context, but the plan has %d: make a "
                                           "plan for each",
                                           plan->contexts);
}

static hada_status check_buffer(const hada_plan *plan, cl_mem mem, size_t offset, size_t values, const char *what,
                                hada_error *err)
{
    const size_t needed = values * sizeof(float);
    cl_context context = NULL;
    size_t bytes = 0;
    cl_int code = clGetMemObjectInfo(mem, CL_MEM_CONTEXT, sizeof context, &context, NULL);
    if (code == CL_SUCCESS)
        code = clGetMemObjectInfo(mem, CL_MEM_SIZE, sizeof bytes, &bytes, NULL);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clGetMemObjectInfo");
    if (context != plan->constants[0]->context->cl)
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "the buffer of the %s belongs to another OpenCL context than the plan; make the plan's context "
            "with hada_context_adopt()",
            what);
    if (offset % sizeof(float) || offset > bytes || bytes - offset < needed)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "the buffer of the %s has %zu bytes; from an offset of %zu (a multiple of 4) it must hold %zu",
                         what, bytes, offset, needed);
    return HADA_OK;
}

static hada_status check_result(const hada_plan *plan, const hada_result *result, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(plan->setup.model);
    const size_t map = (size_t)info->window_rows * (size_t)info->window_cols, plane = (size_t)info->channels * map;
    if (!hada_result_on_device(result))
        return HADA_OK;
    const hada_cl_arrays *to = &result->memory->device;
    HADA_TRY(check_plan(plan, err));
    if (plan->setup.options.gamma != 1.0)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                         "results on the device are linear: a gamma of %g is applied on the host alone",
                         plan->setup.options.gamma);
    if (to->stack)
        HADA_TRY(
            check_buffer(plan, to->stack, to->stack_offset, (size_t)plan->setup.config.depths * plane, "stack", err));
    if (to->all_in_focus)
        HADA_TRY(check_buffer(plan, to->all_in_focus, to->all_in_focus_offset, plane, "all-in-focus image", err));
    if (to->distance_map)
        HADA_TRY(check_buffer(plan, to->distance_map, to->distance_map_offset, map, "distance map", err));
    return HADA_OK;
}

/* The values of a frame on the device, once its queue has finished what it had to do. */
static hada_status read_frame(const hada_cl_frame *frame, const hada_plan *plan, hada_image *image, hada_error *err)
{
    const hada_context *context = plan->constants[0]->context;
    cl_int code = CL_SUCCESS;
    cl_command_queue queue = frame->queue, own = NULL;
    if (queue)
        code = clFinish(queue);
    else
        queue = own = clCreateCommandQueue(context->cl, context->device, 0, &code);
    if (code == CL_SUCCESS)
        code = clEnqueueReadBuffer(queue, frame->pixels, CL_TRUE, frame->offset,
                                   hada_image_count(image) * sizeof *image->data, image->data, 0, NULL, NULL);
    if (own)
        clReleaseCommandQueue(own);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "reading a frame from the device");
}

/* The form in which a frame is given: one of these. */
typedef struct frame_input {
    const hada_image *image;
    const hada_pixels *pixels;
    const hada_cl_frame *device;
} frame_input;

/* A frame on the device is examined on the host as well. */
static hada_status begin_device(hada_job *job, hada_plan *plan, const hada_cl_frame *callers, hada_result *result,
                                hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(plan->setup.model);
    const size_t values = (size_t)info->channels * (size_t)info->raw_rows * (size_t)info->raw_cols;
    hada_cl_frame frame;
    hada_pixels pixels;
    HADA_TRY(HADA_OPTIONS_TAKE(&frame, callers, hada_cl_frame, err));
    HADA_TRY(check_plan(plan, err));
    if (!frame.pixels)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a frame on the device needs a buffer: set its pixels");
    HADA_TRY(check_buffer(plan, frame.pixels, frame.offset, values, "frame", err));
    HADA_TRY(hada_image_create(&job->copy, info->channels, info->raw_rows, info->raw_cols, err));
    HADA_TRY(read_frame(&frame, plan, &job->copy, err));
    hada_pixels_of_image(&pixels, &job->copy);
    HADA_TRY(hada_frame_begin(&job->frame, &plan->setup, &pixels, result, err));
    job->frame.device = frame.pixels;
    job->frame.device_offset = frame.offset;
    return HADA_OK;
}

static hada_status begin_frame(hada_job *job, hada_plan *plan, const frame_input *input, hada_result *result,
                               hada_error *err)
{
    hada_pixels pixels;
    if (input->device)
        return begin_device(job, plan, input->device, result, err);
    if (input->pixels)
        HADA_TRY(hada_pixels_take(&pixels, input->pixels, err));
    else {
        HADA_TRY(hada_image_check(input->image, NULL, "a frame", "raw", err));
        hada_pixels_of_image(&pixels, input->image);
    }
    const hada_stored memory = hada_pixels_stored(&pixels);
    if (hada_result_overlaps(result, memory.data, memory.bytes))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "the frame and the result share memory: give the result arrays of its own, or copy the frame");
    return hada_frame_begin(&job->frame, &plan->setup, &pixels, result, err);
}

/* After a failure there is nothing to release, and the result is as it was. */
static hada_status begin(hada_job *job, hada_plan *plan, const frame_input *input, hada_result *result, hada_error *err)
{
    const size_t depths = (size_t)plan->setup.config.depths;
    hada_status status = HADA_OK;
    *job = (hada_job){.dispatcher = plan->dispatcher};
    HADA_TRY_OR_DONE(HADA_NEW(job->depths, depths, "a frame", err));
    HADA_TRY_OR_DONE(check_result(plan, result, err));
    HADA_TRY_OR_DONE(begin_frame(job, plan, input, result, err));
    job->frame.batches = &hada_job_batches;
    job->frame.owner = job;
done:
    if (status) {
        hada_image_destroy(&job->copy);
        free(job->depths);
    }
    return status;
}

static hada_status submit(hada_job **out, hada_plan *plan, const frame_input *input, hada_result *result,
                          hada_error *err)
{
    hada_job *job = NULL;
    int begun = 0;
    hada_status status = HADA_OK;
    *out = NULL;
    if (hada_dispatcher_fills(plan->dispatcher, result))
        return hada_fail(err, HADA_ERROR_STATE, "another job of the plan fills this result: give each job its own");
    HADA_TRY_OR_DONE(HADA_NEW(job, 1, "a job", err));
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
    HADA_NEED(out && plan && raw && result, err);
    return submit(out, plan, &(frame_input){.image = raw}, result, err);
}

hada_status hada_job_submit_pixels(hada_job **out, hada_plan *plan, const hada_pixels *raw, hada_result *result,
                                   hada_error *err)
{
    HADA_NEED(out && plan && raw && result, err);
    return submit(out, plan, &(frame_input){.pixels = raw}, result, err);
}

hada_status hada_job_submit_cl(hada_job **out, hada_plan *plan, const hada_cl_frame *raw, hada_result *result,
                               hada_error *err)
{
    HADA_NEED(out && plan && raw && result, err);
    return submit(out, plan, &(frame_input){.device = raw}, result, err);
}

hada_job_state hada_job_poll(const hada_job *job)
{
    if (!job)
        return HADA_JOB_FAILED;
    pthread_mutex_lock(&job->dispatcher->lock);
    const hada_job_state state = job->state;
    pthread_mutex_unlock(&job->dispatcher->lock);
    return state;
}

double hada_job_progress(const hada_job *job)
{
    return job ? (double)atomic_load(&job->frame.progress) / HADA_PROGRESS : 0.0;
}

hada_status hada_job_wait(hada_job *job, hada_error *err)
{
    HADA_NEED(job, err);
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
    if (!job)
        return HADA_JOB_FAILED;
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
    hada_job *job = hada_taken(pointer);
    if (!job)
        return;
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
    hada_frame_cache_take(job);
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
    HADA_NEED(plan && raw && result, err);
    return run(plan, &(frame_input){.image = raw}, result, err);
}

hada_status hada_plan_run_pixels(hada_plan *plan, const hada_pixels *raw, hada_result *result, hada_error *err)
{
    HADA_NEED(plan && raw && result, err);
    return run(plan, &(frame_input){.pixels = raw}, result, err);
}

hada_status hada_plan_run_cl(hada_plan *plan, const hada_cl_frame *raw, hada_result *result, hada_error *err)
{
    HADA_NEED(plan && raw && result, err);
    return run(plan, &(frame_input){.device = raw}, result, err);
}
