/* What the options come to for a model, and the bytes of it. */
#include "sched/plan.h"

void hada_plan_options_init(hada_plan_options *options)
{
    *options = (hada_plan_options){.size = sizeof *options, .refine = -1, .gamma = 1.0, .skip = HADA_SKIP_ALL};
}

static hada_status check_list(const int *list, int count, int limit, const char *what, hada_error *err)
{
    for (int i = 0; i < count; i++)
        if (list[i] < 0 || list[i] >= limit || (i && list[i] <= list[i - 1]))
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "%s: index %d is out of order or outside 0 to %d; give depths once each, near to far",
                             what, list[i], limit - 1);
    return HADA_OK;
}

static hada_status check_options(const hada_model_info *info, const hada_plan_options *options, hada_error *err)
{
    if (options->size != sizeof *options)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "plan options: start from hada_plan_options_init()");
    if (options->depth_count < 0 || options->occupied_count < 0 || options->batch < 0 || !(options->gamma > 0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "plan options: counts are not negative and gamma is above 0");
    hada_status status = HADA_OK;
    if (options->depths)
        status = options->depth_count ? check_list(options->depths, options->depth_count, info->depths, "depths", err)
                                      : hada_fail(err, HADA_ERROR_ARGUMENT, "the list of depths is empty");
    if (!status && options->occupied == HADA_OCCUPIED_LIST)
        status = options->occupied_list && options->occupied_count
                     ? check_list(options->occupied_list, options->occupied_count, info->depths, "occupied depths", err)
                     : hada_fail(err, HADA_ERROR_ARGUMENT, "the list of occupied depths is empty");
    if (!status && options->refine > 0 && !info->has_otf)
        status =
            hada_fail(err, HADA_ERROR_MODEL,
                      "the model %s holds no transfer functions, so nothing can be refined: use --refine 0, or make "
                      "the model again with fit",
                      info->name);
    const hada_image *dark = options->dark_frame;
    if (!status && options->dark == HADA_DARK_FRAME &&
        (!dark || dark->channels != info->channels || dark->rows != info->raw_rows || dark->cols != info->raw_cols))
        status =
            hada_fail(err, HADA_ERROR_SIZE, "the dark frame must have %d channel(s) of %d x %d pixels, as the model",
                      info->channels, info->raw_rows, info->raw_cols);
    return status;
}

hada_status hada_plan_shape_of(const hada_model *model, const hada_plan_options *options, hada_plan_shape *shape,
                               hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    hada_status status = check_options(info, options, err);
    if (status)
        return status;
    *shape = (hada_plan_shape){.depths = options->depths ? options->depth_count : info->depths};
    /* auto: what leave-one-out found to pay for this camera */
    shape->steps = options->refine >= 0 ? options->refine : info->has_otf ? info->refine_steps : 0;
    shape->refined = shape->steps > 0;
    shape->pursuit = shape->refined && options->occupied == HADA_OCCUPIED_AUTO && shape->depths > 1;
    shape->half = options->half || info->half;
    shape->parts = shape->refined ? HADA_BANK_OTFS : HADA_BANK_FILTERS;
    /* more depths at once than this only cost memory: the spectrum stays in the cache either way */
    shape->batch = options->batch ? options->batch : 8;
    if (shape->batch > shape->depths)
        shape->batch = shape->depths;
    hada_focus_options_init(&shape->focus, shape->refined);
    return HADA_OK;
}

size_t hada_plan_plane(const hada_plan *plan)
{
    const hada_model_info *info = hada_model_get_info(plan->model);
    return (size_t)info->channels * (size_t)info->window_rows * (size_t)info->window_cols;
}

hada_focus_desc hada_plan_focus_of(const hada_model_info *info, const hada_plan_shape *shape)
{
    return (hada_focus_desc){.options = shape->focus,
                             .channels = info->channels,
                             .rows = info->window_rows,
                             .cols = info->window_cols,
                             .depths = shape->depths};
}

static uint64_t prior_bytes(const hada_model *model, const hada_spectrum_layout *layout)
{
    return model->scene_power ? 4 * (uint64_t)hada_model_get_info(model)->channels * (uint64_t)layout->count : 0;
}

hada_status hada_plan_estimate(hada_context *context, const hada_model *model, const hada_plan_options *options,
                               uint64_t *device_bytes, uint64_t *host_bytes, hada_error *err)
{
    hada_plan_options defaults;
    hada_plan_shape shape;
    if (!context || !model || !device_bytes || !host_bytes)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_plan_estimate: an argument is missing");
    if (!options) {
        hada_plan_options_init(&defaults);
        options = &defaults;
    }
    hada_status status = hada_plan_shape_of(model, options, &shape, err);
    if (status)
        return status;
    const hada_model_info *info = hada_model_get_info(model);
    const hada_spectrum_layout layout = hada_hadamard_layout(context, info);
    const hada_focus_desc focus = hada_plan_focus_of(info, &shape);
    const uint64_t pixels = (uint64_t)info->window_rows * (uint64_t)info->window_cols;
    const uint64_t plane = 4 * pixels * (uint64_t)info->channels;
    const uint64_t frame = 4 * (uint64_t)info->raw_rows * (uint64_t)info->raw_cols * (uint64_t)info->channels;
    uint64_t bytes = hada_hadamard_bytes(context, info, shape.batch) +
                     hada_bank_bytes(info, &layout, shape.depths, shape.parts, shape.half) + hada_focus_bytes(&focus) +
                     plane + 4 * pixels;
    if (options->dark == HADA_DARK_FRAME)
        bytes += frame;
    if (shape.refined) {
        const hada_refine_shape refine = hada_refine_shape_of(info, shape.depths, shape.steps);
        bytes += hada_refiner_bytes(context, &refine) + prior_bytes(model, &layout);
        if (shape.pursuit) {
            const hada_pursuit_options pursuit = hada_plan_pursuit_of(model, shape.depths);
            bytes += hada_pursuit_bytes(context, &pursuit);
        }
    } else {
        bytes += plane * (uint64_t)shape.depths;
    }
    *device_bytes = bytes;
    /* the result, and a copy of the frame while broken pixels are repaired */
    *host_bytes = plane * (uint64_t)shape.depths + plane + 4 * pixels + (options->repair_not_finite ? 2 * frame : 0);
    return HADA_OK;
}
