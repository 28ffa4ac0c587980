#include "optics/accumulate.h"

#include <limits.h>

#include "runtime/kernel.h"

#define LOCAL 64 /* items in a work-group, of four complex numbers each */

hada_status hada_optics_accumulate(hada_slot *slot, cl_mem sum, size_t sum_offset, cl_mem otf, int otf_images,
                                   cl_mem scene, int images, size_t count, int add, hada_error *err)
{
    if (count > INT_MAX)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "spectra of %zu values are too large for one image", count);
    cl_kernel kernel;
    hada_status status = hada_slot_kernel(slot, "optics_accumulate", "optics_accumulate", "", &kernel, err);
    if (status)
        return status;
    const int values = (int)count;
    const cl_ulong offset = sum_offset;
    const size_t local[2] = {LOCAL, 1}, global[2] = {((count + 3) / 4 + LOCAL - 1) / LOCAL * LOCAL, (size_t)images};
    const hada_arg args[] = {HADA_ARG(sum),    HADA_ARG(offset),     HADA_ARG(otf), HADA_ARG(scene),
                             HADA_ARG(values), HADA_ARG(otf_images), HADA_ARG(add)};
    hada_slot_cost(slot, 8.0 * (double)count * (otf_images + (add ? 3.0 : 2.0) * images), 8.0 * (double)count * images);
    return hada_slot_launch(slot, kernel, "optics_accumulate", 2, global, local, args, HADA_COUNT(args), err);
}
