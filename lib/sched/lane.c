/* Making lanes, and their bytes. */
#include "sched/lane.h"

#include <stdlib.h>

#include "core/alloc.h"

/* Bytes of the buffers that the lane itself holds. */
static size_t planes_bytes(const hada_model_info *info, const hada_plan_shape *shape, int batch)
{
    return shape->refined ? 0 : hada_plane_values(info) * (size_t)batch * sizeof(float);
}

static size_t pictures_bytes(const hada_model_info *info)
{
    const size_t pixels = (size_t)info->window_rows * (size_t)info->window_cols;
    return (hada_plane_values(info) + pixels) * sizeof(float);
}

uint64_t hada_lane_bytes(const hada_context *context, const hada_model *model, const hada_plan_shape *shape, int batch)
{
    const hada_model_info *info = hada_model_get_info(model);
    const hada_focus_desc focus = hada_plan_focus_of(info, shape);
    const uint64_t frame = 4 * (uint64_t)info->raw_rows * (uint64_t)info->raw_cols * (uint64_t)info->channels;
    uint64_t bytes = hada_hadamard_bytes(context, info, batch) + hada_focus_bytes(&focus) +
                     planes_bytes(info, shape, batch) + pictures_bytes(info) + (shape->dark ? frame : 0) +
                     hada_lane_skip_bytes(context, info, shape, batch);
    if (shape->refined) {
        const hada_refine_shape refine = hada_refine_shape_of(info, shape->depths, shape->steps);
        bytes += hada_refiner_bytes(context, &refine);
    }
    if (shape->pursuit) {
        const hada_pursuit_options pursuit = hada_plan_pursuit_of(model, shape);
        bytes += hada_pursuit_bytes(context, &pursuit);
    }
    return bytes;
}

int hada_lane_batch(const hada_context *context, const hada_model *model, const hada_plan_shape *shape, int queues)
{
    const uint64_t room = context->info.memory_bytes / 4 * 3, share = hada_share_bytes(context, model, shape);
    int batch = shape->batch;
    for (; batch > 1; batch = (batch + 1) / 2) {
        const uint64_t lanes = (uint64_t)queues * hada_lane_bytes(context, model, shape, batch);
        const size_t planes = planes_bytes(hada_model_get_info(model), shape, batch);
        if (planes <= context->info.max_allocation_bytes && share + lanes <= room)
            break;
    }
    return batch;
}

static hada_status make_stages(hada_lane *lane, hada_error *err)
{
    const hada_plan *plan = lane->plan;
    const hada_plan_shape *shape = &plan->shape;
    const hada_model_info *info = hada_model_get_info(plan->model);
    hada_context *context = lane->share->context;
    hada_focus_desc focus = hada_plan_focus_of(info, shape);
    focus.distances_mm = plan->distances;
    hada_status status = hada_hadamard_create(&lane->stage, lane->slot, info, lane->batch, err);
    if (!status && shape->dark)
        status = hada_hadamard_set_dark(lane->stage, plan->dark_frame.data, err);
    if (!status)
        status = hada_lane_skip_make(lane, err);
    if (!status)
        status = hada_buffer_create(&lane->pictures, context, pictures_bytes(info),
                                    "the all-in-focus image and the distance map", err);
    if (!status)
        status = hada_focus_create(&lane->focus, lane->slot, &focus, err);
    if (!status && shape->refined) {
        const hada_refine_shape refine = hada_refine_shape_of(info, shape->depths, shape->steps);
        status = hada_refiner_create(&lane->refiner, lane->slot, &refine, err);
    }
    if (!status && shape->pursuit)
        status = hada_lane_make_pursuit(lane, err);
    if (!status && !shape->refined)
        status = hada_buffer_create(&lane->planes, context, planes_bytes(info, shape, lane->batch),
                                    "the refocused planes", err);
    return status;
}

void hada_lane_clear(hada_lane *lane)
{
    if (lane->slot)
        hada_slot_finish(lane->slot, NULL);
    hada_pursuit_destroy(&lane->pursuit);
    hada_refiner_destroy(&lane->refiner);
    hada_focus_destroy(&lane->focus);
    hada_buffer_destroy(&lane->planes);
    hada_buffer_destroy(&lane->pictures);
    hada_meter_destroy(&lane->meter);
    hada_hadamard_destroy(&lane->stage);
    hada_slot_destroy(&lane->slot);
    lane->holds = 0;
}

hada_status hada_lane_ready(hada_lane *lane, hada_error *err)
{
    if (lane->slot)
        return HADA_OK;
    hada_status status = hada_slot_create(&lane->slot, lane->share->context, err);
    if (!status)
        status = make_stages(lane, err);
    if (status)
        hada_lane_clear(lane);
    return status;
}

hada_status hada_lane_create(hada_lane **out, const hada_plan *plan, const hada_share *share, int device, int number,
                             hada_error *err)
{
    hada_lane *lane;
    *out = NULL;
    hada_status status = hada_alloc((void **)&lane, 1, sizeof *lane, "a plan", err);
    if (status)
        return status;
    lane->plan = plan;
    lane->share = share;
    lane->info.device = device;
    lane->number = number;
    lane->batch = share->batch;
    status = hada_alloc((void **)&lane->occupied, (size_t)plan->shape.depths, sizeof(int), "a plan", err);
    if (!status)
        status = hada_lane_ready(lane, err);
    if (status)
        hada_lane_destroy(&lane);
    *out = lane;
    return status;
}

void hada_lane_destroy(hada_lane **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_lane *lane = *pointer;
    *pointer = NULL;
    hada_lane_clear(lane);
    free(lane->occupied);
    free(lane);
}
