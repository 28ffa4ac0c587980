/* Making and unmaking plans. */
#include "dispatch/plan.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/options.h"
#include "dispatch/dispatcher.h"

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

/* The constants of the listed depths, and the grid of a method's transforms. */
static hada_status look_at_camera(hada_plan *plan, hada_context *context, hada_error *err)
{
    int *list, count = 0;
    hada_status status = hada_alloc((void **)&list, (size_t)plan->shape.depths, sizeof *list, "a plan", err);
    if (status)
        return status;
    for (int z = 0; z < plan->shape.depths; z++)
        if (plan->listed[z])
            list[count++] = plan->depths[z];
    status = hada_classic_camera_of(&plan->camera, plan->model, list, count, err);
    free(list);
    return status ? status
                  : hada_classic_fit_grid(&plan->shape.method, context, plan->model, plan->depths, plan->shape.depths,
                                          err);
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

static hada_status make_lanes(hada_plan *plan, hada_context *const *contexts, int count, hada_error *err)
{
    const int queues = plan->shape.queues;
    hada_status status = hada_alloc((void **)&plan->shares, (size_t)count, sizeof *plan->shares, "a plan", err);
    if (!status)
        status = hada_alloc((void **)&plan->lanes, (size_t)count * (size_t)queues, sizeof *plan->lanes, "a plan", err);
    for (int device = 0; !status && device < count; device++) {
        status = hada_share_create(&plan->shares[device], contexts[device], plan->model, &plan->shape, plan->depths,
                                   plan->skip.gains, err);
        if (status)
            break;
        hada_share *share = plan->shares[plan->share_count++];
        share->batch = hada_lane_batch(share->context, plan->model, &plan->shape, queues);
        for (int number = 0; !status && number < queues; number++) {
            status = hada_lane_create(&plan->lanes[plan->lane_count], plan, share, device, number, err);
            plan->lane_count += !status;
        }
        if (status && count * queues > 1)
            hada_error_prefix(err, "queue %d of device %d: ", plan->lane_count - device * queues, device);
    }
    return status ? status : hada_board_create(&plan->board, plan->lanes, plan->lane_count, err);
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
    hada_plan_options own, *options = &own;
    hada_plan *plan;
    if (!out || !model)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a plan needs out, context and model");
    *out = NULL;
    hada_plan_options_init(options);
    hada_status status = HADA_OPTIONS_TAKE(options, callers, hada_plan_options, err);
    if (!status)
        status = check_contexts(contexts, count, err);
    if (!status)
        status = hada_alloc((void **)&plan, 1, sizeof *plan, "a plan", err);
    if (status)
        return status;
    plan->model = model;
    hada_frames_make(&plan->frames);
    plan->options = *options;
    plan->options.depths = plan->options.occupied_list = NULL;
    plan->options.dark_frame = NULL;
    plan->options.classic = NULL;
    status = hada_plan_shape_of(model, options, &plan->shape, err);
    if (!status)
        status = make_lists(plan, options, err);
    if (!status && plan->shape.classic)
        status = look_at_camera(plan, contexts[0], err);
    if (!status && plan->shape.dark)
        status = copy_dark(plan, options->dark_frame, err);
    if (!status)
        status = hada_plan_skip_make(&plan->skip, contexts[0], model, &plan->shape, plan->depths, plan->listed,
                                     &plan->dark_frame, err);
    if (!status)
        status = make_lanes(plan, contexts, count, err);
    if (status)
        hada_plan_destroy(&plan);
    *out = plan;
    return status;
}

hada_status hada_plan_create(hada_plan **out, hada_context *context, const hada_model *model,
                             const hada_plan_options *options, hada_error *err)
{
    return hada_plan_create_on(out, &context, 1, model, options, err);
}

void hada_plan_destroy(hada_plan **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_plan *plan = *pointer;
    *pointer = NULL;
    if (plan->board)
        hada_board_stop(plan->board);
    for (int i = 0; i < plan->lane_count; i++)
        hada_lane_destroy(&plan->lanes[i]);
    for (int i = 0; i < plan->share_count; i++)
        hada_share_destroy(&plan->shares[i]);
    if (plan->board)
        hada_board_release(plan->board);
    hada_frames_free(&plan->frames);
    hada_plan_skip_free(&plan->skip);
    hada_image_destroy(&plan->dark_frame);
    hada_classic_camera_free(&plan->camera);
    free(plan->lanes);
    free(plan->shares);
    free(plan->depths);
    free(plan->distances);
    free(plan->listed);
    free(plan);
}
