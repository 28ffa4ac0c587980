#include "filter/clip.h"

#include "launch/filter_clip.h"

hada_status hada_image_clip(hada_slot *slot, cl_mem planes, size_t count, hada_error *err)
{
    const hada_range range = hada_range_of(hada_divide_up(count, 8), 64, 1, 1);
    hada_slot_cost(slot, 8.0 * (double)count, (double)count);
    return hada_launch_filter_clip(slot, HADA_PROGRAM_FILTER_CLIP_DEFAULT, &range, err, .values = planes, .offset = 0,
                                   .count = count);
}

hada_status hada_image_blend(hada_slot *slot, cl_mem planes, size_t offset, cl_mem others, size_t count, double share,
                             hada_error *err)
{
    const hada_range range = hada_range_of(hada_divide_up(count, 8), 64, 1, 1);
    hada_slot_cost(slot, 12.0 * (double)count, 5.0 * (double)count);
    return hada_launch_filter_blend(slot, HADA_PROGRAM_FILTER_CLIP_DEFAULT, &range, err, .values = planes,
                                    .offset = offset, .others = others, .count = count, .share = (cl_float)share);
}
