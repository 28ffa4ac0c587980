#include "runtime/profile.h"

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

static void destroy(hada_slot *slot)
{
    if (!slot->profile)
        return;
    drain(slot->profile);
    HADA_FREE(slot->profile->rows, slot->profile);
    slot->profile = NULL;
}

hada_status hada_slot_profile(hada_slot *slot, int on, hada_error *err)
{
    destroy(slot);
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
