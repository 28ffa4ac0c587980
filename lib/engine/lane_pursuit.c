/* Which depths a frame occupies: the pursuit, fed from a model. */
#include <stdlib.h>

#include "core/alloc.h"
#include "engine/pipeline.h"
#include "filter/layout.h"

/* sum |X|^2 of the pairs of each computed depth, as far as the model keeps it: the mean scene times the pairs. */
static hada_status set_power(hada_lane *lane, hada_error *err)
{
    const hada_plan *plan = lane->plan;
    const hada_model *model = plan->model;
    const hada_spectrum_layout *layout = &lane->share->bank->layout;
    const size_t channels = (size_t)hada_model_get_info(model)->channels, rows = hada_model_plane(model);
    float *scaled = NULL, *packed = NULL;
    hada_buffer buffer = {0};
    if (!model->scene_power || !model->pairs)
        return HADA_OK; /* measured transfer functions are exact */
    hada_status status = hada_alloc_raw((void **)&scaled, rows, sizeof(float), "the scenes' power", err);
    if (!status)
        status = hada_alloc((void **)&packed, channels * layout->count, sizeof(float), "the scenes' power", err);
    if (!status)
        status = hada_buffer_create(&buffer, lane->share->context, channels * layout->count * sizeof(float),
                                    "the scenes' power", err);
    for (int z = 0; !status && z < plan->shape.depths; z++) {
        for (size_t i = 0; i < rows; i++)
            scaled[i] = (float)(model->scene_power[i] * model->pairs[plan->depths[z]]);
        for (size_t channel = 0; channel < channels; channel++)
            hada_layout_pack_real(layout, scaled, packed + channel * layout->count);
        status = hada_buffer_write(&buffer, lane->slot, 0, packed, buffer.bytes, err);
        if (!status)
            status = hada_pursuit_set_power(lane->pursuit, z, 1, buffer.mem, 0, err);
        if (!status)
            status = hada_slot_finish(lane->slot, err);
    }
    hada_buffer_destroy(&buffer);
    free(scaled);
    free(packed);
    return status;
}

hada_status hada_lane_make_pursuit(hada_lane *lane, hada_error *err)
{
    const hada_plan *plan = lane->plan;
    const hada_pursuit_options options = hada_plan_pursuit_of(plan->model, &plan->shape);
    size_t offset;
    cl_mem otf = hada_share_otf(lane->share, &offset);
    hada_status status = hada_pursuit_create(&lane->pursuit, lane->slot, &options, err);
    if (!status)
        status = hada_pursuit_set_otf(lane->pursuit, 0, plan->shape.depths, otf, offset, err);
    if (!status && lane->share->prior.mem)
        status = hada_pursuit_set_prior(lane->pursuit, lane->share->prior.mem, err);
    return status ? status : set_power(lane, err);
}

hada_status hada_lane_pursue(hada_lane *lane, hada_task *task, int *count, hada_error *err)
{
    const int depths = lane->plan->shape.depths;
    hada_pursuit_result found;
    hada_slot_stage(lane->slot, "pursuit");
    hada_status status = hada_pursuit_run(lane->pursuit, lane->stage->spectrum.mem, 0, &found, err);
    if (status)
        return status;
    *count = found.all ? depths : found.count;
    for (int i = 0; i < *count; i++)
        lane->occupied[i] = found.all ? i : found.list[i];
    hada_task_progress(task, 1 + HADA_WORK_PURSUIT);
    return hada_lane_watch(lane, task, &task->result->report.seconds_pursuit, err);
}
