/* Queue slots: the queue and kernel objects of one thread. */
#include "runtime/slot.h"

#include <stdlib.h>

#include "core/alloc.h"
#include "runtime/profile.h"
#include "runtime/program.h"

static hada_status make_queue(hada_context *context, cl_command_queue *queue, hada_error *err)
{
    cl_int code;
    /* in-order: out-of-order queues are only a hint, and run in order or not at all on many drivers. Profiling costs
     * nothing measurable and lets a bench ask any slot. */
    *queue = clCreateCommandQueue(context->cl, context->device, CL_QUEUE_PROFILING_ENABLE, &code);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clCreateCommandQueue");
}

hada_status hada_slot_create(hada_slot **out, hada_context *context, hada_error *err)
{
    hada_slot *slot;
    *out = NULL;
    hada_status status = hada_alloc((void **)&slot, 1, sizeof *slot, "a queue slot", err);
    if (status)
        return status;
    slot->context = context;
    status = hada_alloc((void **)&slot->objects, (size_t)hada_kernel_object_count, sizeof *slot->objects,
                        "a queue slot", err);
    if (!status)
        status = make_queue(context, &slot->queue, err);
    if (status) {
        hada_slot_destroy(&slot);
        return status;
    }
    *out = slot;
    return HADA_OK;
}

void hada_slot_destroy(hada_slot **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_slot *slot = *pointer;
    *pointer = NULL;
    hada_slot_profile(slot, 0, NULL);
    if (slot->queue) {
        clFinish(slot->queue);
        clReleaseCommandQueue(slot->queue);
    }
    while (slot->kernels) {
        hada_slot_kernel_entry *entry = slot->kernels;
        slot->kernels = entry->next;
        if (entry->kernel)
            clReleaseKernel(entry->kernel);
        free(entry->file);
        free(entry->name);
        free(entry->options);
        free(entry);
    }
    for (int i = 0; slot->objects && i < hada_kernel_object_count; i++)
        if (slot->objects[i])
            clReleaseKernel(slot->objects[i]);
    free(slot->objects);
    free(slot);
}

hada_status hada_slot_launch(hada_slot *slot, cl_kernel kernel, const char *name, unsigned dimensions,
                             const size_t *global, const size_t *local, const hada_arg *args, size_t arg_count,
                             hada_error *err)
{
    cl_int code;
    hada_status status;
    if (slot->stop && atomic_load(slot->stop))
        return hada_fail(err, HADA_ERROR_CANCELLED, "the work was cancelled");
    for (size_t i = 0; i < arg_count; i++) {
        code = clSetKernelArg(kernel, (cl_uint)i, args[i].size, args[i].value);
        if (code != CL_SUCCESS) {
            status = hada_fail_cl(err, code, "clSetKernelArg");
            hada_error_prefix(err, "kernel %s, argument %zu: ", name, i);
            return status;
        }
    }
    for (unsigned d = 0; d < dimensions; d++)
        if (!global[d]) { /* nothing to do */
            hada_slot_cost(slot, 0, 0);
            return HADA_OK;
        }
    code = clEnqueueNDRangeKernel(slot->queue, kernel, dimensions, NULL, global, local, 0, NULL, hada_slot_event(slot));
    if (code != CL_SUCCESS) {
        status = hada_fail_cl(err, code, "clEnqueueNDRangeKernel");
        hada_error_prefix(err, "kernel %s: ", name);
        return status;
    }
    if (slot->profile)
        hada_profile_add(slot, name, 0, NULL, slot->event);
    return HADA_OK;
}

hada_status hada_slot_finish(hada_slot *slot, hada_error *err)
{
    cl_int code = clFinish(slot->queue);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clFinish");
}
