/* Operations that take each value by itself: activations, sums, dropout, placing. */
#include <math.h>

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
    hada_status status = HADA_OK;
    HADA_TRY(hada_layer_check("activation", x, y, 1, err));
    HADA_TRY(check_slope(activation, &slope, err));
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
    HADA_TRY(hada_layer_launch(slot, "net_elementwise", sigmoid ? "net_sigmoid_forward" : "net_leaky_forward", x, &grid,
                               args, HADA_COUNT(args), err));
done:
    return status;
}

hada_status hada_activation_backward(hada_slot *slot, hada_activation activation, float slope, const hada_tensor *y,
                                     const hada_tensor *dy, const hada_tensor *dx, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(hada_layer_check("activation", y, dy, 1, err));
    HADA_TRY(hada_layer_check("activation", y, dx, 1, err));
    HADA_TRY(check_slope(activation, &slope, err));
    const hada_layer_grid grid = hada_layer_grid_of(slot, y, y->rows, y->cols);
    const hada_tensor_place at_y = hada_tensor_place_of(y), at_dy = hada_tensor_place_of(dy);
    const hada_tensor_place at_dx = hada_tensor_place_of(dx);
    const cl_int blocks = hada_tensor_blocks(y);
    const int sigmoid = activation == HADA_ACTIVATION_SIGMOID;
    const hada_arg args[] = {
        HADA_ARG_TENSOR(y, at_y), HADA_ARG_TENSOR(dy, at_dy), HADA_ARG_TENSOR(dx, at_dx), HADA_ARG(y->rows),
        HADA_ARG(y->cols),        HADA_ARG(blocks),           HADA_ARG(grid.span),        HADA_ARG(slope)};
    HADA_TRY(hada_layer_launch(slot, "net_elementwise", sigmoid ? "net_sigmoid_backward" : "net_leaky_backward", y,
                               &grid, args, HADA_COUNT(args) - (sigmoid ? 1 : 0), err));
done:
    return status;
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

hada_status hada_dropout(hada_slot *slot, float p, uint64_t seed, uint64_t step, const hada_tensor *x,
                         const hada_tensor *y, hada_error *err)
{
    hada_status status = hada_layer_check("dropout", x, y, 1, err);
    if (status)
        return status;
    if (!(p >= 0.0f && p < 1.0f))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "dropout of %g is not possible; it must be from 0 to below 1", p);
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_tensor_place at_x = hada_tensor_place_of(x), at_y = hada_tensor_place_of(y);
    const cl_int blocks = hada_tensor_blocks(x);
    const cl_uint key0 = (cl_uint)seed, key1 = (cl_uint)(seed >> 32) ^ (cl_uint)(step >> 32), count = (cl_uint)step;
    const cl_uint threshold = (cl_uint)ceil((double)p * 16777216.0);
    const cl_float scale = (cl_float)(1.0 / (1.0 - (double)p));
    const hada_arg args[] = {HADA_ARG_TENSOR(x, at_x), HADA_ARG_TENSOR(y, at_y), HADA_ARG(x->rows), HADA_ARG(x->cols),
                             HADA_ARG(blocks),         HADA_ARG(grid.span),      HADA_ARG(key0),    HADA_ARG(key1),
                             HADA_ARG(count),          HADA_ARG(threshold),      HADA_ARG(scale)};
    return hada_layer_launch(slot, "net_dropout", "net_dropout", x, &grid, args, HADA_COUNT(args), err);
}

/* Channel y_first + k of y takes channel x_first + k of x; x's top left stands at (row, col) of y. */
static hada_status place(hada_slot *slot, const hada_tensor *x, const hada_tensor *y, int row, int col, int x_first,
                         int y_first, int count, int accumulate, hada_error *err)
{
    hada_layer_grid grid = hada_layer_grid_of(slot, y, y->rows, y->cols);
    const int first_block = y_first / y->block, last_block = (y_first + count - 1) / y->block;
    const cl_int blocks = last_block - first_block + 1;
    grid.global[2] = (size_t)blocks * (size_t)y->images;
    const hada_tensor_place at_x = hada_tensor_place_of(x), at_y = hada_tensor_place_of(y);
    const cl_int top = row, left = col, from = x_first, to = y_first, channels = count, add = accumulate;
    const hada_arg args[] = {HADA_ARG_TENSOR(x, at_x), HADA_ARG(x->rows),   HADA_ARG(x->cols),  HADA_ARG(x->channels),
                             HADA_ARG_TENSOR(y, at_y), HADA_ARG(y->rows),   HADA_ARG(y->cols),  HADA_ARG(y->channels),
                             HADA_ARG(blocks),         HADA_ARG(grid.span), HADA_ARG(top),      HADA_ARG(left),
                             HADA_ARG(from),           HADA_ARG(to),        HADA_ARG(channels), HADA_ARG(add)};
    return hada_layer_launch(slot, "net_place", "net_place", y, &grid, args, HADA_COUNT(args), err);
}

static hada_status check_channels(const hada_tensor *part, const hada_tensor *whole, int first, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(hada_layer_check("placing", part, whole, 0, err));
    if (first < 0 || first > whole->channels - part->channels)
        HADA_TRY(hada_fail(err, HADA_ERROR_SIZE, "placing: channels %d ... %d of a tensor of %d", first,
                           first + part->channels - 1, whole->channels));
done:
    return status;
}

hada_status hada_place(hada_slot *slot, const hada_tensor *x, const hada_tensor *y, int row, int col, int first_channel,
                       int accumulate, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(check_channels(x, y, first_channel, err));
    HADA_TRY(place(slot, x, y, row, col, 0, first_channel, x->channels, accumulate, err));
done:
    return status;
}

hada_status hada_place_backward(hada_slot *slot, const hada_tensor *dy, const hada_tensor *dx, int row, int col,
                                int first_channel, int accumulate, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(check_channels(dx, dy, first_channel, err));
    HADA_TRY(place(slot, dy, dx, -row, -col, first_channel, 0, dx->channels, accumulate, err));
done:
    return status;
}
