/* Which depths a frame occupies: the pursuit, fed from a model. */
#include <stdlib.h>

#include "core/alloc.h"
#include "filter/layout.h"
#include "sched/plan.h"

hada_pursuit_options hada_plan_pursuit_of(const hada_model *model, int depths)
{
    const hada_model_info *info = hada_model_get_info(model);
    hada_pursuit_options options;
    hada_pursuit_options_init(&options);
    options.shape = hada_refine_shape_of(info, depths, 1);
    options.depths = depths;
    options.rho *= hada_model_gain(model);
    return options;
}

/* sum |X|^2 of the pairs of each computed depth, as far as the model keeps it: the mean scene times the pairs. */
static hada_status set_power(hada_plan *plan, hada_error *err)
{
    const hada_model *model = plan->model;
    const hada_spectrum_layout *layout = &plan->bank->layout;
    const size_t channels = (size_t)hada_model_get_info(model)->channels, rows = hada_model_plane(model);
    float *scaled = NULL, *packed = NULL;
    hada_buffer buffer = {0};
    if (!model->scene_power || !model->pairs)
        return HADA_OK; /* measured transfer functions are exact */
    hada_status status = hada_alloc_raw((void **)&scaled, rows, sizeof(float), "the scenes' power", err);
    if (!status)
        status = hada_alloc((void **)&packed, channels * layout->count, sizeof(float), "the scenes' power", err);
    if (!status)
        status = hada_buffer_create(&buffer, plan->context, channels * layout->count * sizeof(float),
                                    "the scenes' power", err);
    for (int z = 0; !status && z < plan->shape.depths; z++) {
        for (size_t i = 0; i < rows; i++)
            scaled[i] = (float)(model->scene_power[i] * model->pairs[plan->depths[z]]);
        for (size_t channel = 0; channel < channels; channel++)
            hada_layout_pack_real(layout, scaled, packed + channel * layout->count);
        status = hada_buffer_write(&buffer, plan->slot, 0, packed, buffer.bytes, err);
        if (!status)
            status = hada_pursuit_set_power(plan->pursuit, z, 1, buffer.mem, 0, err);
        if (!status)
            status = hada_slot_finish(plan->slot, err);
    }
    hada_buffer_destroy(&buffer);
    free(scaled);
    free(packed);
    return status;
}

hada_status hada_plan_make_pursuit(hada_plan *plan, hada_error *err)
{
    const hada_pursuit_options options = hada_plan_pursuit_of(plan->model, plan->shape.depths);
    size_t first;
    int together;
    cl_mem otf = hada_bank_otf(plan->bank, 0, &first, &together);
    hada_status status = hada_pursuit_create(&plan->pursuit, plan->slot, &options, err);
    if (!status)
        status = hada_pursuit_set_otf(plan->pursuit, 0, plan->shape.depths, otf, first * plan->bank->layout.count, err);
    if (!status && plan->prior.mem)
        status = hada_pursuit_set_prior(plan->pursuit, plan->prior.mem, err);
    return status ? status : set_power(plan, err);
}

hada_status hada_plan_find_occupied(hada_plan *plan, int *count, hada_error *err)
{
    hada_pursuit_result found;
    hada_status status = hada_pursuit_run(plan->pursuit, plan->stage->spectrum.mem, 0, &found, err);
    if (status)
        return status;
    *count = found.all ? plan->shape.depths : found.count;
    for (int i = 0; i < *count; i++)
        plan->occupied[i] = found.all ? i : found.list[i];
    return HADA_OK;
}
