/* Contexts: one chosen device, its programs and its books. */
#include <stdlib.h>

#include "context/selftest.h"
#include "core/alloc.h"
#include "device/platform.h"
#include "program/program.h"

void hada_context_options_init(hada_context_options *options)
{
    *options = (hada_context_options){.size = sizeof *options, .log_level = HADA_LOG_WARNING};
}

static hada_status choose_device(hada_context *context, const hada_context_options *options, hada_error *err)
{
    hada_platform_device *devices = NULL;
    hada_device_info *infos = NULL;
    size_t count, chosen = 0;
    hada_status status = hada_platform_devices(&devices, &count, err);
    if (status)
        return status;
    status = hada_alloc((void **)&infos, count, sizeof *infos, "the list of devices", err);
    for (size_t i = 0; !status && i < count; i++)
        status = hada_device_describe(devices[i].platform, devices[i].device, (int)i, &infos[i], err);
    if (!status) {
        const char *words = options->device ? options->device : getenv("HADALENS_DEVICE");
        const char *binaries = options->binaries ? options->binaries : getenv("HADALENS_BINARIES");
        status = hada_device_choose(infos, count, words, binaries && *binaries, &chosen, err);
    }
    if (!status) {
        context->platform = devices[chosen].platform;
        context->device = devices[chosen].device;
        context->info = infos[chosen];
        hada_quirks_find(&context->info, &context->quirks);
        context->shape = context->info.kind == HADA_DEVICE_GPU ? HADA_SHAPE_GROUPS : HADA_SHAPE_LANES;
        cl_uint floats = 0; /* a device that does not say is one without vectors */
        clGetDeviceInfo(context->device, CL_DEVICE_NATIVE_VECTOR_WIDTH_FLOAT, sizeof floats, &floats, NULL);
        context->vector_floats = floats;
    }
    free(devices);
    free(infos);
    return status;
}

hada_status hada_context_create(hada_context **out, const hada_context_options *options, hada_error *err)
{
    hada_context_options defaults;
    if (!out)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_context_create: out is needed");
    *out = NULL;
    hada_context_options_init(&defaults);
    if (!options)
        options = &defaults;
    if (options->size != sizeof *options)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_context_create: start from hada_context_options_init()");

    hada_context *context;
    hada_status status = hada_alloc((void **)&context, 1, sizeof *context, "a context", err);
    if (status)
        return status;
    pthread_mutex_init(&context->lock, NULL);
    context->log = options->log;
    context->log_user = options->log_user;
    context->log_level = options->log_level;

    const char *tuning = options->tuning ? options->tuning : getenv("HADALENS_TUNING");
    if (tuning && *tuning) {
        context->tuning_file = hada_string_copy(tuning);
        if (!context->tuning_file)
            status = hada_fail(err, HADA_ERROR_MEMORY, "no memory for a context");
    }
    if (!status)
        status = choose_device(context, options, err);
    if (!status) {
        cl_int code;
        cl_context_properties properties[] = {CL_CONTEXT_PLATFORM, (cl_context_properties)context->platform, 0};
        context->cl = clCreateContext(properties, 1, &context->device, NULL, NULL, &code);
        if (code != CL_SUCCESS)
            status = hada_fail_cl(err, code, "clCreateContext");
    }
    if (!status)
        status = hada_program_store_create(context, options, err);
    if (!status && !options->skip_self_test)
        status = hada_self_test(context, err);
    if (status) {
        hada_context_destroy(&context);
        return status;
    }
    hada_log(context, HADA_LOG_INFO, "device %d: %s (%s, %s)", context->info.index, context->info.name,
             hada_device_kind_name(context->info.kind), context->info.platform);
    *out = context;
    return HADA_OK;
}

void hada_context_destroy(hada_context **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_context *context = *pointer;
    *pointer = NULL;
    hada_program_store_destroy(context);
    if (context->cl)
        clReleaseContext(context->cl);
    pthread_mutex_destroy(&context->lock);
    free(context->tuning_file);
    free(context);
}
