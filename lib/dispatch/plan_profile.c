/* Profiling of a plan: that of its lanes. */
#include <hadalens/profile.h>
#include <stdlib.h>

#include "engine/pipeline.h"
#include "runtime/profile.h"

hada_status hada_plan_profile(hada_plan *plan, int on, hada_error *err)
{
    if (!plan)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_plan_profile: a plan is needed");
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < plan->lane_count; i++)
        if (plan->lanes[i]->slot)
            status = hada_slot_profile(plan->lanes[i]->slot, on, err);
    return status;
}

/* A lane that was lost, or made again since, has no profile. */
hada_status hada_plan_kernel_times(hada_plan *plan, hada_kernel_time **rows, size_t *count, hada_error *err)
{
    if (!plan || !rows || !count)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_plan_kernel_times: plan, rows and count are needed");
    *rows = NULL;
    *count = 0;
    hada_status status = HADA_OK;
    int found = 0;
    for (int i = 0; !status && i < plan->lane_count; i++) {
        hada_slot *slot = plan->lanes[i]->slot;
        if (slot && slot->profile)
            status = hada_slot_times(slot, rows, count, err);
        found |= slot && slot->profile;
    }
    if (!status && !found)
        status = hada_fail(err, HADA_ERROR_STATE, "profiling of the plan is off; turn it on with hada_plan_profile()");
    if (status) {
        free(*rows);
        *rows = NULL;
        *count = 0;
    }
    return status;
}
