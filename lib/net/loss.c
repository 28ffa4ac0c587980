/* Losses: value by value, and of neighbours. */
#include "net/layers.h"

#include "launch/net_loss.h"
#include "net/layer_launch.h"

static double values_of(const hada_tensor *x)
{
    return (double)x->images * x->channels * x->rows * x->cols;
}

size_t hada_loss_scratch(const hada_tensor *x)
{
    const size_t sums = hada_layer_sums_at_most(x);
    return (sums + hada_sum_scratch(sums)) * sizeof(float);
}

/* Value by value: mean of squares, of absolute values, of logits' entropies. */
static hada_status by_value(hada_slot *slot, const hada_loss_desc *desc, const hada_tensor *x,
                            const hada_tensor *target, const hada_tensor *dx, int accumulate,
                            const hada_layer_grid *grid, cl_mem scratch, hada_error *err)
{
    const hada_tensor *to = dx ? dx : x; /* not written where there is no gradient */
    const hada_loss_term term = {.loss = (int)desc->loss,
                                 .has_gradient = dx != NULL,
                                 .accumulate = accumulate,
                                 .scale = (cl_float)(desc->weight / values_of(x))};
    return hada_launch_net_loss_values(slot, HADA_PROGRAM_OF_LAYER(NET_LOSS, slot, x->block), &grid->range, err,
                                       .x = x->mem, .target = target->mem, .dx = to->mem, .sums = scratch,
                                       .at_x = hada_layout_of(x), .at_target = hada_layout_of(target),
                                       .at_dx = hada_layout_of(to), .span = grid->span, .term = term);
}

static hada_status variation(hada_slot *slot, const hada_loss_desc *desc, const hada_tensor *x, const hada_tensor *dx,
                             int accumulate, const hada_layer_grid *grid, cl_mem scratch, hada_error *err)
{
    const hada_tensor *to = dx ? dx : x;
    const hada_loss_term term = {.loss = (int)desc->loss,
                                 .has_gradient = dx != NULL,
                                 .accumulate = accumulate,
                                 .scale = desc->weight / (cl_float)x->images};
    return hada_launch_net_loss_variation(slot, HADA_PROGRAM_OF_LAYER(NET_LOSS, slot, x->block), &grid->range, err,
                                          .x = x->mem, .dx = to->mem, .sums = scratch, .at_x = hada_layout_of(x),
                                          .at_dx = hada_layout_of(to), .span = grid->span, .term = term);
}

hada_status hada_loss_run(hada_slot *slot, const hada_loss_desc *desc, const hada_tensor *x, const hada_tensor *target,
                          hada_floats value, const hada_tensor *dx, int accumulate, cl_mem scratch, hada_error *err)
{
    const hada_layer_grid grid = hada_layer_sum_grid_of(slot, x);
    double count = values_of(x);
    if (target) {
        HADA_TRY(by_value(slot, desc, x, target, dx, accumulate, &grid, scratch, err));
    } else {
        HADA_TRY(variation(slot, desc, x, dx, accumulate, &grid, scratch, err));
        count = x->images;
    }
    return hada_sum_floats(slot, scratch, hada_layer_grid_sums(&grid), (float)(desc->weight / count), value, err);
}
