/* Activations and sums of tensors. */
#include "net/layer_launch.h"

static hada_status check_slope(hada_activation activation, float *slope, hada_error *err)
{
    if (activation == HADA_ACTIVATION_NONE)
        *slope = 1.0f;
    else if (activation == HADA_ACTIVATION_RELU)
        *slope = 0.0f;
    else if (activation == HADA_ACTIVATION_LEAKY_RELU && !(*slope >= 0.0f))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a leaky ReLU needs a slope of at least 0, not %g", *slope);
    else if (activation != HADA_ACTIVATION_LEAKY_RELU && activation != HADA_ACTIVATION_SIGMOID)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no activation %d", (int)activation);
    return HADA_OK;
}

hada_status hada_activation_forward(hada_slot *slot, hada_activation activation, float slope, const hada_tensor *x,
                                    const hada_tensor *y, hada_error *err)
{
    hada_status status = hada_layer_check("activation", x, y, 1, err);
    if (!status)
        status = check_slope(activation, &slope, err);
    if (status)
        return status;
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_tensor_place at_x = hada_tensor_place_of(x), at_y = hada_tensor_place_of(y);
    const cl_int blocks = hada_tensor_blocks(x);
    const int sigmoid = activation == HADA_ACTIVATION_SIGMOID;
    const hada_arg last = sigmoid ? (hada_arg)HADA_ARG(x->channels) : (hada_arg)HADA_ARG(slope);
    const hada_arg args[] = {HADA_ARG_TENSOR(x, at_x),
                             HADA_ARG_TENSOR(y, at_y),
                             HADA_ARG(x->rows),
                             HADA_ARG(x->cols),
                             HADA_ARG(blocks),
                             HADA_ARG(grid.span),
                             last};
    return hada_layer_launch(slot, "net_elementwise", sigmoid ? "net_sigmoid_forward" : "net_leaky_forward", x, &grid,
                             args, HADA_COUNT(args), err);
}

hada_status hada_activation_backward(hada_slot *slot, hada_activation activation, float slope, const hada_tensor *y,
                                     const hada_tensor *dy, const hada_tensor *dx, hada_error *err)
{
    hada_status status = hada_layer_check("activation", y, dy, 1, err);
    if (!status)
        status = hada_layer_check("activation", y, dx, 1, err);
    if (!status)
        status = check_slope(activation, &slope, err);
    if (status)
        return status;
    const hada_layer_grid grid = hada_layer_grid_of(slot, y, y->rows, y->cols);
    const hada_tensor_place at_y = hada_tensor_place_of(y), at_dy = hada_tensor_place_of(dy);
    const hada_tensor_place at_dx = hada_tensor_place_of(dx);
    const cl_int blocks = hada_tensor_blocks(y);
    const int sigmoid = activation == HADA_ACTIVATION_SIGMOID;
    const hada_arg args[] = {
        HADA_ARG_TENSOR(y, at_y), HADA_ARG_TENSOR(dy, at_dy), HADA_ARG_TENSOR(dx, at_dx), HADA_ARG(y->rows),
        HADA_ARG(y->cols),        HADA_ARG(blocks),           HADA_ARG(grid.span),        HADA_ARG(slope)};
    return hada_layer_launch(slot, "net_elementwise", sigmoid ? "net_sigmoid_backward" : "net_leaky_backward", y, &grid,
                             args, HADA_COUNT(args) - (sigmoid ? 1 : 0), err);
}

hada_status hada_blend(hada_slot *slot, float a, const hada_tensor *x, float b, const hada_tensor *y, hada_error *err)
{
    hada_status status = hada_layer_check("blend", x, y, 1, err);
    if (status)
        return status;
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_tensor_place at_x = hada_tensor_place_of(x), at_y = hada_tensor_place_of(y);
    const cl_int blocks = hada_tensor_blocks(x);
    const hada_arg args[] = {HADA_ARG_TENSOR(x, at_x), HADA_ARG_TENSOR(y, at_y), HADA_ARG(x->rows), HADA_ARG(x->cols),
                             HADA_ARG(blocks),         HADA_ARG(grid.span),      HADA_ARG(a),       HADA_ARG(b)};
    return hada_layer_launch(slot, "net_elementwise", "net_blend", x, &grid, args, HADA_COUNT(args), err);
}
