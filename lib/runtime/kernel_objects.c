/* The kernel objects of a slot: room for them, and their end. */
#include <stdlib.h>

#include "core/alloc.h"
#include "runtime/launch.h"

hada_status hada_kernel_objects_create(hada_slot *slot, hada_error *err)
{
    return hada_allocated(slot->kernels =
                              hada_alloc((size_t)hada_kernel_object_count, sizeof *slot->kernels, "a queue slot", err));
}

void hada_kernel_objects_destroy(hada_slot *slot)
{
    for (int i = 0; slot->kernels && i < hada_kernel_object_count; i++) {
        if (slot->kernels[i].cl)
            clReleaseKernel(slot->kernels[i].cl);
        free(slot->kernels[i].args);
    }
    free(slot->kernels);
    slot->kernels = NULL;
}
