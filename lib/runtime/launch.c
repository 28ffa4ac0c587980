#include "runtime/launch.h"

#include "core/callers.h"
#include "runtime/profile.h"

int hada_program_find(const hada_kernel_file *file, const int *values)
{
    const size_t bytes = (size_t)file->macro_count * sizeof *values;
    for (int i = 0; i < file->program_count; i++)
        if (!memcmp(file->macro_values + i * file->macro_count, values, bytes))
            return i;
    return -1;
}

static hada_status check_program(const hada_kernel_file *file, int program, hada_error *err)
{
    if (program >= 0 && program < file->program_count)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_STATE, "kernels/manifest.txt has no program of %s.cl with the macros asked for",
                     file->name);
}

hada_status hada_program_prepare(hada_slot *slot, const hada_kernel_file *file, int program, hada_error *err)
{
    cl_program unused;
    HADA_TRY(check_program(file, program, err));
    return slot->context->dry
               ? HADA_OK
               : hada_program_get(slot->context, file->name, file->programs[program].macros, &unused, err);
}

/* The slot's own kernel object. */
static hada_status object_of(hada_slot *slot, const hada_kernel *kernel, int program, hada_kernel_object **out,
                             hada_error *err)
{
    const hada_kernel_file *file = kernel->file;
    cl_program built;
    cl_int code;
    hada_status status = HADA_OK;
    HADA_TRY(check_program(file, program, err));
    *out = &slot->kernels[file->first_object + program * file->kernel_count + kernel->index];
    if ((*out)->cl)
        return status;
    HADA_TRY(hada_program_get(slot->context, file->name, file->programs[program].macros, &built, err));
    (*out)->cl = clCreateKernel(built, kernel->name, &code);
    if (code != CL_SUCCESS) {
        (*out)->cl = NULL;
        status = hada_fail_cl(err, code, "clCreateKernel");
        hada_error_prefix(err, "kernel %s of %s.cl: ", kernel->name, file->name);
    }
    return status;
}

static cl_int set_argument(cl_kernel object, cl_uint index, const hada_kernel_parameter *parameter, const void *value)
{
    const hada_either *either = value;
    const hada_local *local = value;
    switch (parameter->kind) {
    case HADA_KERNEL_PARAMETER_LOCAL: return clSetKernelArg(object, index, local->bytes, NULL);
    case HADA_KERNEL_PARAMETER_EITHER:
        return either->buffer ? clSetKernelArg(object, index, sizeof either->buffer, &either->buffer)
                              : clSetKernelArg(object, index, either->bytes, NULL);
    default: return clSetKernelArg(object, index, parameter->size, value);
    }
}

static size_t bytes_of(const hada_kernel *kernel)
{
    size_t bytes = 0;
    for (int i = 0; i < kernel->parameter_count; i++) {
        const size_t end = kernel->parameters[i].offset + kernel->parameters[i].size;
        bytes = end > bytes ? end : bytes;
    }
    return bytes;
}

static size_t place_of(cl_mem mem)
{
    return (size_t)((uint64_t)(uintptr_t)mem * 0x9E3779B97F4A7C15u >> 54);
}
_Static_assert(HADA_HANDLES == 1 << (64 - 54), "the product's upper ten bits choose the place");

void hada_arguments_forget(hada_context *context, cl_mem mem)
{
    pthread_mutex_lock(&context->lock);
    atomic_store(&context->released[place_of(mem)], atomic_fetch_add(&context->releases, 1) + 1);
    pthread_mutex_unlock(&context->lock);
}

/* Whether the object was given this value last. */
static int is_set(const hada_context *context, const hada_kernel_object *object, const hada_kernel_parameter *parameter,
                  const void *args)
{
    const char *value = (const char *)args + parameter->offset;
    cl_mem mem = NULL;
    if (memcmp(object->args + parameter->offset, value, parameter->size))
        return 0;
    if (parameter->kind == HADA_KERNEL_PARAMETER_BUFFER || parameter->kind == HADA_KERNEL_PARAMETER_EITHER)
        memcpy(&mem, value, sizeof mem); /* an either begins with its buffer */
    return !mem || atomic_load(&context->released[place_of(mem)]) <= object->releases;
}

/* What the object has is not known while it is being set: after a failure all arguments are set again. */
static hada_status set_arguments(hada_slot *slot, hada_kernel_object *object, const hada_kernel *kernel,
                                 const void *args, hada_error *err)
{
    const size_t bytes = bytes_of(kernel);
    const unsigned long releases = atomic_load(&slot->context->releases);
    char *known = NULL;
    hada_status status = HADA_OK;
    if (!object->args)
        HADA_TRY_OR_DONE(HADA_NEW(known, bytes + 1, "a kernel's arguments", err));
    for (int i = 0; i < kernel->parameter_count; i++) {
        const hada_kernel_parameter *parameter = &kernel->parameters[i];
        if (object->args && is_set(slot->context, object, parameter, args))
            continue;
        slot->calls.arguments++;
        const cl_int code = set_argument(object->cl, (cl_uint)i, parameter, (const char *)args + parameter->offset);
        if (code != CL_SUCCESS) {
            status = hada_fail_cl(err, code, "clSetKernelArg");
            hada_error_prefix(err, "kernel %s, argument %d: ", kernel->name, i);
            goto done;
        }
    }
    if (known)
        object->args = known;
    known = NULL;
    memcpy(object->args, args, bytes);
    object->releases = releases;
done:
    if (status) {
        HADA_FREE(known, object->args);
        object->args = NULL;
    }
    return status;
}

/* Launches that may be in flight when a monitor is asked, or less where they take longer (HADA_SECONDS_UNASKED): what
 * is left of a long computation takes a part of a second then, and waiting so seldom costs nothing that could be
 * measured.
 */
enum { LAUNCHES_UNASKED = 16 };

/* Work between two landmarks, the one before the last of which is waited for: so much to twice as much is in flight.
 * Work that is cancelled ends when it has; refinement that nothing waits for was thousands of launches ahead of its
 * device. The time is that of two cores of a CPU, by what a launch needs at least (hada_slot_cost), and a fifth of it
 * where the memory is the device's own, since what has one moves 100 GB/s at least; faster devices end sooner, and
 * launches of which nothing is known count by their number. */
#define SECONDS_AHEAD       0.05
#define BYTES_A_SECOND      20e9
#define OPERATIONS_A_SECOND 50e9
#define OWN_MEMORY_FASTER   5.0
enum { LAUNCHES_AHEAD = 256 };

static double next_seconds(const hada_slot *slot)
{
    const double faster = slot->context->info.unified_memory ? 1.0 : OWN_MEMORY_FASTER;
    return (slot->cost_bytes / BYTES_A_SECOND + slot->cost_flops / OPERATIONS_A_SECOND) / faster;
}

static hada_status stay_near(hada_slot *slot, hada_error *err)
{
    cl_event here;
    slot->past_seconds += next_seconds(slot);
    if (++slot->past_landmark < LAUNCHES_AHEAD && slot->past_seconds < SECONDS_AHEAD)
        return HADA_OK;
    cl_int code = clEnqueueMarkerWithWaitList(slot->queue, 0, NULL, &here);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueMarkerWithWaitList");
    if (slot->landmark) {
        code = clWaitForEvents(1, &slot->landmark);
        clReleaseEvent(slot->landmark);
    }
    slot->landmark = here;
    slot->past_landmark = 0;
    slot->past_seconds = 0.0;
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clWaitForEvents");
}

/* Whether the caller, or another thread, wants the work to stop. */
static hada_status may_go_on(hada_slot *slot, hada_error *err)
{
    if (slot->cancelled && atomic_load(slot->cancelled))
        return hada_fail(err, HADA_ERROR_CANCELLED, "the work was cancelled");
    if (slot->cancelled)
        HADA_TRY(stay_near(slot, err));
    if (!slot->monitor)
        return HADA_OK;
    slot->unasked_seconds += next_seconds(slot);
    if (++slot->unasked < LAUNCHES_UNASKED && slot->unasked_seconds < slot->most_unasked)
        return HADA_OK;
    slot->unasked = 0;
    slot->unasked_seconds = 0.0;
    HADA_TRY(hada_slot_finish(slot, err));
    return hada_monitor_check(slot->monitor, err);
}

static hada_status enqueue(hada_slot *slot, cl_kernel object, const char *name, const hada_range *range,
                           const size_t offset[3], hada_error *err)
{
    const cl_int code = clEnqueueNDRangeKernel(slot->queue, object, 3, offset, range->global, range->local, 0, NULL,
                                               hada_slot_event(slot));
    if (code != CL_SUCCESS) {
        const hada_status status = hada_fail_cl(err, code, "clEnqueueNDRangeKernel");
        hada_error_prefix(err, "kernel %s: ", name);
        return status;
    }
    slot->calls.launches++;
    if (slot->profile)
        hada_profile_add(slot, name, 0, NULL, slot->event);
    return HADA_OK;
}

/* The monitor is asked between parts. */
static hada_status enqueue_parts(hada_slot *slot, cl_kernel object, const char *name, const hada_range *range,
                                 double parts, hada_error *err)
{
    const int d = range->divisible - 1;
    const size_t local = range->local[d], groups = range->global[d] / local;
    const size_t each = parts < (double)groups ? (size_t)((double)groups / parts) : 1;
    size_t offset[3] = {0};
    for (size_t at = 0; at < groups; at += each) {
        hada_range some = *range;
        some.global[d] = (each < groups - at ? each : groups - at) * local;
        offset[d] = at * local;
        HADA_TRY(enqueue(slot, object, name, &some, offset, err));
        HADA_TRY(hada_slot_finish(slot, err));
        HADA_TRY(hada_monitor_check(slot->monitor, err));
    }
    return HADA_OK;
}

hada_status hada_launch(hada_slot *slot, const hada_kernel *kernel, int program, const hada_range *range,
                        const void *args, hada_error *err)
{
    hada_kernel_object *object = NULL;
    if (slot->context->dry)
        return HADA_OK;
    HADA_TRY(may_go_on(slot, err));
    HADA_TRY(object_of(slot, kernel, program, &object, err));
    HADA_TRY(set_arguments(slot, object, kernel, args, err));
    if (!range->global[0] || !range->global[1] || !range->global[2]) { /* nothing to do */
        hada_slot_cost(slot, 0, 0);
        return HADA_OK;
    }
    const double seconds = slot->monitor && range->divisible ? next_seconds(slot) : 0.0;
    if (seconds <= slot->most_unasked)
        return enqueue(slot, object->cl, kernel->name, range, NULL, err);
    return enqueue_parts(slot, object->cl, kernel->name, range, seconds / slot->most_unasked, err);
}
