#include "filter/clip.h"

#include "launch/filter_clip.h"

hada_status hada_image_clip(hada_slot *slot, cl_mem planes, size_t count, hada_error *err)
{
    const hada_range range = hada_range_of(hada_divide_up(count, 8), 64, 1, 1);
    hada_slot_cost(slot, 8.0 * (double)count, (double)count);
    return hada_launch_filter_clip(slot, HADA_PROGRAM_FILTER_CLIP_DEFAULT, &range, err, .values = planes, .offset = 0,
                                   .count = count);
}
