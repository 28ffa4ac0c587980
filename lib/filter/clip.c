#include "filter/clip.h"

#include "launch/filter_clip.h"

hada_range hada_values_range(const hada_slot *slot, size_t offset, size_t count)
{
    enum { WIDTH_LANES = 8, LOCAL_LANES = 64, WIDTH_GROUPS = 4, LOCAL_GROUPS = 128 };
    if (slot->context->shape != HADA_SHAPE_GROUPS)
        return hada_range_of(hada_divide_up(count, WIDTH_LANES), LOCAL_LANES, 1, 1);
    return hada_range_of(hada_divide_up(offset % WIDTH_GROUPS + count, WIDTH_GROUPS), LOCAL_GROUPS, 1, 1);
}

hada_status hada_image_clip(hada_slot *slot, cl_mem planes, size_t count, hada_error *err)
{
    const hada_range range = hada_values_range(slot, 0, count);
    hada_slot_cost(slot, 8.0 * (double)count, (double)count);
    return hada_launch_filter_clip(slot, hada_program_filter_clip_of(slot), &range, err, .values = planes, .offset = 0,
                                   .count = count);
}

hada_status hada_image_blend(hada_slot *slot, cl_mem planes, size_t offset, cl_mem others, size_t count, double share,
                             hada_error *err)
{
    const hada_range range = hada_values_range(slot, offset, count);
    hada_slot_cost(slot, 12.0 * (double)count, 5.0 * (double)count);
    return hada_launch_filter_blend(slot, hada_program_filter_clip_of(slot), &range, err, .values = planes,
                                    .offset = offset, .others = others, .count = count, .share = (cl_float)share);
}
