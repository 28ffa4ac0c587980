/* The constants of a device: filters, transfer functions; what it shares for surfaces and volumes. */
#include "engine/constants.h"

static hada_status create_on_demand(hada_on_demand **out, hada_error *err)
{
    HADA_TRY(HADA_NEW(*out, 1, "a plan", err));
    pthread_mutex_init(&(*out)->lock, NULL);
    return HADA_OK;
}

static void destroy_on_demand(hada_on_demand **pointer)
{
    hada_on_demand *all = hada_taken(pointer);
    if (!all)
        return;
    hada_magnification_free(&all->law);
    hada_buffer_destroy(&all->optics);
    hada_classic_camera_free(&all->camera);
    pthread_mutex_destroy(&all->lock);
    free(all);
}

uint64_t hada_on_demand_bytes(hada_on_demand *all)
{
    pthread_mutex_lock(&all->lock);
    const uint64_t bytes =
        (uint64_t)all->surfaces * all->surface_bytes + all->optics.bytes + (uint64_t)all->volumes * all->volume_bytes;
    pthread_mutex_unlock(&all->lock);
    return bytes;
}

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
        "%s takes %d: compute fewer depths (options.depths), or use linear filters (options.refine 0)",
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
    HADA_TRY_OR_DONE(HADA_NEW(constants, 1, "a plan", err));
    constants->context = context;
    HADA_TRY_OR_DONE(create_on_demand(&constants->on_demand, err));
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
    if (config->measured)
        HADA_TRY_OR_DONE(hada_gains_upload(&constants->gains, slot, setup->gains, &layout,
                                           hada_model_get_info(model)->channels, err));
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
    hada_constants *constants = hada_taken(pointer);
    if (!constants)
        return;
    HADA_DESTROY_BUFFERS(&constants->prior, &constants->gains, &constants->optics);
    hada_bank_destroy(&constants->bank);
    destroy_on_demand(&constants->on_demand);
    free(constants);
}
