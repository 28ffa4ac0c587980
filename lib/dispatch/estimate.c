/* The bytes of a plan, from its shape alone. */
#include "core/options.h"
#include "engine/pipeline.h"

hada_status hada_plan_estimate(hada_context *context, const hada_model *model, const hada_plan_options *callers,
                               uint64_t *device_bytes, uint64_t *host_bytes, hada_error *err)
{
    hada_plan_options own, *options = &own;
    hada_plan_shape shape;
    if (!context || !model || !device_bytes || !host_bytes)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_plan_estimate: an argument is missing");
    hada_plan_options_init(options);
    hada_status status = HADA_OPTIONS_TAKE(options, callers, hada_plan_options, err);
    if (!status)
        status = hada_plan_shape_of(model, options, &shape, err);
    if (!status && shape.classic)
        status = hada_classic_fit_grid(&shape.method, context, model, options->depths, shape.depths, err);
    if (status)
        return status;
    const hada_model_info *info = hada_model_get_info(model);
    const uint64_t pixels = (uint64_t)info->window_rows * (uint64_t)info->window_cols;
    const uint64_t plane = 4 * pixels * (uint64_t)info->channels;
    const uint64_t frame = 4 * (uint64_t)info->raw_rows * (uint64_t)info->raw_cols * (uint64_t)info->channels;
    const int batch = hada_lane_batch(context, model, &shape, shape.queues);
    uint64_t lane, apart;
    status = hada_lane_bytes(context, model, &shape, batch, &lane, &apart, err);
    *device_bytes = hada_share_bytes(context, model, &shape) + (uint64_t)shape.queues * lane +
                    hada_hadamard_check_bytes(context, info);
    /* the result, a copy of the frame while broken pixels are repaired, and the frame before with its result */
    const uint64_t result = plane * (uint64_t)shape.depths + plane + 4 * pixels;
    *host_bytes = result + (options->repair_not_finite ? 2 * frame : 0) +
                  (options->skip & HADA_SKIP_FRAMES ? hada_frames_bytes(frame, result) : 0);
    return status;
}

void hada_plan_memory(const hada_plan *plan, uint64_t *held, uint64_t *apart)
{
    uint64_t bytes = 0, more = 0;
    for (int i = 0; i < plan->share_count; i++)
        bytes += hada_share_bytes(plan->shares[i]->context, plan->model, &plan->shape);
    more = bytes;
    for (int i = 0; i < plan->lane_count; i++) {
        const hada_lane *lane = plan->lanes[i];
        uint64_t here = 0, alone = 0;
        hada_lane_bytes(lane->share->context, plan->model, &plan->shape, lane->batch, &here, &alone, NULL);
        bytes += here;
        more += alone;
    }
    if (held)
        *held = bytes;
    if (apart)
        *apart = more;
}
