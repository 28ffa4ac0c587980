#include "filter/clip.h"

#include "runtime/kernel.h"

hada_status hada_image_clip(hada_slot *slot, cl_mem planes, size_t count, hada_error *err)
{
    const cl_ulong offset = 0, values = count;
    const size_t local = 64, global = (count + 8 * local - 1) / (8 * local) * local;
    const hada_arg args[] = {HADA_ARG(planes), HADA_ARG(offset), HADA_ARG(values)};
    cl_kernel kernel;
    hada_status status = hada_slot_kernel(slot, "image_clip", "image_clip", "", &kernel, err);
    hada_slot_cost(slot, 8.0 * (double)count, (double)count);
    return status ? status
                  : hada_slot_launch(slot, kernel, "image_clip", 1, &global, &local, args, HADA_COUNT(args), err);
}
