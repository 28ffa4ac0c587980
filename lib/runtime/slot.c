/* Queue slots: made and unmade, their queues, and what their commands took. */
#include "runtime/slot.h"

#include "runtime/launch.h"
#include "runtime/profile.h"

/* Gives a slot without a queue one; timed: it keeps the times of its events. A context's first queue is its own, for
 * every slot that the device gives none: work waits for others' work there, and is the same. It keeps times, since all
 * may use it. In-order: out-of-order queues are only a hint, and run in order or not at all on many drivers. */
static hada_status open_queue(hada_slot *slot, int timed, hada_error *err)
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

static void close_queue(hada_slot *slot)
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
    close_queue(slot);
    return open_queue(slot, 1, err);
}

/* Events held at a time: many events that live at once slow some drivers down. */
enum { PENDING = 512 };

typedef struct pending {
    cl_event begin, end;
    size_t row;
} pending;

struct hada_profile {
    hada_kernel_time *rows;
    size_t count;
    pending list[PENDING];
    size_t waiting;
    hada_status status; /* the first failure */
    hada_error error;
};

static hada_status event_time(cl_event event, cl_profiling_info which, cl_ulong *out, hada_error *err)
{
    const cl_int code = clGetEventProfilingInfo(event, which, sizeof *out, out, NULL);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clGetEventProfilingInfo");
}

static hada_status add_time(hada_profile *profile, const pending *entry, hada_error *err)
{
    cl_ulong from = 0, to = 0;
    const cl_int code = clWaitForEvents(1, &entry->end);
    if (code != CL_SUCCESS)
        HADA_TRY(hada_fail_cl(err, code, "clWaitForEvents"));
    if (entry->begin)
        HADA_TRY(event_time(entry->begin, CL_PROFILING_COMMAND_END, &from, err));
    else
        HADA_TRY(event_time(entry->end, CL_PROFILING_COMMAND_START, &from, err));
    HADA_TRY(event_time(entry->end, CL_PROFILING_COMMAND_END, &to, err));
    if (to > from)
        profile->rows[entry->row].seconds += 1e-9 * (double)(to - from);
    return HADA_OK;
}

/* Takes the times of all commands in hand; waits for those that are not done. */
static void drain(hada_profile *profile)
{
    for (size_t i = 0; i < profile->waiting; i++) {
        const pending *entry = &profile->list[i];
        if (!profile->status)
            profile->status = add_time(profile, entry, &profile->error);
        if (entry->begin)
            clReleaseEvent(entry->begin);
        clReleaseEvent(entry->end);
    }
    profile->waiting = 0;
}

static void forget_times(hada_slot *slot)
{
    if (!slot->profile)
        return;
    drain(slot->profile);
    HADA_FREE(slot->profile->rows, slot->profile);
    slot->profile = NULL;
}

hada_status hada_slot_profile(hada_slot *slot, int on, hada_error *err)
{
    forget_times(slot);
    slot->cost_bytes = slot->cost_flops = 0;
    if (!on)
        return HADA_OK;
    HADA_TRY(hada_slot_time(slot, err));
    return HADA_NEW(slot->profile, 1, "a profile", err);
}

/* The row of a stage and name; created if missing. */
static hada_status row_of(hada_kernel_time **rows, size_t *count, const hada_kernel_time *wanted, size_t *out,
                          hada_error *err)
{
    for (size_t i = 0; i < *count; i++)
        if (!strcmp((*rows)[i].name, wanted->name) && !strcmp((*rows)[i].stage, wanted->stage)) {
            *out = i;
            return HADA_OK;
        }
    HADA_TRY(HADA_GROW(*rows, *count, 1, "a profile", err));
    *out = (*count)++;
    (*rows)[*out] = *wanted;
    (*rows)[*out].launches = 0;
    (*rows)[*out].seconds = (*rows)[*out].bytes = (*rows)[*out].flops = 0;
    return HADA_OK;
}

void hada_profile_add(hada_slot *slot, const char *name, int transfer, cl_event begin, cl_event end)
{
    hada_profile *profile = slot->profile;
    hada_kernel_time row = {.transfer = transfer};
    size_t at = 0;
    snprintf(row.name, sizeof row.name, "%s", name);
    snprintf(row.stage, sizeof row.stage, "%s", slot->stage ? slot->stage : "other");
    if (profile->waiting == PENDING)
        drain(profile);
    if (!profile->status)
        profile->status = row_of(&profile->rows, &profile->count, &row, &at, &profile->error);
    if (profile->status) {
        if (begin)
            clReleaseEvent(begin);
        clReleaseEvent(end);
        return;
    }
    profile->rows[at].launches++;
    profile->rows[at].bytes += slot->cost_bytes;
    profile->rows[at].flops += slot->cost_flops;
    slot->cost_bytes = slot->cost_flops = 0;
    profile->list[profile->waiting++] = (pending){begin, end, at};
}

hada_status hada_slot_times(hada_slot *slot, hada_kernel_time **rows, size_t *count, hada_error *err)
{
    hada_profile *profile = slot->profile;
    if (!profile)
        return hada_fail(err, HADA_ERROR_STATE, "profiling is off");
    drain(profile);
    if (profile->status) {
        if (err)
            *err = profile->error;
        return profile->status;
    }
    for (size_t i = 0; i < profile->count; i++) {
        const hada_kernel_time *from = &profile->rows[i];
        size_t at;
        HADA_TRY(row_of(rows, count, from, &at, err));
        hada_kernel_time *to = &(*rows)[at];
        to->launches += from->launches;
        to->seconds += from->seconds;
        to->bytes += from->bytes;
        to->flops += from->flops;
    }
    return HADA_OK;
}

void hada_slot_moved(hada_slot *slot, const char *name, double bytes)
{
    slot->calls.transfers++;
    slot->calls.bytes_up += strcmp(name, "write") ? 0 : bytes;
    slot->calls.bytes_down += strcmp(name, "read") ? 0 : bytes;
    if (!slot->profile)
        return;
    hada_slot_cost(slot, bytes, 0);
    hada_profile_add(slot, name, 1, NULL, slot->event);
}

hada_status hada_slot_span_begin(hada_slot *slot, cl_event *begin, hada_error *err)
{
    *begin = NULL;
    if (!slot->profile)
        return HADA_OK;
    const cl_int code = clEnqueueMarkerWithWaitList(slot->queue, 0, NULL, begin);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clEnqueueMarkerWithWaitList");
}

hada_status hada_slot_span_end(hada_slot *slot, const char *name, cl_event begin, hada_error *err)
{
    cl_event end;
    if (!slot->profile)
        return HADA_OK;
    const cl_int code = clEnqueueMarkerWithWaitList(slot->queue, 0, NULL, &end);
    if (code != CL_SUCCESS) {
        if (begin)
            clReleaseEvent(begin);
        return hada_fail_cl(err, code, "clEnqueueMarkerWithWaitList");
    }
    hada_profile_add(slot, name, 0, begin, end);
    return HADA_OK;
}

hada_status hada_slot_create(hada_slot **out, hada_context *context, hada_error *err)
{
    hada_slot *slot = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(slot, 1, "a queue slot", err));
    slot->context = context;
    if (!context->dry) {
        HADA_TRY_OR_DONE(HADA_NEW(slot->kernels, (size_t)hada_kernel_object_count, "a queue slot", err));
        HADA_TRY_OR_DONE(open_queue(slot, 0, err));
    }
done:
    if (status)
        hada_slot_destroy(&slot);
    *out = slot;
    return status;
}

void hada_slot_destroy(hada_slot **pointer)
{
    hada_slot *slot = hada_taken(pointer);
    if (!slot)
        return;
    forget_times(slot);
    if (slot->landmark)
        clReleaseEvent(slot->landmark);
    close_queue(slot);
    for (int i = 0; slot->kernels && i < hada_kernel_object_count; i++) {
        if (slot->kernels[i].cl)
            clReleaseKernel(slot->kernels[i].cl);
        free(slot->kernels[i].args);
    }
    HADA_FREE(slot->kernels, slot);
}
