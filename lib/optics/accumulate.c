#include "optics/accumulate.h"

#include <limits.h>

#include "launch/optics_accumulate.h"

#define LOCAL 64 /* items in a work-group, of four complex numbers each */

hada_status hada_optics_accumulate(hada_slot *slot, cl_mem sum, size_t sum_offset, cl_mem otf, int otf_images,
                                   cl_mem scene, int images, size_t count, int add, hada_error *err)
{
    if (count > INT_MAX)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "spectra of %zu values are too large for one image", count);
    const hada_range range = hada_range_of(hada_divide_up(count, 4), LOCAL, (size_t)images, 1);
    hada_slot_cost(slot, 8.0 * (double)count * (otf_images + (add ? 3.0 : 2.0) * images), 8.0 * (double)count * images);
    return hada_launch_optics_accumulate(slot, HADA_PROGRAM_OPTICS_ACCUMULATE_DEFAULT, &range, err, .sum = sum,
                                         .offset = sum_offset, .otf = otf, .scene = scene, .count = (int)count,
                                         .otf_images = otf_images, .add = add);
}
