/* One frame, in the caller's thread. */
#include "sched/lane.h"

hada_status hada_plan_run(hada_plan *plan, const hada_image *raw, hada_result *result, hada_error *err)
{
    hada_task task;
    if (!plan || !raw || !raw->data || !result)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_plan_run: a plan, a frame and a result are needed");
    hada_status status = hada_task_begin(&task, plan, raw, result, err);
    if (status)
        return status;
    status = hada_lane_run(plan->lane, &task, err);
    hada_task_end(&task, status);
    return status;
}
