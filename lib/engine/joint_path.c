/* The refined path: the occupied depths, whose planes explain the frame jointly, by refinement or by a classic method.
 */
#include <math.h>
#include <string.h>

#include "engine/pipeline.h"

hada_refine_data hada_lane_refine_data(const hada_lane *lane)
{
    hada_refine_data data = {.spectrum = lane->stage->spectrum.mem,
                             .frame = lane->stage->raw.mem,
                             .otf_depths = lane->plan->shape.depths,
                             .prior = lane->share->prior.mem};
    data.otf = hada_share_otf(lane->share, &data.otf_offset);
    return data;
}

/* energy: of the frame */
static hada_refine_rule rule_of(const hada_plan *plan, double energy)
{
    const hada_model_info *info = hada_model_get_info(plan->model);
    hada_refine_rule rule;
    hada_refine_rule_init(&rule);
    rule.steps = plan->shape.steps;
    hada_refine_rule_weigh(&rule, info, plan->shape.tv, hada_model_gain(plan->model),
                           energy / ((double)info->channels * info->raw_rows * info->raw_cols));
    rule.stop = plan->options.refine < 0 ? hada_refine_stop(info->boundary, rule.tv) : 0;
    return rule;
}

static hada_status refine(hada_lane *lane, hada_task *task, int count, hada_error *err)
{
    hada_report *report = &task->result->report;
    const hada_refine_data data = hada_lane_refine_data(lane);
    const hada_refine_rule rule = rule_of(lane->plan, task->energy);
    double left = 0;
    hada_slot_stage(lane->slot, "refine");
    hada_status status =
        hada_refiner_run(lane->refiner, &data, &rule, 1, count, lane->occupied, &report->refine_steps, err);
    if (!status)
        status = hada_refiner_residual(lane->refiner, &data, 1, count, lane->occupied, &left, err);
    if (!status && task->energy > 0) {
        report->residual = sqrt(left / task->energy);
        /* the first step is the joint linear filter; what it left is met in the second */
        if (hada_model_get_info(lane->plan->model)->boundary == HADA_BOUNDARY_CIRCULAR && report->refine_steps > 1)
            report->residual_linear = sqrt(hada_refiner_energy(lane->refiner, 0, 1) / task->energy);
    }
    hada_task_progress(task, task->work - 1);
    return status ? status : hada_lane_watch(lane, task, &report->seconds_refine, err);
}

static cl_mem planes_of(const hada_lane *lane)
{
    return lane->classic ? hada_classic_planes(lane->classic) : hada_refiner_planes(lane->refiner);
}

/* The planes stand in the order of lane->occupied. */
static hada_status focus(hada_lane *lane, hada_task *task, int count, hada_error *err)
{
    hada_slot_stage(lane->slot, "focus");
    hada_status status = hada_focus_begin(lane->focus, task->result->report.occupied, err);
    if (!status)
        status = hada_focus_push_list(lane->focus, lane->occupied, count, planes_of(lane), 0, err);
    return status ? status : hada_lane_pictures(lane, task, err);
}

static hada_status read_planes(hada_lane *lane, hada_task *task, int count, hada_error *err)
{
    const size_t bytes = hada_plane_values(hada_model_get_info(lane->plan->model)) * sizeof(float);
    for (int place = 0; place < count; place++) {
        const cl_int code =
            clEnqueueReadBuffer(lane->slot->queue, planes_of(lane), CL_TRUE, (size_t)place * bytes, bytes,
                                task->result->planes[lane->occupied[place]].data, 0, NULL, hada_slot_event(lane->slot));
        if (code != CL_SUCCESS)
            return hada_fail_cl(err, code, "clEnqueueReadBuffer");
        hada_slot_moved(lane->slot, "read", (double)bytes);
    }
    return HADA_OK;
}

/* A frame that no depth explains: everything dark, no distance anywhere. */
static void nothing_there(hada_result *result)
{
    memset(result->all_in_focus.data, 0, hada_image_count(&result->all_in_focus) * sizeof(float));
    for (size_t i = 0; i < hada_image_count(&result->distance_map); i++)
        result->distance_map.data[i] = NAN;
}

/* What is not occupied is dark. */
static void clear_planes(hada_lane *lane, hada_task *task, int count)
{
    hada_result *result = task->result;
    hada_report *report = &result->report;
    memset(report->occupied, 0, (size_t)result->depths);
    for (int i = 0; i < count; i++)
        report->occupied[lane->occupied[i]] = 1;
    report->occupied_count = count;
    for (int z = 0; z < result->depths; z++)
        if (!report->occupied[z])
            memset(result->planes[z].data, 0, hada_image_count(&result->planes[z]) * sizeof(float));
}

static int take_listed(hada_lane *lane)
{
    int count = 0;
    for (int z = 0; z < lane->plan->shape.depths; z++)
        if (lane->plan->listed[z])
            lane->occupied[count++] = z;
    return count;
}

hada_status hada_lane_refined(hada_lane *lane, hada_task *task, hada_error *err)
{
    int count = 0;
    hada_status status = HADA_OK;
    if (lane->plan->shape.pursuit)
        status = hada_lane_pursue(lane, task, &count, err);
    else
        count = take_listed(lane);
    if (status)
        return status;
    clear_planes(lane, task, count);
    if (!count) {
        nothing_there(task->result);
        return HADA_OK;
    }
    status = lane->classic ? hada_lane_classic(lane, task, count, err) : refine(lane, task, count, err);
    if (!status)
        status = hada_lane_enhance(lane, task, planes_of(lane), count, err);
    if (!status)
        status = hada_lane_watch(lane, task, &task->result->report.seconds_enhance, err);
    if (!status)
        status = focus(lane, task, count, err);
    return status ? status : read_planes(lane, task, count, err);
}
