/* Making and unmaking plans. */
#include "sched/plan.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"

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
    if (!status)
        status = hada_alloc((void **)&plan->occupied, depths, sizeof(int), "a plan", err);
    if (!status)
        status = hada_alloc((void **)&plan->levels, (size_t)info->channels, sizeof(double), "a plan", err);
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

/* What refinement needs beside the bank. */
static hada_status make_refinement(hada_plan *plan, hada_error *err)
{
    const hada_plan_shape *shape = &plan->shape;
    const hada_refine_shape refine =
        hada_refine_shape_of(hada_model_get_info(plan->model), shape->depths, shape->steps);
    size_t first;
    int together;
    hada_bank_otf(plan->bank, 0, &first, &together);
    if (together < shape->depths)
        return hada_fail(
            err, HADA_ERROR_DEVICE_MEMORY,
            "refinement needs the transfer functions of %d depths in one buffer, and %s takes %d: compute fewer "
            "depths (--depths) or leave refinement out (--refine 0)",
            shape->depths, plan->context->info.name, together);
    hada_status status = hada_bank_prior(&plan->prior, plan->slot, plan->model, &plan->bank->layout, err);
    if (!status)
        status = hada_refiner_create(&plan->refiner, plan->slot, &refine, err);
    if (!status && shape->pursuit)
        status = hada_plan_make_pursuit(plan, err);
    return status;
}

static hada_status make_parts(hada_plan *plan, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(plan->model);
    const hada_plan_shape *shape = &plan->shape;
    const hada_spectrum_layout layout = hada_hadamard_layout(plan->context, info);
    const size_t plane = hada_plan_plane(plan), pixels = plane / (size_t)info->channels;
    hada_focus_desc focus = hada_plan_focus_of(info, shape);
    focus.distances_mm = plan->distances;
    hada_status status = hada_slot_create(&plan->slot, plan->context, err);
    if (!status)
        status = hada_hadamard_create(&plan->stage, plan->slot, info, shape->batch, err);
    if (!status && plan->dark_frame.data)
        status = hada_hadamard_set_dark(plan->stage, plan->dark_frame.data, err);
    if (!status)
        status = hada_bank_create(&plan->bank, plan->slot, plan->model, &layout, plan->depths, shape->depths,
                                  shape->parts, shape->half, err);
    if (!status)
        status = hada_buffer_create(&plan->pictures, plan->context, (plane + pixels) * sizeof(float),
                                    "the all-in-focus image and the distance map", err);
    if (!status)
        status = hada_focus_create(&plan->focus, plan->slot, &focus, err);
    if (!status && shape->refined)
        status = make_refinement(plan, err);
    if (!status && !shape->refined)
        status = hada_buffer_create(&plan->planes, plan->context, plane * (size_t)shape->depths * sizeof(float),
                                    "the refocused planes", err);
    return status;
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
    plan->context = context;
    plan->model = model;
    plan->options = *options;
    status = hada_plan_shape_of(model, options, &plan->shape, err);
    if (!status)
        status = make_lists(plan, options, err);
    if (!status && options->dark == HADA_DARK_FRAME) {
        const hada_image *dark = options->dark_frame;
        status = hada_image_create(&plan->dark_frame, dark->channels, dark->rows, dark->cols, err);
        if (!status)
            memcpy(plan->dark_frame.data, dark->data, hada_image_count(dark) * sizeof(float));
        if (!status && hada_image_count_not_finite(dark))
            status = hada_fail(err, HADA_ERROR_NOT_FINITE, "the dark frame holds %zu values that are not finite",
                               hada_image_count_not_finite(dark));
    }
    plan->options.depths = plan->options.occupied_list = NULL;
    plan->options.dark_frame = NULL;
    if (!status)
        status = make_parts(plan, err);
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
    if (plan->slot)
        hada_slot_finish(plan->slot, NULL);
    hada_pursuit_destroy(&plan->pursuit);
    hada_refiner_destroy(&plan->refiner);
    hada_focus_destroy(&plan->focus);
    hada_buffer_destroy(&plan->planes);
    hada_buffer_destroy(&plan->pictures);
    hada_buffer_destroy(&plan->prior);
    hada_bank_destroy(&plan->bank);
    hada_hadamard_destroy(&plan->stage);
    hada_slot_destroy(&plan->slot);
    hada_image_destroy(&plan->dark_frame);
    free(plan->depths);
    free(plan->distances);
    free(plan->listed);
    free(plan->occupied);
    free(plan->levels);
    free(plan);
}
