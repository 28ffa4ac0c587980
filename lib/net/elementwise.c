/* Operations that take each value by itself: activations, sums, dropout, placing. */
#include <math.h>

#include "launch/net_dropout.h"
#include "launch/net_elementwise.h"
#include "launch/net_place.h"
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
    HADA_TRY(hada_layer_check("activation", x, y, 1, err));
    HADA_TRY(check_slope(activation, &slope, err));
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_tensor_layout at_x = hada_layout_of(x), at_y = hada_layout_of(y);
    const hada_program_net_elementwise program = HADA_PROGRAM_OF_LAYER(NET_ELEMENTWISE, slot, x->block);
    if (activation == HADA_ACTIVATION_SIGMOID)
        HADA_TRY(hada_launch_net_sigmoid_forward(slot, program, &grid.range, err, .x = x->mem, .y = y->mem,
                                                 .at_x = at_x, .at_y = at_y, .span = grid.span));
    else
        HADA_TRY(hada_launch_net_leaky_forward(slot, program, &grid.range, err, .x = x->mem, .y = y->mem, .at_x = at_x,
                                               .at_y = at_y, .span = grid.span, .slope = slope));
    return HADA_OK;
}

hada_status hada_activation_backward(hada_slot *slot, hada_activation activation, float slope, const hada_tensor *y,
                                     const hada_tensor *dy, const hada_tensor *dx, hada_error *err)
{
    HADA_TRY(hada_layer_check("activation", y, dy, 1, err));
    HADA_TRY(hada_layer_check("activation", y, dx, 1, err));
    HADA_TRY(check_slope(activation, &slope, err));
    const hada_layer_grid grid = hada_layer_grid_of(slot, y, y->rows, y->cols);
    const hada_tensor_layout at_y = hada_layout_of(y), at_dy = hada_layout_of(dy), at_dx = hada_layout_of(dx);
    const hada_program_net_elementwise program = HADA_PROGRAM_OF_LAYER(NET_ELEMENTWISE, slot, y->block);
    if (activation == HADA_ACTIVATION_SIGMOID)
        HADA_TRY(hada_launch_net_sigmoid_backward(slot, program, &grid.range, err, .y = y->mem, .dy = dy->mem,
                                                  .dx = dx->mem, .at_y = at_y, .at_dy = at_dy, .at_dx = at_dx,
                                                  .span = grid.span));
    else
        HADA_TRY(hada_launch_net_leaky_backward(slot, program, &grid.range, err, .y = y->mem, .dy = dy->mem,
                                                .dx = dx->mem, .at_y = at_y, .at_dy = at_dy, .at_dx = at_dx,
                                                .span = grid.span, .slope = slope));
    return HADA_OK;
}

hada_status hada_blend(hada_slot *slot, float a, const hada_tensor *x, float b, const hada_tensor *y, hada_error *err)
{
    hada_status status = hada_layer_check("blend", x, y, 1, err);
    if (status)
        return status;
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    return hada_launch_net_blend(slot, HADA_PROGRAM_OF_LAYER(NET_ELEMENTWISE, slot, x->block), &grid.range, err,
                                 .x = x->mem, .y = y->mem, .at_x = hada_layout_of(x), .at_y = hada_layout_of(y),
                                 .span = grid.span, .a = a, .b = b);
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
    const hada_dropout_draw draw = {.key0 = (cl_uint)seed,
                                    .key1 = (cl_uint)(seed >> 32) ^ (cl_uint)(step >> 32),
                                    .step = (cl_uint)step,
                                    .threshold = (cl_uint)ceil((double)p * 16777216.0),
                                    .scale = (cl_float)(1.0 / (1.0 - (double)p))};
    return hada_launch_net_dropout(slot, HADA_PROGRAM_OF_LAYER(NET_DROPOUT, slot, x->block), &grid.range, err,
                                   .x = x->mem, .y = y->mem, .at_x = hada_layout_of(x), .at_y = hada_layout_of(y),
                                   .span = grid.span, .draw = draw);
}

/* Channel y_first + k of y takes channel x_first + k of x; x's top left stands at (row, col) of y. */
static hada_status place(hada_slot *slot, const hada_tensor *x, const hada_tensor *y, const hada_placing *to,
                         hada_error *err)
{
    hada_layer_grid grid = hada_layer_pixel_grid_of(slot, y, y->rows, y->cols);
    const int first_block = to->y_first / y->block, last_block = (to->y_first + to->count - 1) / y->block;
    const int blocks = last_block - first_block + 1;
    grid.range.global[2] = (size_t)blocks * (size_t)y->images;
    return hada_launch_net_place(slot, HADA_PROGRAM_BY_BLOCK(NET_PLACE, y->block), &grid.range, err, .x = x->mem,
                                 .y = y->mem, .at_x = hada_layout_of(x), .at_y = hada_layout_of(y), .blocks = blocks,
                                 .span = grid.span, .to = *to);
}

static hada_status check_channels(const hada_tensor *part, const hada_tensor *whole, int first, hada_error *err)
{
    HADA_TRY(hada_layer_check("placing", part, whole, 0, err));
    if (first < 0 || first > whole->channels - part->channels)
        HADA_TRY(hada_fail(err, HADA_ERROR_SIZE, "placing: channels %d ... %d of a tensor of %d", first,
                           first + part->channels - 1, whole->channels));
    return HADA_OK;
}

hada_status hada_place(hada_slot *slot, const hada_tensor *x, const hada_tensor *y, int row, int col, int first_channel,
                       int accumulate, hada_error *err)
{
    const hada_placing to = {row, col, 0, first_channel, x->channels, accumulate};
    const hada_status status = check_channels(x, y, first_channel, err);
    return status ? status : place(slot, x, y, &to, err);
}

hada_status hada_place_backward(hada_slot *slot, const hada_tensor *dy, const hada_tensor *dx, int row, int col,
                                int first_channel, int accumulate, hada_error *err)
{
    const hada_placing to = {-row, -col, first_channel, 0, dx->channels, accumulate};
    const hada_status status = check_channels(dx, dy, first_channel, err);
    return status ? status : place(slot, dy, dx, &to, err);
}
