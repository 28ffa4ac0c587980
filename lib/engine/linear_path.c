/* The linear path: every depth's filter on the frame's spectrum, in batches. The focus takes the planes near to far,
 * whoever computed them, so that its bits do not depend on that. */
#include <string.h>

#include "dispatch/batches.h"
#include "runtime/kernel.h"

/* Light is not negative. */
static hada_status clip(hada_lane *lane, size_t count, hada_error *err)
{
    cl_kernel kernel;
    const size_t local = 64, global = (count + 8 * local - 1) / (8 * local) * local;
    const cl_ulong offset = 0, values = count;
    hada_status status = hada_slot_kernel(lane->slot, "image_clip", "image_clip", "", &kernel, err);
    hada_arg args[] = {HADA_ARG(lane->planes.mem), HADA_ARG(offset), HADA_ARG(values)};
    hada_slot_cost(lane->slot, 8.0 * (double)count, (double)count);
    if (!status)
        status = hada_slot_launch(lane->slot, kernel, "image_clip", 1, &global, &local, args, HADA_COUNT(args), err);
    return status;
}

/* Planes of depths first ... first + count - 1 into lane->planes. */
static hada_status compute(hada_lane *lane, const hada_task *task, int first, int count, hada_error *err)
{
    const size_t plane = hada_plane_values(hada_model_get_info(lane->plan->model));
    hada_slot_stage(lane->slot, "linear");
    hada_lane_skip_apply(lane, task);
    hada_status status = hada_task_skip_dense(task) ? hada_lane_skip_dense(lane, first, count, err)
                                                    : hada_hadamard_run(lane->stage, lane->share->bank, first, count,
                                                                        lane->planes.mem, 0, err);
    return status ? status : clip(lane, plane * (size_t)count, err);
}

static hada_status read_planes(hada_lane *lane, hada_task *task, int first, int count, hada_error *err)
{
    const size_t bytes = hada_plane_values(hada_model_get_info(lane->plan->model)) * sizeof(float);
    hada_status status = HADA_OK;
    hada_slot_stage(lane->slot, "download");
    for (int i = 0; !status && i < count; i++)
        status = hada_buffer_read(&lane->planes, lane->slot, (size_t)i * bytes, task->result->planes[first + i].data,
                                  bytes, err);
    return status;
}

/* Planes that a helper left in the result come into lane->planes. */
static hada_status write_planes(hada_lane *lane, hada_task *task, int first, int count, hada_error *err)
{
    const size_t bytes = hada_plane_values(hada_model_get_info(lane->plan->model)) * sizeof(float);
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < count; i++)
        status = hada_buffer_write(&lane->planes, lane->slot, (size_t)i * bytes, task->result->planes[first + i].data,
                                   bytes, err);
    return status;
}

static hada_status push(hada_lane *lane, hada_task *task, int first, int count, hada_error *err)
{
    hada_slot_stage(lane->slot, "focus");
    hada_status status = hada_focus_push(lane->focus, first, count, lane->planes.mem, 0, err);
    return status ? status : hada_lane_watch(lane, task, &task->result->report.seconds_focus, err);
}

/* A batch that the lane took itself; *next moves on where the focus could take it at once. */
static hada_status own_batch(hada_lane *lane, hada_task *task, int first, int count, int *next, hada_error *err)
{
    hada_report *report = &task->result->report;
    hada_status status = compute(lane, task, first, count, err);
    if (!status)
        status = hada_lane_watch(lane, task, &report->seconds_linear, err);
    if (!status)
        status = hada_lane_enhance(lane, task, lane->planes.mem, count, err);
    if (!status)
        status = hada_lane_watch(lane, task, &report->seconds_enhance, err);
    if (!status && first == *next) {
        status = push(lane, task, first, count, err);
        *next += count;
    }
    if (!status)
        status = read_planes(lane, task, first, count, err);
    hada_batches_put(task, lane, first, count, status ? HADA_DEPTH_FREE : HADA_DEPTH_HOME);
    return status ? status : hada_lane_watch(lane, task, &report->seconds_download, err);
}

static hada_status helpers_batch(hada_lane *lane, hada_task *task, int count, int *next, hada_error *err)
{
    count = count < lane->batch ? count : lane->batch;
    hada_status status = write_planes(lane, task, *next, count, err);
    if (!status)
        status = push(lane, task, *next, count, err);
    *next += count;
    return status;
}

static hada_status all_batches(hada_lane *lane, hada_task *task, hada_error *err)
{
    const unsigned char *occupied = task->result->report.occupied;
    hada_status status = HADA_OK;
    for (int next = 0; !status && next < lane->plan->shape.depths;) {
        int first, count;
        if (!occupied[next])
            next++;
        else if ((count = hada_batches_home(task, next, 0)))
            status = helpers_batch(lane, task, count, &next, err);
        else if ((count = hada_batches_take(task, lane, 0, &first)))
            status = own_batch(lane, task, first, count, &next, err);
        else
            hada_batches_home(task, next, 1);
    }
    return status;
}

static hada_status all_planes(hada_lane *lane, hada_task *task, hada_error *err)
{
    const unsigned char *occupied = task->result->report.occupied;
    hada_status status = hada_focus_begin(lane->focus, occupied, err);
    if (status)
        return status;
    hada_batches_open(task, occupied);
    status = all_batches(lane, task, err);
    hada_batches_close(task);
    return status;
}

hada_status hada_lane_linear(hada_lane *lane, hada_task *task, hada_error *err)
{
    hada_result *result = task->result;
    hada_report *report = &result->report;
    for (int z = 0; z < result->depths; z++) {
        report->occupied[z] = lane->plan->listed[z];
        report->occupied_count += report->occupied[z];
        if (!report->occupied[z]) /* the user knows that nothing is there */
            memset(result->planes[z].data, 0, hada_image_count(&result->planes[z]) * sizeof(float));
    }
    hada_status status = all_planes(lane, task, err);
    while (!status && hada_task_skip_again(task))
        status = all_planes(lane, task, err);
    return status ? status : hada_lane_pictures(lane, task, err);
}

int hada_lane_helps(const hada_lane *lane, const hada_lane *owner)
{
    return lane->share != owner->share;
}

hada_status hada_lane_help(hada_lane *lane, hada_task *task, hada_error *err)
{
    int first;
    const int count = hada_batches_take(task, lane, 1, &first);
    if (!count)
        return HADA_OK;
    hada_status status = hada_lane_ready(lane, err);
    if (!status) {
        lane->slot->stop = &task->cancelled;
        status = hada_lane_expose(lane, task, err);
        if (!status)
            status = compute(lane, task, first, count, err);
        if (!status)
            status = hada_lane_enhance(lane, task, lane->planes.mem, count, err);
        if (!status)
            status = read_planes(lane, task, first, count, err);
        if (status)
            hada_lane_stumble(lane);
        lane->slot->stop = NULL;
    }
    hada_batches_put(task, lane, first, count, status ? HADA_DEPTH_FREE : HADA_DEPTH_HOME);
    return status;
}
