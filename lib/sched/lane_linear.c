/* The linear path: every depth's filter on the frame's spectrum, in batches. */
#include <string.h>

#include "program/kernel.h"
#include "sched/lane.h"

/* Light is not negative. */
static hada_status clip(hada_lane *lane, size_t count, hada_error *err)
{
    cl_kernel kernel;
    const size_t local = 64, global = (count + 8 * local - 1) / (8 * local) * local;
    const cl_ulong offset = 0, values = count;
    hada_status status = hada_slot_kernel(lane->slot, "sched_clip", "sched_clip", "", &kernel, err);
    hada_arg args[] = {HADA_ARG(lane->planes.mem), HADA_ARG(offset), HADA_ARG(values)};
    if (!status)
        status = hada_slot_launch(lane->slot, kernel, "sched_clip", 1, &global, &local, args, HADA_COUNT(args), err);
    return status;
}

/* Planes of depths first ... first + count - 1 into lane->planes. */
static hada_status compute(hada_lane *lane, int first, int count, hada_error *err)
{
    const size_t plane = hada_plane_values(hada_model_get_info(lane->plan->model));
    hada_status status = hada_hadamard_run(lane->stage, lane->share->bank, first, count, lane->planes.mem, 0, err);
    return status ? status : clip(lane, plane * (size_t)count, err);
}

static hada_status read_planes(hada_lane *lane, hada_task *task, int first, int count, hada_error *err)
{
    hada_result *result = task->result;
    const size_t bytes = hada_plane_values(hada_model_get_info(lane->plan->model)) * sizeof(float);
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < count; i++) {
        float *plane = result->planes[first + i].data;
        if (result->report.occupied[first + i])
            status = hada_buffer_read(&lane->planes, lane->slot, (size_t)i * bytes, plane, bytes, err);
        else /* the user knows that nothing is there */
            memset(plane, 0, bytes);
    }
    return status;
}

hada_status hada_lane_linear(hada_lane *lane, hada_task *task, hada_error *err)
{
    const hada_plan_shape *shape = &lane->plan->shape;
    hada_report *report = &task->result->report;
    memcpy(report->occupied, lane->plan->listed, (size_t)shape->depths);
    for (int z = 0; z < shape->depths; z++)
        report->occupied_count += report->occupied[z];
    hada_status status = hada_focus_begin(lane->focus, report->occupied, err);
    for (int first = 0; !status && first < shape->depths; first += shape->batch) {
        const int left = shape->depths - first, count = left < shape->batch ? left : shape->batch;
        status = compute(lane, first, count, err);
        if (!status)
            status = hada_lane_watch(lane, task, &report->seconds_linear, err);
        if (!status)
            status = hada_focus_push(lane->focus, first, count, lane->planes.mem, 0, err);
        if (!status)
            status = hada_lane_watch(lane, task, &report->seconds_focus, err);
        if (!status)
            status = read_planes(lane, task, first, count, err);
        if (!status)
            status = hada_lane_watch(lane, task, &report->seconds_download, err);
    }
    return status ? status : hada_lane_pictures(lane, task, err);
}
