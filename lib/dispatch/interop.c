#include "dispatch/interop.h"

#include "core/options.h"
#include "engine/result.h"

void hada_cl_frame_defaults(hada_cl_frame *frame, size_t size)
{
    const hada_cl_frame own = {.size = sizeof own};
    HADA_OPTIONS_GIVE(frame, size, &own);
}

cl_command_queue hada_plan_cl_queue(const hada_plan *plan, int index)
{
    return index >= 0 && index < plan->dispatcher->worker_count
               ? hada_pipeline_queue(plan->dispatcher->workers[index].pipeline)
               : NULL;
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

static size_t frame_values(const hada_model_info *info)
{
    return (size_t)info->channels * (size_t)info->raw_rows * (size_t)info->raw_cols;
}

hada_status hada_interop_check_result(const hada_plan *plan, const hada_result *result, hada_error *err)
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

hada_status hada_interop_take_frame(hada_cl_frame *own, const hada_plan *plan, const hada_cl_frame *callers,
                                    hada_error *err)
{
    hada_cl_frame_init(own);
    HADA_TRY(HADA_OPTIONS_TAKE(own, callers, hada_cl_frame, err));
    HADA_TRY(check_plan(plan, err));
    if (!own->pixels)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a frame on the device needs a buffer: set its pixels");
    return check_buffer(plan, own->pixels, own->offset, frame_values(hada_model_get_info(plan->setup.model)), "frame",
                        err);
}

hada_status hada_interop_read_frame(const hada_cl_frame *frame, const hada_plan *plan, hada_image *image,
                                    hada_error *err)
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
