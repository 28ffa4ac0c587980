/* The queue of a slot. */
#include "runtime/slot.h"

/* A context's first queue is its own, for every slot that the device gives none: work waits for others' work there, and
 * is the same. It keeps times, since all may use it. In-order: out-of-order queues are only a hint, and run in order
 * or not at all on many drivers. */
hada_status hada_slot_open(hada_slot *slot, int timed, hada_error *err)
{
    hada_context *context = slot->context;
    cl_int code;
    pthread_mutex_lock(&context->lock);
    const int first = !context->queue, keeps = timed || first;
    pthread_mutex_unlock(&context->lock);
    cl_command_queue queue =
        clCreateCommandQueue(context->cl, context->device, keeps ? CL_QUEUE_PROFILING_ENABLE : 0, &code);
    pthread_mutex_lock(&context->lock);
    if (code != CL_SUCCESS)
        queue = context->queue;
    else if (!context->queue && keeps)
        context->queue = queue;
    pthread_mutex_unlock(&context->lock);
    if (!queue)
        return hada_fail_cl(err, code, "clCreateCommandQueue");
    slot->queue = queue;
    slot->timed = keeps || code != CL_SUCCESS;
    return HADA_OK;
}

void hada_slot_close(hada_slot *slot)
{
    if (!slot->queue)
        return;
    pthread_mutex_lock(&slot->context->lock);
    const int shared = slot->queue == slot->context->queue;
    pthread_mutex_unlock(&slot->context->lock);
    clFinish(slot->queue);
    if (!shared)
        clReleaseCommandQueue(slot->queue);
    slot->queue = NULL;
}

void hada_slot_waited(hada_slot *slot)
{
    slot->calls.waits++;
    if (slot->landmark)
        clReleaseEvent(slot->landmark);
    slot->landmark = NULL;
    slot->past_landmark = 0;
    slot->past_seconds = 0.0;
}

hada_status hada_slot_finish(hada_slot *slot, hada_error *err)
{
    if (slot->context->dry)
        return HADA_OK;
    const cl_int code = clFinish(slot->queue);
    hada_slot_waited(slot);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clFinish");
}

hada_status hada_slot_time(hada_slot *slot, hada_error *err)
{
    if (slot->timed)
        return HADA_OK;
    hada_slot_close(slot);
    return hada_slot_open(slot, 1, err);
}
