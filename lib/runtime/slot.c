/* Queue slots: the queue and kernel objects of one thread. */
#include "runtime/slot.h"

#include <stdlib.h>

#include "core/alloc.h"
#include "runtime/profile.h"
#include "runtime/program.h"

/* A context's first queue is its own, for every slot that the device gives none: work waits for others' work there, and
 * is the same. */
static hada_status make_queue(hada_context *context, cl_command_queue *queue, hada_error *err)
{
    cl_int code;
    /* in-order: out-of-order queues are only a hint, and run in order or not at all on many drivers. Profiling costs
     * nothing measurable and lets a bench ask any slot. */
    *queue = clCreateCommandQueue(context->cl, context->device, CL_QUEUE_PROFILING_ENABLE, &code);
    pthread_mutex_lock(&context->lock);
    if (code != CL_SUCCESS)
        *queue = context->queue;
    else if (!context->queue)
        context->queue = *queue;
    pthread_mutex_unlock(&context->lock);
    return *queue ? HADA_OK : hada_fail_cl(err, code, "clCreateCommandQueue");
}

static void give_back_queue(const hada_slot *slot)
{
    pthread_mutex_lock(&slot->context->lock);
    const int shared = slot->queue == slot->context->queue;
    pthread_mutex_unlock(&slot->context->lock);
    clFinish(slot->queue);
    if (!shared)
        clReleaseCommandQueue(slot->queue);
}

hada_status hada_slot_create(hada_slot **out, hada_context *context, hada_error *err)
{
    hada_slot *slot = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(hada_alloc((void **)&slot, 1, sizeof *slot, "a queue slot", err));
    slot->context = context;
    HADA_TRY(hada_alloc((void **)&slot->kernels, (size_t)hada_kernel_object_count, sizeof *slot->kernels,
                        "a queue slot", err));
    HADA_TRY(make_queue(context, &slot->queue, err));
done:
    if (status)
        hada_slot_destroy(&slot);
    *out = slot;
    return status;
}

void hada_slot_destroy(hada_slot **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_slot *slot = *pointer;
    *pointer = NULL;
    hada_slot_profile(slot, 0, NULL);
    if (slot->queue)
        give_back_queue(slot);
    for (int i = 0; slot->kernels && i < hada_kernel_object_count; i++)
        if (slot->kernels[i])
            clReleaseKernel(slot->kernels[i]);
    free(slot->kernels);
    free(slot);
}

hada_status hada_slot_finish(hada_slot *slot, hada_error *err)
{
    cl_int code = clFinish(slot->queue);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clFinish");
}
