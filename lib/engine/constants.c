#include "engine/constants.h"

#include <stdlib.h>

#include "core/alloc.h"
#include "filter/hadamard.h"

cl_mem hada_constants_otf(const hada_constants *constants, size_t *offset)
{
    size_t first;
    int together;
    *offset = 0;
    if (constants->optics.mem)
        return constants->optics.mem;
    const cl_mem otf = hada_bank_otf(constants->bank, 0, &first, &together);
    *offset = first * constants->bank->layout.count;
    return otf;
}

/* A classic method may have transfer functions of its own in place of the model's. */
static int has_optics(const hada_config *config)
{
    return config->classic && hada_classic_has_optics(&config->method);
}

static hada_status check_together(const hada_constants *constants, hada_error *err)
{
    size_t first;
    int together;
    hada_bank_otf(constants->bank, 0, &first, &together);
    if (together == constants->bank->depths)
        return HADA_OK;
    return hada_fail(
        err, HADA_ERROR_DEVICE_MEMORY,
        "planes that explain the frame jointly need the transfer functions of %d depths in one buffer, and "
        "%s takes %d: compute fewer depths (--depths), or use linear filters (--refine 0)",
        constants->bank->depths, constants->context->info.name, together);
}

hada_status hada_constants_create(hada_constants **out, hada_context *context, const hada_setup *setup, hada_error *err)
{
    const hada_config *config = &setup->config;
    const hada_model *model = setup->model;
    const hada_spectrum_layout layout = hada_hadamard_layout(context, hada_model_get_info(model));
    hada_constants *constants = NULL;
    hada_slot *slot = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(constants = hada_alloc(1, sizeof *constants, "a plan", err)));
    constants->context = context;
    HADA_TRY_OR_DONE(hada_surfaces_create(&constants->surfaces, err));
    HADA_TRY_OR_DONE(hada_slot_create(&slot, context, err));
    HADA_TRY_OR_DONE(hada_bank_create(&constants->bank, slot, model, &layout, setup->depths, config->depths,
                                      has_optics(config) ? 0 : config->bank, config->half, err));
    if (has_optics(config))
        HADA_TRY_OR_DONE(hada_classic_optics(&constants->optics, context, &config->method, model, setup->depths,
                                             config->depths, err));
    else if (config->joint)
        HADA_TRY_OR_DONE(check_together(constants, err));
    if (config->joint && !config->classic)
        HADA_TRY_OR_DONE(hada_bank_prior(&constants->prior, slot, model, &layout, err));
    if (setup->gains)
        HADA_TRY_OR_DONE(hada_gains_upload(setup->gains, &layout, slot, &constants->gains, err));
    /* other queues read what this one wrote */
    HADA_TRY_OR_DONE(hada_slot_finish(slot, err));
done:
    hada_slot_destroy(&slot);
    if (status)
        hada_constants_destroy(&constants);
    *out = constants;
    return status;
}

void hada_constants_destroy(hada_constants **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_constants *constants = *pointer;
    *pointer = NULL;
    hada_buffer_destroy(&constants->prior);
    hada_buffer_destroy(&constants->gains);
    hada_buffer_destroy(&constants->optics);
    hada_bank_destroy(&constants->bank);
    hada_surfaces_destroy(&constants->surfaces);
    free(constants);
}

uint64_t hada_constants_bytes(const hada_context *context, const hada_model *model, const hada_config *config)
{
    const hada_model_info *info = hada_model_get_info(model);
    const hada_spectrum_layout layout = hada_hadamard_layout(context, info);
    uint64_t bytes = has_optics(config) ? hada_classic_optics_bytes(context, &config->method, config->depths)
                                        : hada_bank_bytes(info, &layout, config->depths, config->bank, config->half);
    if ((config->joint && !config->classic && model->scene_power) || config->measured)
        bytes += 4 * (uint64_t)info->channels * (uint64_t)layout.count;
    return bytes;
}
