/* Plans: made and unmade, their bytes, their times. */
#include "dispatch/plan.h"

#include <hadalens/profile.h>

#include "core/callers.h"
#include "runtime/profile.h"

/* Constants and workers of a device. */
static hada_status add_device(hada_plan *plan, hada_context *context, hada_error *err)
{
    const hada_setup *setup = &plan->setup;
    const int device = plan->contexts, queues = setup->config.queues;
    int number = 0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_constants_create(&plan->constants[device], context, setup, err));
    plan->contexts++;
    const int batch = hada_pipeline_fit(context, setup);
    for (; number < queues; number++)
        HADA_TRY_OR_DONE(
            hada_dispatcher_add(plan->dispatcher, setup, plan->constants[device], device, number, batch, err));
done:
    if (status && plan->dispatcher->capacity > 1)
        hada_error_prefix(err, "queue %d of device %d: ", number, device);
    return status;
}

static hada_status add_devices(hada_plan *plan, hada_context *const *contexts, int count, hada_error *err)
{
    plan->setup.config.batch_whole &= count == 1; /* several share the depths of a frame, batch by batch */
    HADA_TRY(HADA_NEW(plan->constants, (size_t)count, "a plan", err));
    HADA_TRY(hada_dispatcher_create(&plan->dispatcher, count * plan->setup.config.queues, err));
    for (int device = 0; device < count; device++)
        HADA_TRY(add_device(plan, contexts[device], err));
    return HADA_OK;
}

static hada_status check_contexts(hada_context *const *contexts, int count, hada_error *err)
{
    if (!contexts || count < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a plan needs one context at least");
    for (int i = 0; i < count; i++)
        for (int k = 0; k <= i; k++)
            if (!contexts[i] || (k < i && contexts[k] == contexts[i]))
                return hada_fail(err, HADA_ERROR_ARGUMENT,
                                 "a plan's contexts are different ones; for more queues on a device set the options' "
                                 "queues");
    return HADA_OK;
}

hada_status hada_plan_create_on(hada_plan **out, hada_context *const *contexts, int count, const hada_model *model,
                                const hada_plan_options *callers, hada_error *err)
{
    HADA_NEED(contexts, err);
    hada_plan_options options;
    hada_plan *plan = NULL;
    hada_status status = HADA_OK;
    if (!out || !model)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a plan needs out, context and model");
    *out = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&options, callers, hada_plan_options, err));
    HADA_TRY_OR_DONE(check_contexts(contexts, count, err));
    HADA_TRY_OR_DONE(HADA_NEW(plan, 1, "a plan", err));
    hada_frame_cache_make(&plan->cache);
    pthread_mutex_init(&plan->points_lock, NULL);
    HADA_TRY_OR_DONE(hada_setup_make(&plan->setup, contexts[0], model, &options, err));
    if (plan->setup.config.warm) /* frames wait for each other */
        count = 1;
    HADA_TRY_OR_DONE(add_devices(plan, contexts, count, err));
done:
    if (status)
        hada_plan_destroy(&plan);
    *out = plan;
    return status;
}

void hada_plan_destroy(hada_plan **pointer)
{
    hada_plan *plan = hada_taken(pointer);
    if (!plan)
        return;
    if (plan->dispatcher)
        hada_dispatcher_stop(plan->dispatcher);
    for (int i = 0; i < plan->contexts; i++)
        hada_constants_destroy(&plan->constants[i]);
    if (plan->dispatcher)
        hada_dispatcher_release(plan->dispatcher);
    hada_frame_cache_free(&plan->cache);
    hada_point_optics_destroy(&plan->points);
    pthread_mutex_destroy(&plan->points_lock);
    hada_setup_free(&plan->setup);
    HADA_FREE(plan->constants, plan);
}

hada_status hada_plan_estimate(hada_context *context, const hada_model *model, const hada_plan_options *callers,
                               uint64_t *device_bytes, uint64_t *host_bytes, hada_error *err)
{
    hada_plan_options options;
    hada_setup setup = {0};
    hada_needs needs;
    hada_status status = HADA_OK;
    if (!context || !model || !device_bytes || !host_bytes)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_plan_estimate: an argument is missing");
    HADA_TRY(HADA_OPTIONS_TAKE(&options, callers, hada_plan_options, err));
    HADA_TRY_OR_DONE(hada_setup_begin(&setup, context, model, &options, err));
    HADA_TRY_OR_DONE(hada_pipeline_needs(&needs, context, &setup, hada_pipeline_fit(context, &setup), err));
    *device_bytes = needs.constants + (uint64_t)setup.config.queues * needs.each + needs.making;
    const hada_model_info *info = hada_model_get_info(model);
    const uint64_t pixels = (uint64_t)info->window_rows * (uint64_t)info->window_cols;
    const uint64_t plane = sizeof(float) * pixels * (uint64_t)info->channels;
    const uint64_t frame =
        sizeof(float) * (uint64_t)info->raw_rows * (uint64_t)info->raw_cols * (uint64_t)info->channels;
    const uint64_t result = plane * (uint64_t)setup.config.depths + plane + sizeof(float) * pixels;
    /* the result, a copy of the frame while broken pixels are repaired, and the frame before with its result */
    /* a mosaic's other colours are filled in; a frame of the sensor's size is binned */
    const uint64_t times = (uint64_t)setup.config.kind.downsample;
    *host_bytes = result + (times > 1 ? (1 + times * times) * frame : 0) +
                  (options.repair_not_finite || setup.config.mosaic ? 2 * frame : 0) +
                  (options.skip & HADA_SKIP_FRAMES ? frame + result : 0);
done:
    hada_setup_free(&setup);
    return status;
}

void hada_plan_memory(const hada_plan *plan, uint64_t *held, uint64_t *apart)
{
    hada_needs needs;
    uint64_t bytes = 0, more = 0;
    if (!plan)
        return;
    for (int i = 0; i < plan->contexts; i++) {
        if (!hada_pipeline_needs(&needs, plan->constants[i]->context, &plan->setup, 1, NULL))
            bytes += needs.constants;
        bytes += hada_on_demand_bytes(plan->constants[i]->on_demand);
    }
    more = bytes;
    for (int i = 0; i < plan->dispatcher->worker_count; i++) {
        const hada_queue_worker *worker = &plan->dispatcher->workers[i];
        if (hada_pipeline_needs(&needs, worker->context, &plan->setup, hada_pipeline_batch(worker->pipeline), NULL))
            continue;
        bytes += needs.each;
        more += needs.apart;
    }
    if (held)
        *held = bytes;
    if (apart)
        *apart = more;
}

int hada_plan_queues(const hada_plan *plan, hada_queue_info *info, int capacity)
{
    if (!plan)
        return 0;
    hada_dispatcher *dispatcher = plan->dispatcher;
    pthread_mutex_lock(&dispatcher->lock);
    for (int i = 0; i < dispatcher->worker_count && i < capacity; i++)
        info[i] = dispatcher->workers[i].info;
    pthread_mutex_unlock(&dispatcher->lock);
    return dispatcher->worker_count;
}

hada_status hada_plan_profile(hada_plan *plan, int on, hada_error *err)
{
    HADA_NEED(plan, err);
    for (int i = 0; i < plan->dispatcher->worker_count; i++) {
        hada_slot *slot = hada_pipeline_slot(plan->dispatcher->workers[i].pipeline);
        if (slot)
            HADA_TRY(hada_slot_profile(slot, on, err));
    }
    return HADA_OK;
}

hada_status hada_plan_calls(const hada_plan *plan, hada_call_counts *counts, hada_error *err)
{
    hada_call_counts all = {0};
    HADA_NEED(plan && counts, err);
    for (int i = 0; i < plan->dispatcher->worker_count; i++) {
        const hada_slot *slot = hada_pipeline_slot(plan->dispatcher->workers[i].pipeline);
        const hada_calls calls = slot ? slot->calls : (hada_calls){0};
        all.launches += calls.launches;
        all.transfers += calls.transfers;
        all.waits += calls.waits;
        all.arguments += calls.arguments;
        all.bytes_up += calls.bytes_up;
        all.bytes_down += calls.bytes_down;
    }
    *counts = all;
    return HADA_OK;
}

hada_status hada_plan_kernel_times(hada_plan *plan, hada_kernel_time **rows, size_t *count, hada_error *err)
{
    int found = 0;
    hada_status status = HADA_OK;
    HADA_NEED(plan && rows && count, err);
    *rows = NULL;
    *count = 0;
    for (int i = 0; i < plan->dispatcher->worker_count; i++) {
        hada_slot *slot = hada_pipeline_slot(plan->dispatcher->workers[i].pipeline);
        if (!slot || !slot->profile)
            continue;
        HADA_TRY_OR_DONE(hada_slot_times(slot, rows, count, err));
        found = 1;
    }
    if (!found)
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_STATE, "profiling of the plan is off; turn it on with hada_plan_profile()"));
done:
    if (status) {
        free(*rows);
        *rows = NULL;
        *count = 0;
    }
    return status;
}
