/* Making lanes. */
#include "engine/pipeline.h"

#include <stdlib.h>

#include "core/alloc.h"

/* What skipping and a dark frame bring stands beside the room: it stays from frame to frame. */
static hada_status make_stage(hada_lane *lane, hada_error *err)
{
    const hada_plan *plan = lane->plan;
    hada_status status =
        hada_hadamard_create(&lane->stage, lane->slot, hada_model_get_info(plan->model), lane->batch, err);
    lane->slot->room = NULL;
    if (!status && plan->shape.dark)
        status = hada_hadamard_set_dark(lane->stage, plan->dark_frame.data, err);
    if (!status)
        status = hada_lane_skip_make(lane, err);
    lane->slot->room = &lane->room;
    return status;
}

/* In the order of the plan of the memory: lane_memory.c. */
static hada_status make_parts(hada_lane *lane, hada_error *err)
{
    const hada_plan *plan = lane->plan;
    const hada_plan_shape *shape = &plan->shape;
    const hada_model_info *info = hada_model_get_info(plan->model);
    hada_focus_desc focus = hada_plan_focus_of(info, shape);
    focus.distances_mm = plan->distances;
    hada_status status = make_stage(lane, err);
    if (!status)
        status = hada_scratch_create(&lane->pictures, lane->slot, hada_lane_pictures_bytes(info),
                                     "the all-in-focus image and the distance map", err);
    if (!status)
        status = hada_focus_create(&lane->focus, lane->slot, &focus, err);
    if (!status && shape->classic)
        status = hada_classic_create(&lane->classic, lane->slot, &shape->method, err);
    if (!status && shape->refined && !shape->classic) {
        const hada_refine_shape refine = hada_plan_refine_of(plan->model, shape);
        status = hada_refiner_create(&lane->refiner, lane->slot, &refine, err);
    }
    if (!status && shape->pursuit)
        status = hada_lane_make_pursuit(lane, err);
    if (!status && !shape->refined)
        status = hada_scratch_create(&lane->planes, lane->slot, hada_lane_planes_bytes(info, shape, lane->batch),
                                     "the refocused planes", err);
    return status;
}

static hada_status make_room(hada_lane *lane, hada_error *err)
{
    hada_context *context = lane->share->context;
    hada_status status =
        hada_lane_plan_memory(&lane->room, context, lane->plan->model, &lane->plan->shape, lane->batch, err);
    if (!status)
        status = hada_room_make(&lane->room, context, err);
    lane->slot->room = &lane->room;
    return status;
}

void hada_lane_clear(hada_lane *lane)
{
    if (lane->slot)
        hada_slot_finish(lane->slot, NULL);
    hada_pursuit_destroy(&lane->pursuit);
    hada_refiner_destroy(&lane->refiner);
    hada_classic_destroy(&lane->classic);
    hada_focus_destroy(&lane->focus);
    hada_enhance_destroy(&lane->enhance);
    hada_buffer_destroy(&lane->planes);
    hada_buffer_destroy(&lane->pictures);
    hada_meter_destroy(&lane->meter);
    hada_hadamard_destroy(&lane->stage);
    hada_slot_destroy(&lane->slot);
    hada_room_free(&lane->room);
    lane->holds = 0;
}

hada_status hada_lane_ready(hada_lane *lane, hada_error *err)
{
    if (lane->slot)
        return HADA_OK;
    hada_status status = hada_slot_create(&lane->slot, lane->share->context, err);
    if (!status)
        status = make_room(lane, err);
    if (!status)
        status = make_parts(lane, err);
    if (lane->slot)
        lane->slot->room = NULL;
    if (!status)
        status = hada_lane_enhance_make(lane, err);
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
