#include "refine/crosstalk.h"

hada_status hada_crosstalk_prepare(hada_crosstalk *crosstalk, hada_slot *slot, int channels, int rows, int cols,
                                   hada_error *err)
{
    *crosstalk = (hada_crosstalk){
        .channels = channels, .rows = rows, .cols = cols, .program = hada_program_refine_crosstalk_of(slot)};
    const hada_macros_refine_crosstalk *macros = hada_macros_of_refine_crosstalk(crosstalk->program);
    crosstalk->group = (size_t)macros->crosstalk_group;
    crosstalk->width = (size_t)macros->crosstalk_width;
    return hada_prepare_refine_crosstalk(slot, crosstalk->program, err);
}

hada_status hada_crosstalk_fade(const hada_crosstalk *x, hada_slot *slot, cl_mem planes, cl_mem scratch, int depths,
                                double share, hada_error *err)
{
    const size_t items = hada_divide_up((size_t)x->cols, x->width), rows = (size_t)x->rows;
    const hada_range lit = hada_range_of(items, x->group, rows, (size_t)depths),
                     faded = hada_range_of(items, x->group, rows, 1);
    const hada_refine_window window = {.channels = x->channels, .rows = x->rows, .cols = x->cols};
    const double pixels = (double)depths * x->rows * x->cols;
    hada_slot_cost(slot, 4.0 * (x->channels + 1) * pixels, 5.0 * x->channels * pixels);
    HADA_TRY(hada_launch_refine_crosstalk_light(slot, x->program, &lit, err, .planes = planes, .light = scratch,
                                                .window = window));
    hada_slot_cost(slot, 4.0 * (2 * x->channels + 1) * pixels, (18.0 + x->channels) * pixels);
    return hada_launch_refine_crosstalk_fade(slot, x->program, &faded, err, .planes = planes, .light = scratch,
                                             .window = window, .depths = depths, .share = (float)share);
}
