/* Making and unmaking plans. */
#include "sched/plan.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "sched/lane.h"
#include "sched/share.h"

static int listed(const int *list, int count, int depth)
{
    for (int i = 0; i < count; i++)
        if (list[i] == depth)
            return 1;
    return 0;
}

static hada_status make_lists(hada_plan *plan, const hada_plan_options *options, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(plan->model);
    const size_t depths = (size_t)plan->shape.depths;
    hada_status status = hada_alloc((void **)&plan->depths, depths, sizeof(int), "a plan", err);
    if (!status)
        status = hada_alloc((void **)&plan->distances, depths, sizeof(double), "a plan", err);
    if (!status)
        status = hada_alloc((void **)&plan->listed, depths, 1, "a plan", err);
    if (status)
        return status;
    int found = 0;
    for (int i = 0; i < plan->shape.depths; i++) {
        plan->depths[i] = options->depths ? options->depths[i] : i;
        plan->distances[i] = info->distances_mm[plan->depths[i]];
        plan->listed[i] = options->occupied != HADA_OCCUPIED_LIST ||
                          listed(options->occupied_list, options->occupied_count, plan->depths[i]);
        found += plan->listed[i];
    }
    if (!found)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "none of the occupied depths is among the depths to compute");
    return HADA_OK;
}

static hada_status copy_dark(hada_plan *plan, const hada_image *dark, hada_error *err)
{
    hada_status status = hada_image_create(&plan->dark_frame, dark->channels, dark->rows, dark->cols, err);
    if (status)
        return status;
    memcpy(plan->dark_frame.data, dark->data, hada_image_count(dark) * sizeof(float));
    const size_t broken = hada_image_count_not_finite(dark);
    return broken ? hada_fail(err, HADA_ERROR_NOT_FINITE, "the dark frame holds %zu values that are not finite", broken)
                  : HADA_OK;
}

hada_status hada_plan_create(hada_plan **out, hada_context *context, const hada_model *model,
                             const hada_plan_options *options, hada_error *err)
{
    hada_plan_options defaults;
    hada_plan *plan;
    if (!out || !context || !model)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_plan_create: out, context and model are needed");
    *out = NULL;
    if (!options) {
        hada_plan_options_init(&defaults);
        options = &defaults;
    }
    hada_status status = hada_alloc((void **)&plan, 1, sizeof *plan, "a plan", err);
    if (status)
        return status;
    plan->model = model;
    plan->options = *options;
    status = hada_plan_shape_of(model, options, &plan->shape, err);
    if (!status)
        status = make_lists(plan, options, err);
    if (!status && plan->shape.dark)
        status = copy_dark(plan, options->dark_frame, err);
    plan->options.depths = plan->options.occupied_list = NULL;
    plan->options.dark_frame = NULL;
    if (!status)
        status = hada_share_create(&plan->share, context, model, &plan->shape, plan->depths, err);
    if (!status)
        status = hada_lane_create(&plan->lane, plan, plan->share, err);
    if (status) {
        hada_plan_destroy(&plan);
        return status;
    }
    *out = plan;
    return HADA_OK;
}

void hada_plan_destroy(hada_plan **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_plan *plan = *pointer;
    *pointer = NULL;
    hada_lane_destroy(&plan->lane);
    hada_share_destroy(&plan->share);
    hada_image_destroy(&plan->dark_frame);
    free(plan->depths);
    free(plan->distances);
    free(plan->listed);
    free(plan);
}
