#include "refine/shrinkage.h"

hada_status hada_shrinkage_prepare(hada_shrinkage *shrinkage, hada_slot *slot, int channels, int rows, int cols,
                                   hada_error *err)
{
    *shrinkage =
        (hada_shrinkage){.channels = channels, .rows = rows, .cols = cols, .program = hada_program_refine_dct_of(slot)};
    const hada_macros_refine_dct *macros = hada_macros_of_refine_dct(shrinkage->program);
    shrinkage->group = (size_t)macros->dct_group;
    shrinkage->tiles = hada_divide_up((size_t)rows, (size_t)macros->dct_tile_rows) *
                       hada_divide_up((size_t)cols, (size_t)macros->dct_tile_cols);
    return hada_prepare_refine_dct(slot, shrinkage->program, err);
}

/* Between channels and brightness with colours. */
static hada_status colours(const hada_shrinkage *s, hada_slot *slot, cl_mem from, size_t first, cl_mem to, int back,
                           hada_error *err)
{
    const size_t area = (size_t)s->rows * (size_t)s->cols;
    const size_t run = s->group > 1 ? 1 : HADA_REFINE_DCT_RUN;
    const hada_range range = hada_range_of(hada_divide_up(area, run), s->group, 1, 1);
    const hada_refine_window window = {.channels = s->channels, .rows = s->rows, .cols = s->cols};
    const double values = (double)area * s->channels;
    hada_slot_cost(slot, 8.0 * values, 2.0 * s->channels * values);
    return hada_launch_refine_dct_colours(slot, s->program, &range, err, .from = from, .first = (cl_uint)first,
                                          .out = to, .window = window, .back = back);
}

hada_status hada_shrinkage_step(const hada_shrinkage *s, hada_slot *slot, cl_mem image, cl_mem scratch,
                                double threshold, hada_error *err)
{
    const double values = (double)s->channels * s->rows * s->cols;
    const hada_refine_window window = {.channels = s->channels, .rows = s->rows, .cols = s->cols};
    const hada_range range = hada_range_groups(s->tiles, s->group, (size_t)s->channels, 1);
    HADA_TRY(colours(s, slot, image, 0, scratch, 0, err));
    /* 16 blocks hold a pixel: of each eight coefficients of a transform of eight, 34 operations, there and back */
    hada_slot_cost(slot, 8.0 * values, (8.0 * 2.0 * 34.0 / 4.0 + 64.0 * 5.0 / 4.0) * values);
    HADA_TRY(hada_launch_refine_dct_shrink(slot, s->program, &range, err, .planes = scratch, .window = window,
                                           .threshold = (float)threshold, .colour = (float)HADA_SHRINKAGE_COLOUR));
    return colours(s, slot, scratch, (size_t)values, image, 1, err);
}

hada_status hada_shrinkage_after_variation(const hada_shrinkage *s, const hada_variation *variation, hada_slot *slot,
                                           cl_mem image, const cl_mem duals[2], const hada_shrinkage_weights *weights,
                                           int fresh, hada_error *err)
{
    HADA_TRY(hada_variation_step(variation, slot, image, duals, 1, weights->variation * weights->theta, weights->colour,
                                 fresh, err));
    /* the duals are in the first buffer now, and the second, twice as large as an image, is free */
    return hada_shrinkage_step(s, slot, image, duals[1], weights->threshold * weights->theta, err);
}
