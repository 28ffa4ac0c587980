/* A frame by a classic method. */
#include <math.h>

#include "engine/pipeline.h"

static void progress(void *user, int iterations)
{
    hada_task_progress(user, 1 + iterations);
}

hada_status hada_lane_classic(hada_lane *lane, hada_task *task, int count, hada_error *err)
{
    hada_report *report = &task->result->report;
    const hada_refine_data data = hada_lane_refine_data(lane);
    const double values = (double)hada_image_count(task->raw);
    const hada_classic_job job = {.data = &data,
                                  .camera = &lane->plan->camera,
                                  .depths = count,
                                  .list = lane->occupied,
                                  .brightness = sqrt(task->energy / values),
                                  .progress = progress,
                                  .user = task};
    hada_classic_result result;
    hada_slot_stage(lane->slot, "refine");
    hada_status status = hada_classic_run(lane->classic, &job, &result, err);
    if (!status) {
        report->method = lane->plan->shape.method.options.method;
        report->refine_steps = result.iterations;
        if (task->energy > 0)
            report->residual = sqrt(result.energy / task->energy);
    }
    hada_task_progress(task, task->work - 1);
    return status ? status : hada_lane_watch(lane, task, &report->seconds_refine, err);
}
