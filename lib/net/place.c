/* Placing a tensor in another: concatenation, crop, pad. */
#include "net/layer_launch.h"

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
    hada_status status = hada_layer_check("placing", part, whole, 0, err);
    if (!status && (first < 0 || first > whole->channels - part->channels))
        status = hada_fail(err, HADA_ERROR_SIZE, "placing: channels %d ... %d of a tensor of %d", first,
                           first + part->channels - 1, whole->channels);
    return status;
}

hada_status hada_place(hada_slot *slot, const hada_tensor *x, const hada_tensor *y, int row, int col, int first_channel,
                       int accumulate, hada_error *err)
{
    hada_status status = check_channels(x, y, first_channel, err);
    return status ? status : place(slot, x, y, row, col, 0, first_channel, x->channels, accumulate, err);
}

hada_status hada_place_backward(hada_slot *slot, const hada_tensor *dy, const hada_tensor *dx, int row, int col,
                                int first_channel, int accumulate, hada_error *err)
{
    hada_status status = check_channels(dx, dy, first_channel, err);
    return status ? status : place(slot, dy, dx, -row, -col, first_channel, 0, dx->channels, accumulate, err);
}
