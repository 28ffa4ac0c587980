#include "refine/ridge.h"

#include "kernels/shared_ridge_weights.h"

static int is_colour(int channels)
{
    return channels == 3;
}

hada_status hada_ridge_prepare(hada_ridge *ridge, hada_slot *slot, int channels, int rows, int cols, hada_error *err)
{
    const int groups = slot->context->shape == HADA_SHAPE_GROUPS, wide = slot->context->vector_floats >= 16;
    *ridge = (hada_ridge){.channels = channels, .rows = rows, .cols = cols};
    if (is_colour(channels))
        ridge->program = groups ? HADA_PROGRAM_REFINE_RIDGE_COLOUR_GROUPS
                         : wide ? HADA_PROGRAM_REFINE_RIDGE_COLOUR_WIDE
                                : HADA_PROGRAM_REFINE_RIDGE_COLOUR;
    else
        ridge->program = groups ? HADA_PROGRAM_REFINE_RIDGE_GREY_GROUPS
                         : wide ? HADA_PROGRAM_REFINE_RIDGE_GREY_WIDE
                                : HADA_PROGRAM_REFINE_RIDGE_GREY;
    const hada_macros_refine_ridge *macros = hada_macros_of_refine_ridge(ridge->program);
    ridge->group = (size_t)macros->ridge_group;
    ridge->tiles = hada_divide_up((size_t)rows, (size_t)macros->ridge_rows) *
                   hada_divide_up((size_t)cols, (size_t)macros->ridge_cols);
    return hada_prepare_refine_ridge(slot, ridge->program, err);
}

hada_ridge_step hada_ridge_step_of(int number, double noise)
{
    hada_ridge_step step = {.number = number,
                            .last = number + 1 == HADA_RIDGE_STEPS,
                            .length = hada_ridge_length[number],
                            .momentum = hada_ridge_momentum[number]};
    for (int k = 0; k < HADA_RIDGE_FILTERS; k++) {
        const double in = hada_ridge_in[number * HADA_RIDGE_FILTERS + k] / noise;
        step.in[k] = (float)in;
        step.out[k] = (float)(hada_ridge_share[number * HADA_RIDGE_FILTERS + k] / in);
    }
    return step;
}

hada_status hada_ridge_apply(const hada_ridge *ridge, hada_slot *slot, cl_mem planes, cl_mem scratch, int count,
                             double noise, hada_error *err)
{
    const int colour = is_colour(ridge->channels), seen = colour ? 3 : 1;
    const size_t images = (size_t)count * (size_t)(ridge->channels / seen);
    const size_t values = (size_t)count * (size_t)ridge->channels * (size_t)ridge->rows * (size_t)ridge->cols;
    const hada_range range = hada_range_groups(ridge->tiles, ridge->group, images, 1);
    const double taps = seen * HADA_RIDGE_SIZE * HADA_RIDGE_SIZE;
    for (int i = 0; i < HADA_RIDGE_STEPS; i++) {
        /* the two halves take turns; a step's result takes the place of what was before it */
        hada_ridge_step step = hada_ridge_step_of(i, noise);
        step.rows = ridge->rows;
        step.cols = ridge->cols;
        step.x_at = i > 0 ? (size_t) !(i % 2) * values : 0;
        step.before_at = i > 1 ? (size_t)(i % 2) * values : 0;
        step.next_at = step.last ? 0 : (size_t)(i % 2) * values;
        hada_slot_cost(slot, 16.0 * (double)values, 4.0 * taps * HADA_RIDGE_FILTERS * (double)values / seen);
        HADA_TRY(hada_launch_refine_ridge_step(slot, ridge->program, &range, err, .given = planes,
                                               .x = i > 0 ? scratch : planes, .before = i > 1 ? scratch : planes,
                                               .next = step.last ? planes : scratch, .step = step));
    }
    return HADA_OK;
}
