/* Losses that look at single values or neighbours. */
#include "launch/net_loss.h"
#include "net/layer_launch.h"
#include "net/ssim_loss.h"

static double values_of(const hada_tensor *x)
{
    return (double)x->images * x->channels * x->rows * x->cols;
}

size_t hada_loss_scratch(const hada_loss_desc *desc, const hada_tensor *x)
{
    if (desc->loss == HADA_LOSS_SSIM)
        return hada_ssim_loss_scratch(x);
    const size_t items = hada_layer_items_at_most(x);
    return (items + hada_sum_scratch(items)) * sizeof(float);
}

static hada_status check_loss(const hada_loss_desc *desc, const hada_tensor *x, const hada_tensor *target,
                              const hada_tensor *dx, hada_error *err)
{
    hada_status status = HADA_OK;
    if ((int)desc->loss < HADA_LOSS_MSE || desc->loss > HADA_LOSS_SSIM)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no loss %d", (int)desc->loss);
    const int alone = desc->loss == HADA_LOSS_TV || desc->loss == HADA_LOSS_TV_SQUARED;
    if (alone != !target)
        return hada_fail(err, HADA_ERROR_ARGUMENT, alone ? "total variation has no target" : "the loss needs a target");
    HADA_TRY(hada_layer_check("loss", x, target ? target : x, 1, err));
    if (dx)
        HADA_TRY(hada_layer_check("gradient of the loss", x, dx, 1, err));
done:
    return status;
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
    return hada_launch_net_loss_values(slot, HADA_PROGRAM_BY_BLOCK(NET_LOSS, x->block), &grid->range, err, .x = x->mem,
                                       .target = target->mem, .dx = to->mem, .sums = scratch, .at_x = hada_layout_of(x),
                                       .at_target = hada_layout_of(target), .at_dx = hada_layout_of(to),
                                       .span = grid->span, .term = term);
}

static hada_status variation(hada_slot *slot, const hada_loss_desc *desc, const hada_tensor *x, const hada_tensor *dx,
                             int accumulate, const hada_layer_grid *grid, cl_mem scratch, hada_error *err)
{
    const hada_tensor *to = dx ? dx : x;
    const hada_loss_term term = {.loss = (int)desc->loss,
                                 .has_gradient = dx != NULL,
                                 .accumulate = accumulate,
                                 .scale = desc->weight / (cl_float)x->images};
    return hada_launch_net_loss_variation(slot, HADA_PROGRAM_BY_BLOCK(NET_LOSS, x->block), &grid->range, err,
                                          .x = x->mem, .dx = to->mem, .sums = scratch, .at_x = hada_layout_of(x),
                                          .at_dx = hada_layout_of(to), .span = grid->span, .term = term);
}

hada_status hada_loss_run(hada_slot *slot, const hada_loss_desc *desc, const hada_tensor *x, const hada_tensor *target,
                          hada_floats value, const hada_tensor *dx, int accumulate, cl_mem scratch, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(check_loss(desc, x, target, dx, err));
    if (desc->loss == HADA_LOSS_SSIM)
        return hada_ssim_loss_run(slot, desc, x, target, value, dx, accumulate, scratch, err);
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    double count = values_of(x);
    if (target) {
        HADA_TRY(by_value(slot, desc, x, target, dx, accumulate, &grid, scratch, err));
    } else {
        HADA_TRY(variation(slot, desc, x, dx, accumulate, &grid, scratch, err));
        count = x->images;
    }
    HADA_TRY(hada_sum_floats(slot, scratch, 0, hada_layer_grid_items(&grid), (float)(desc->weight / count), 0.0f, value,
                             err));
done:
    return status;
}
