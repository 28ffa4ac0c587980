/* Pooling. */
#include "launch/net_pool.h"
#include "net/layer_launch.h"

static hada_status check_pool(hada_pool pool, int size, int stride, const hada_tensor *x, const hada_tensor *y,
                              hada_error *err)
{
    hada_status status = hada_layer_check("pooling", x, y, 0, err);
    if (status)
        return status;
    if ((pool != HADA_POOL_MAX && pool != HADA_POOL_MEAN) || size < 1 || stride < 1 || size > x->rows || size > x->cols)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "pooling (%d) with windows of %d every %d pixels is not possible on %d x %d", (int)pool, size,
                         stride, x->rows, x->cols);
    const int rows = (x->rows - size) / stride + 1, cols = (x->cols - size) / stride + 1;
    if (y->channels != x->channels || y->rows != rows || y->cols != cols)
        return hada_fail(err, HADA_ERROR_SIZE, "pooling: %d channels of %d x %d make %d of %d x %d, not %d of %d x %d",
                         x->channels, x->rows, x->cols, x->channels, rows, cols, y->channels, y->rows, y->cols);
    return HADA_OK;
}

hada_status hada_pool_forward(hada_slot *slot, hada_pool pool, int size, int stride, const hada_tensor *x,
                              const hada_tensor *y, hada_error *err)
{
    hada_status status = check_pool(pool, size, stride, x, y, err);
    if (status)
        return status;
    const hada_layer_grid grid = hada_layer_grid_of(slot, y, y->rows, y->cols);
    const hada_tensor_layout at_x = hada_layout_of(x), at_y = hada_layout_of(y);
    const hada_pool_window windows = {size, stride};
    const hada_program_net_pool program = HADA_PROGRAM_OF_LAYER(NET_POOL, slot, x->block);
    if (pool == HADA_POOL_MAX)
        return hada_launch_net_pool_max_forward(slot, program, &grid.range, err, .x = x->mem, .y = y->mem, .at_x = at_x,
                                                .at_y = at_y, .span = grid.span, .windows = windows);
    return hada_launch_net_pool_mean_forward(slot, program, &grid.range, err, .x = x->mem, .y = y->mem, .at_x = at_x,
                                             .at_y = at_y, .span = grid.span, .windows = windows);
}

static hada_pool_gradient gradient_of(const hada_tensor *x, const hada_tensor *y, const hada_tensor *dy,
                                      const hada_tensor *dx, hada_pool_window windows, int span, int accumulate)
{
    return (hada_pool_gradient){.x = hada_layout_of(x),
                                .y = hada_layout_of(y),
                                .dy = hada_layout_of(dy),
                                .dx = hada_layout_of(dx),
                                .windows = windows,
                                .span = span,
                                .accumulate = accumulate};
}

/* Maxima of 2 x 2 that do not overlap: window by window, all rows of x counted. */
static hada_status backward_pairs(hada_slot *slot, const hada_tensor *x, const hada_tensor *y, const hada_tensor *dy,
                                  const hada_tensor *dx, int accumulate, hada_error *err)
{
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, (x->rows + 1) / 2, (x->cols + 1) / 2);
    return hada_launch_net_pool_max2_backward(
        slot, HADA_PROGRAM_OF_LAYER(NET_POOL, slot, x->block), &grid.range, err, .x = x->mem, .y = y->mem,
        .dy = dy->mem, .dx = dx->mem, .at = gradient_of(x, y, dy, dx, (hada_pool_window){2, 2}, grid.span, accumulate));
}

hada_status hada_pool_backward(hada_slot *slot, hada_pool pool, int size, int stride, const hada_tensor *x,
                               const hada_tensor *y, const hada_tensor *dy, const hada_tensor *dx, int accumulate,
                               hada_error *err)
{
    HADA_TRY(check_pool(pool, size, stride, x, y, err));
    HADA_TRY(hada_layer_check("pooling", y, dy, 1, err));
    HADA_TRY(hada_layer_check("pooling", x, dx, 1, err));
    if (pool == HADA_POOL_MAX && size == 2 && stride == 2)
        return backward_pairs(slot, x, y, dy, dx, accumulate, err);
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_tensor_layout at_dy = hada_layout_of(dy), at_dx = hada_layout_of(dx);
    const hada_pool_window windows = {size, stride};
    const hada_program_net_pool program = HADA_PROGRAM_OF_LAYER(NET_POOL, slot, x->block);
    if (pool == HADA_POOL_MAX)
        HADA_TRY(hada_launch_net_pool_max_backward(slot, program, &grid.range, err, .x = x->mem, .y = y->mem,
                                                   .dy = dy->mem, .dx = dx->mem,
                                                   .at = gradient_of(x, y, dy, dx, windows, grid.span, accumulate)));
    else
        HADA_TRY(hada_launch_net_pool_mean_backward(slot, program, &grid.range, err, .dy = dy->mem, .dx = dx->mem,
                                                    .at_dy = at_dy, .at_dx = at_dx, .span = grid.span,
                                                    .windows = windows, .accumulate = accumulate));
    return HADA_OK;
}
