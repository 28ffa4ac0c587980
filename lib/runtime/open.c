/* Opening a context: one chosen device, or one adopted, its programs and its tuning. */
#include "runtime/context.h"

#include <hadalens/opencl.h>
#include <stdarg.h>

#include "core/callers.h"
#include "kernels/shared_local.h"
#include "runtime/program.h"
#include "runtime/tuning.h"

/* The device that the options and the environment mean, and the part of it. */
static hada_status find_device(const hada_context_options *options, const hada_device_info *infos, size_t count,
                               size_t *chosen, int *part, int *parts, hada_error *err)
{
    const char *named = options->device ? options->device : getenv("HADALENS_DEVICE");
    const char *binaries = options->binaries ? options->binaries : getenv("HADALENS_BINARIES");
    char *words = hada_string_copy(named ? named : "");
    *part = options->part;
    *parts = options->parts;
    if (!words)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for a context");
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_device_part(words, part, parts, err));
    HADA_TRY_OR_DONE(hada_device_choose(infos, count, words, binaries && *binaries, chosen, err));
done:
    free(words);
    return status;
}

static hada_status take_part(hada_context *context, int part, int parts, hada_error *err)
{
    cl_device_id device;
    const int index = context->info.index;
    HADA_TRY(hada_device_divide(context->device, &context->info, part, parts, &device, err));
    context->device = device;
    hada_status status = hada_device_describe(context->platform, device, index, &context->info, err);
    context->info.part = part;
    context->info.parts = parts;
    return status;
}

static hada_status choose_device(hada_context *context, const hada_context_options *options, hada_error *err)
{
    hada_platform_device *devices = NULL;
    hada_device_info *infos = NULL;
    size_t count, chosen = 0;
    int part, parts;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_platform_devices(&devices, &count, err));
    HADA_TRY_OR_DONE(HADA_NEW(infos, count, "the list of devices", err));
    for (size_t i = 0; i < count; i++)
        HADA_TRY_OR_DONE(hada_device_describe(devices[i].platform, devices[i].device, (int)i, &infos[i], err));
    HADA_TRY_OR_DONE(find_device(options, infos, count, &chosen, &part, &parts, err));
    context->platform = devices[chosen].platform;
    context->device = devices[chosen].device;
    context->info = infos[chosen];
    if (part || parts)
        HADA_TRY_OR_DONE(take_part(context, part, parts, err));
done:
    HADA_FREE(devices, infos);
    return status;
}

/* Whether its compiler takes products of matrices in TF32 as inline PTX: compute capability 8.0 is the first. */
static cl_int find_tensor_cores(cl_device_id device, int *found)
{
    enum { COMPUTE_CAPABILITY_MAJOR_NV = 0x4000, FIRST_WITH_TF32 = 8 }; /* cl_nv_device_attribute_query */
    char extensions[8192] = "";
    cl_uint major = 0;
    cl_int code = clGetDeviceInfo(device, CL_DEVICE_EXTENSIONS, sizeof extensions - 1, extensions, NULL);
    if (code == CL_SUCCESS && strstr(extensions, "cl_nv_device_attribute_query"))
        code = clGetDeviceInfo(device, COMPUTE_CAPABILITY_MAJOR_NV, sizeof major, &major, NULL);
    *found = code == CL_SUCCESS && major >= FIRST_WITH_TF32;
    return code;
}

/* What follows from the device. */
static hada_status look_at_device(hada_context *context, hada_error *err)
{
    hada_quirks_find(&context->info, &context->quirks);
    if (context->quirks.stated_local && context->info.local_memory_bytes > HADA_STATED_LOCAL)
        context->info.local_memory_bytes = HADA_STATED_LOCAL;
    cl_uint floats = 0; /* a device that does not say is one without vectors */
    cl_int code = clGetDeviceInfo(context->device, CL_DEVICE_NATIVE_VECTOR_WIDTH_FLOAT, sizeof floats, &floats, NULL);
    if (!hada_cl_is_memory(code))
        code = find_tensor_cores(context->device, &context->tensor_cores);
    if (hada_cl_is_memory(code)) /* what it did not say decides how results are rounded */
        return hada_fail_cl(err, code, "clGetDeviceInfo");
    context->vector_floats = floats;
    return HADA_OK;
}

static hada_status choose_shape(hada_context *context, int wanted, hada_error *err)
{
    const char *named = getenv("HADALENS_SHAPE");
    context->shape = context->info.kind == HADA_DEVICE_GPU ? HADA_SHAPE_GROUPS : HADA_SHAPE_LANES;
    if (wanted == HADA_SHAPE_LANES || wanted == HADA_SHAPE_GROUPS) {
        context->shape = (hada_kernel_shape)wanted;
    } else if (wanted != HADA_AUTO) {
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.shape is %d: give HADA_SHAPE_LANES, HADA_SHAPE_GROUPS or HADA_AUTO", wanted);
    } else if (named && *named) {
        context->shape = strcmp(named, "groups") ? HADA_SHAPE_LANES : HADA_SHAPE_GROUPS;
        if (strcmp(named, hada_enum_name(HADA_ENUM_KERNEL_SHAPE, (int)context->shape)))
            return hada_fail(err, HADA_ERROR_DEVICE_CHOICE,
                             "HADALENS_SHAPE is '%s', which is no shape of kernels: set it to lanes or groups", named);
    }
    return HADA_OK;
}

/* The device of an OpenCL context that is there already. */
typedef struct adopted {
    cl_context context;
    cl_device_id device;
} adopted;

static hada_status check_adopted(const adopted *from, hada_error *err)
{
    cl_device_id devices[64];
    size_t bytes = 0;
    const cl_int code = clGetContextInfo(from->context, CL_CONTEXT_DEVICES, sizeof devices, devices, &bytes);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clGetContextInfo");
    for (size_t i = 0; i < bytes / sizeof *devices; i++)
        if (devices[i] == from->device)
            return HADA_OK;
    return hada_fail(err, HADA_ERROR_DEVICE_CHOICE, "hada_context_adopt: the device is none of the context's");
}

/* Its number in the list of devices; -1: a part of a device, or one of a platform that is not listed. */
static int index_of(cl_device_id device)
{
    hada_platform_device *devices = NULL;
    size_t count = 0;
    int index = -1;
    if (hada_platform_devices(&devices, &count, NULL) == HADA_OK)
        for (size_t i = 0; i < count; i++)
            if (devices[i].device == device)
                index = (int)i;
    free(devices);
    return index;
}

static hada_status take_device(hada_context *context, const adopted *from, hada_error *err)
{
    HADA_TRY(check_adopted(from, err));
    const cl_int code =
        clGetDeviceInfo(from->device, CL_DEVICE_PLATFORM, sizeof context->platform, &context->platform, NULL);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clGetDeviceInfo");
    HADA_TRY(hada_device_describe(context->platform, from->device, index_of(from->device), &context->info, err));
    clRetainDevice(from->device);
    context->device = from->device;
    context->adopted = 1;
    clRetainContext(from->context);
    context->cl = from->context;
    return HADA_OK;
}

static hada_status make_device(hada_context *context, const hada_context_options *options, hada_error *err)
{
    cl_int code;
    HADA_TRY(choose_device(context, options, err));
    cl_context_properties properties[] = {CL_CONTEXT_PLATFORM, (cl_context_properties)context->platform, 0};
    context->cl = clCreateContext(properties, 1, &context->device, NULL, NULL, &code);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clCreateContext");
}

static hada_status open_context(hada_context **out, const adopted *from, const hada_context_options *callers,
                                hada_error *err)
{
    hada_context_options options;
    hada_context *context = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&options, callers, hada_context_options, err));
    HADA_TRY_OR_DONE(HADA_NEW(context, 1, "a context", err));
    context->lock = (pthread_mutex_t)PTHREAD_MUTEX_INITIALIZER;
    context->log = options.log;
    context->log_user = options.log_user;
    context->log_level = options.log_level;
    context->monitor = options.monitor;
    const char *tuning = options.tuning ? options.tuning : getenv("HADALENS_TUNING");
    if (tuning && *tuning)
        HADA_TRY_OR_DONE(hada_tuning_read(&context->tuning, tuning, err));
    HADA_TRY_OR_DONE(from ? take_device(context, from, err) : make_device(context, &options, err));
    HADA_TRY_OR_DONE(look_at_device(context, err));
    HADA_TRY_OR_DONE(choose_shape(context, options.shape, err));
    HADA_TRY_OR_DONE(hada_program_store_create(context, &options, err));
    hada_driver_cache_mend(context);
    if (!options.skip_self_test)
        HADA_TRY_OR_DONE(hada_self_test(context, err));
    hada_log(context, HADA_LOG_INFO, "device %d: %s (%s, %s), kernels as %s", context->info.index, context->info.name,
             hada_enum_name(HADA_ENUM_DEVICE_KIND, (int)context->info.kind), context->info.platform,
             hada_enum_name(HADA_ENUM_KERNEL_SHAPE, (int)context->shape));
    *out = context;
done:
    if (status)
        hada_context_destroy(&context);
    return status;
}

hada_status hada_context_create(hada_context **out, const hada_context_options *options, hada_error *err)
{
    return out ? open_context(out, NULL, options, err)
               : hada_fail(err, HADA_ERROR_ARGUMENT, "hada_context_create: out is needed");
}

hada_status hada_context_adopt(hada_context **out, cl_context context, cl_device_id device,
                               const hada_context_options *options, hada_error *err)
{
    HADA_NEED(out && context && device, err);
    return open_context(out, &(adopted){context, device}, options, err);
}

cl_context hada_context_cl_context(const hada_context *context)
{
    return context ? context->cl : NULL;
}

cl_device_id hada_context_cl_device(const hada_context *context)
{
    return context ? context->device : NULL;
}

void hada_context_destroy(hada_context **pointer)
{
    hada_context *context = hada_taken(pointer);
    if (!context)
        return;
    hada_program_store_destroy(context);
    for (hada_trial *trial = context->trials, *next; trial; trial = next) {
        next = trial->next;
        free(trial);
    }
    if (context->queue)
        clReleaseCommandQueue(context->queue);
    if (context->cl)
        clReleaseContext(context->cl);
    if (context->adopted)
        clReleaseDevice(context->device);
    pthread_mutex_destroy(&context->lock);
    hada_tuning_destroy(&context->tuning);
    free(context);
}
