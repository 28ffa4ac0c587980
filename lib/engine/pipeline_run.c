/* The way of a frame through a lane. */
#include "core/clock.h"
#include "engine/pipeline.h"
#include "engine/result.h"

hada_status hada_lane_watch(hada_lane *lane, hada_task *task, double *seconds, hada_error *err)
{
    const hada_status status = hada_slot_finish(lane->slot, err);
    const double now = hada_seconds();
    *seconds += now - task->watch;
    task->watch = now;
    return status;
}

hada_status hada_lane_upload(hada_lane *lane, hada_task *task, hada_error *err)
{
    hada_slot_stage(lane->slot, "upload");
    hada_status status = hada_task_prepare(task, err);
    if (!status)
        status = hada_lane_expose(lane, task, err);
    if (!status)
        status = hada_lane_skip_frequencies(lane, task, err);
    hada_task_progress(task, 1);
    return status ? status : hada_lane_watch(lane, task, &task->result->report.seconds_upload, err);
}

hada_status hada_lane_expose(hada_lane *lane, hada_task *task, hada_error *err)
{
    if (lane->holds == task->serial)
        return HADA_OK;
    lane->holds = 0;
    hada_lane_skip_apply(lane, task);
    hada_status status = hada_hadamard_frame(lane->stage, hada_task_frame(task)->data, task->levels, err);
    if (!status)
        lane->holds = task->serial;
    return status;
}

hada_status hada_lane_pictures(hada_lane *lane, hada_task *task, hada_error *err)
{
    hada_result *result = task->result;
    const size_t plane = hada_image_count(&result->all_in_focus), map = hada_image_count(&result->distance_map);
    hada_slot_stage(lane->slot, "focus");
    hada_status status = hada_focus_finish(lane->focus, lane->pictures.mem, 0, lane->pictures.mem, plane, NULL, err);
    if (!status)
        status = hada_lane_watch(lane, task, &result->report.seconds_focus, err);
    hada_slot_stage(lane->slot, "download");
    if (!status)
        status =
            hada_buffer_read(&lane->pictures, lane->slot, 0, result->all_in_focus.data, plane * sizeof(float), err);
    if (!status)
        status = hada_buffer_read(&lane->pictures, lane->slot, plane * sizeof(float), result->distance_map.data,
                                  map * sizeof(float), err);
    return status;
}

static hada_status run(hada_lane *lane, hada_task *task, hada_error *err)
{
    hada_status status = hada_lane_ready(lane, err);
    if (status)
        return status;
    lane->slot->stop = &task->cancelled;
    status = hada_lane_upload(lane, task, err);
    if (!status)
        status = lane->plan->shape.refined ? hada_lane_refined(lane, task, err) : hada_lane_linear(lane, task, err);
    if (!status)
        status = hada_task_check(task, err);
    if (!status)
        hada_task_skip_report(task);
    if (!status)
        hada_result_apply_gamma(task->result, lane->plan->options.gamma);
    if (!status)
        status = hada_lane_watch(lane, task, &task->result->report.seconds_download, err);
    if (status)
        hada_lane_stumble(lane);
    lane->slot->stop = NULL;
    task->result->report.seconds_total = hada_seconds() - task->start;
    return status;
}

void hada_lane_stumble(hada_lane *lane)
{
    hada_slot_finish(lane->slot, NULL);
    lane->holds = 0;
}

hada_status hada_lane_run(hada_lane *lane, hada_task *task, hada_error *err)
{
    hada_error error = {0};
    hada_status status;
    if (hada_frames_reuse(task, &status, err))
        return status;
    hada_frames_begin(task);
    status = run(lane, task, &error);
    while (status == HADA_ERROR_DEVICE_MEMORY && !lane->plan->shape.refined && lane->batch > 1) {
        lane->batch = (lane->batch + 1) / 2;
        hada_log(lane->share->context, HADA_LOG_WARNING, "%s; trying again with batches of %d depths", error.message,
                 lane->batch);
        hada_lane_clear(lane);
        status = run(lane, task, &error);
    }
    hada_frames_done(task, status);
    if (status && err)
        *err = error;
    return status;
}
