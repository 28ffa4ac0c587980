/* The filters, transfer functions and prior of a model on a device. */
#include "engine/constants.h"

#include <stdlib.h>

#include "core/alloc.h"
#include "filter/hadamard.h"

cl_mem hada_share_otf(const hada_share *share, size_t *offset)
{
    size_t first;
    int together;
    *offset = 0;
    if (share->optics.mem)
        return share->optics.mem;
    const cl_mem otf = hada_bank_otf(share->bank, 0, &first, &together);
    *offset = first * share->bank->layout.count;
    return otf;
}

/* A classic method may have transfer functions of its own in place of the model's. */
static int has_optics(const hada_plan_shape *shape)
{
    return shape->classic && hada_classic_has_optics(&shape->method);
}

static hada_status check_together(const hada_share *share, hada_error *err)
{
    size_t first;
    int together;
    hada_bank_otf(share->bank, 0, &first, &together);
    if (together == share->bank->depths)
        return HADA_OK;
    return hada_fail(
        err, HADA_ERROR_DEVICE_MEMORY,
        "planes that explain the frame jointly need the transfer functions of %d depths in one buffer, and "
        "%s takes %d: compute fewer depths (--depths), or use linear filters (--refine 0)",
        share->bank->depths, share->context->info.name, together);
}

hada_status hada_share_create(hada_share **out, hada_context *context, const hada_model *model,
                              const hada_plan_shape *shape, const int *depths, const hada_gains *gains, hada_error *err)
{
    hada_share *share;
    hada_slot *slot = NULL;
    const hada_spectrum_layout layout = hada_hadamard_layout(context, hada_model_get_info(model));
    *out = NULL;
    hada_status status = hada_alloc((void **)&share, 1, sizeof *share, "a plan", err);
    if (status)
        return status;
    share->context = context;
    status = hada_slot_create(&slot, context, err);
    if (!status)
        status = hada_bank_create(&share->bank, slot, model, &layout, depths, shape->depths,
                                  has_optics(shape) ? 0 : shape->parts, shape->half, err);
    if (!status && has_optics(shape))
        status = hada_classic_optics(&share->optics, context, &shape->method, model, depths, shape->depths, err);
    else if (!status && shape->refined)
        status = check_together(share, err);
    if (!status && shape->refined && !shape->classic)
        status = hada_bank_prior(&share->prior, slot, model, &layout, err);
    if (!status && gains)
        status = hada_gains_upload(gains, &layout, slot, &share->gains, err);
    /* other queues read what this one wrote */
    if (!status)
        status = hada_slot_finish(slot, err);
    hada_slot_destroy(&slot);
    if (status)
        hada_share_destroy(&share);
    *out = share;
    return status;
}

void hada_share_destroy(hada_share **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_share *share = *pointer;
    *pointer = NULL;
    hada_buffer_destroy(&share->prior);
    hada_buffer_destroy(&share->gains);
    hada_buffer_destroy(&share->optics);
    hada_bank_destroy(&share->bank);
    free(share);
}

uint64_t hada_share_bytes(const hada_context *context, const hada_model *model, const hada_plan_shape *shape)
{
    const hada_model_info *info = hada_model_get_info(model);
    const hada_spectrum_layout layout = hada_hadamard_layout(context, info);
    uint64_t bytes = has_optics(shape) ? hada_classic_optics_bytes(context, &shape->method, shape->depths)
                                       : hada_bank_bytes(info, &layout, shape->depths, shape->parts, shape->half);
    if ((shape->refined && !shape->classic && model->scene_power) || shape->measured)
        bytes += 4 * (uint64_t)info->channels * (uint64_t)layout.count;
    return bytes;
}
