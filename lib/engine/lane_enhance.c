/* The net of the model on a lane's planes. */
#include "engine/pipeline.h"

static hada_enhance_desc desc_of(const hada_context *context, const hada_model *model, const hada_plan_shape *shape,
                                 unsigned skip)
{
    const hada_model_info *info = hada_model_get_info(model);
    return (hada_enhance_desc){.net = hada_model_get_enhance(model),
                               .channels = info->channels,
                               .rows = info->window_rows,
                               .cols = info->window_cols,
                               .net_rows = info->enhance_rows,
                               .net_cols = info->enhance_cols,
                               .memory = (size_t)(context->info.memory_bytes / 4 / (uint64_t)shape->queues),
                               .content = skip & HADA_SKIP_TILES ? 0.0f : -1.0f};
}

uint64_t hada_lane_enhance_bytes(const hada_context *context, const hada_model *model, const hada_plan_shape *shape)
{
    size_t bytes;
    if (!shape->enhance)
        return 0;
    const hada_enhance_desc desc = desc_of(context, model, shape, HADA_SKIP_ALL);
    return hada_enhance_bytes(context, &desc, &bytes, NULL) ? 0 : bytes;
}

hada_status hada_lane_enhance_make(hada_lane *lane, hada_error *err)
{
    const hada_plan *plan = lane->plan;
    if (!plan->shape.enhance)
        return HADA_OK;
    const hada_enhance_desc desc = desc_of(lane->share->context, plan->model, &plan->shape, plan->options.skip);
    return hada_enhance_create(&lane->enhance, lane->slot, &desc, err);
}

hada_status hada_lane_enhance(hada_lane *lane, hada_task *task, cl_mem planes, int count, hada_error *err)
{
    int computed, left_out;
    if (!lane->enhance)
        return HADA_OK;
    hada_slot_stage(lane->slot, "enhance");
    hada_status status = hada_enhance_run(lane->enhance, planes, 0, count, err);
    hada_enhance_counts(lane->enhance, &computed, &left_out);
    atomic_fetch_add(&task->enhanced, count);
    atomic_fetch_add(&task->tiles, computed);
    atomic_fetch_add(&task->tiles_left_out, left_out);
    return status;
}
