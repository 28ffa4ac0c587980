/* Queue slots: made and unmade. */
#include "runtime/slot.h"

#include "runtime/launch.h"
#include "runtime/profile.h"

hada_status hada_slot_create(hada_slot **out, hada_context *context, hada_error *err)
{
    hada_slot *slot = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(slot, 1, "a queue slot", err));
    slot->context = context;
    if (!context->dry) {
        HADA_TRY_OR_DONE(HADA_NEW(slot->kernels, (size_t)hada_kernel_object_count, "a queue slot", err));
        HADA_TRY_OR_DONE(hada_slot_open(slot, 0, err));
    }
done:
    if (status)
        hada_slot_destroy(&slot);
    *out = slot;
    return status;
}

void hada_slot_destroy(hada_slot **pointer)
{
    hada_slot *slot = hada_taken(pointer);
    if (!slot)
        return;
    hada_slot_profile(slot, 0, NULL);
    if (slot->landmark)
        clReleaseEvent(slot->landmark);
    hada_slot_close(slot);
    for (int i = 0; slot->kernels && i < hada_kernel_object_count; i++) {
        if (slot->kernels[i].cl)
            clReleaseKernel(slot->kernels[i].cl);
        free(slot->kernels[i].args);
    }
    HADA_FREE(slot->kernels, slot);
}
