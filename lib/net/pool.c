/* Pooling. */
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
    const hada_tensor_place at_x = hada_tensor_place_of(x), at_y = hada_tensor_place_of(y);
    const cl_int blocks = hada_tensor_blocks(x), window = size, step = stride;
    const hada_arg args[] = {
        HADA_ARG_TENSOR(x, at_x), HADA_ARG_TENSOR(y, at_y), HADA_ARG(x->rows),   HADA_ARG(x->cols), HADA_ARG(y->rows),
        HADA_ARG(y->cols),        HADA_ARG(blocks),         HADA_ARG(grid.span), HADA_ARG(window),  HADA_ARG(step)};
    return hada_layer_launch(slot, "net_pool", pool == HADA_POOL_MAX ? "net_pool_max_forward" : "net_pool_mean_forward",
                             x, &grid, args, HADA_COUNT(args), err);
}

/* Maxima of 2 x 2 that do not overlap: window by window, all rows of x counted. */
static hada_status backward_pairs(hada_slot *slot, const hada_tensor *x, const hada_tensor *y, const hada_tensor *dy,
                                  const hada_tensor *dx, int accumulate, hada_error *err)
{
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, (x->rows + 1) / 2, (x->cols + 1) / 2);
    const hada_tensor_place at_x = hada_tensor_place_of(x), at_y = hada_tensor_place_of(y);
    const hada_tensor_place at_dy = hada_tensor_place_of(dy), at_dx = hada_tensor_place_of(dx);
    const cl_int blocks = hada_tensor_blocks(x), add = accumulate;
    const hada_arg args[] = {HADA_ARG_TENSOR(x, at_x),
                             HADA_ARG_TENSOR(y, at_y),
                             HADA_ARG_TENSOR(dy, at_dy),
                             HADA_ARG_TENSOR(dx, at_dx),
                             HADA_ARG(x->rows),
                             HADA_ARG(x->cols),
                             HADA_ARG(y->rows),
                             HADA_ARG(y->cols),
                             HADA_ARG(blocks),
                             HADA_ARG(grid.span),
                             HADA_ARG(add)};
    return hada_layer_launch(slot, "net_pool", "net_pool_max2_backward", x, &grid, args, HADA_COUNT(args), err);
}

hada_status hada_pool_backward(hada_slot *slot, hada_pool pool, int size, int stride, const hada_tensor *x,
                               const hada_tensor *y, const hada_tensor *dy, const hada_tensor *dx, int accumulate,
                               hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(check_pool(pool, size, stride, x, y, err));
    HADA_TRY(hada_layer_check("pooling", y, dy, 1, err));
    HADA_TRY(hada_layer_check("pooling", x, dx, 1, err));
    if (pool == HADA_POOL_MAX && size == 2 && stride == 2)
        return backward_pairs(slot, x, y, dy, dx, accumulate, err);
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_tensor_place at_x = hada_tensor_place_of(x), at_y = hada_tensor_place_of(y);
    const hada_tensor_place at_dy = hada_tensor_place_of(dy), at_dx = hada_tensor_place_of(dx);
    const cl_int blocks = hada_tensor_blocks(x), window = size, step = stride, add = accumulate;
    const hada_arg args[] = {HADA_ARG_TENSOR(x, at_x),
                             HADA_ARG_TENSOR(y, at_y),
                             HADA_ARG_TENSOR(dy, at_dy),
                             HADA_ARG_TENSOR(dx, at_dx),
                             HADA_ARG(x->rows),
                             HADA_ARG(x->cols),
                             HADA_ARG(y->rows),
                             HADA_ARG(y->cols),
                             HADA_ARG(blocks),
                             HADA_ARG(grid.span),
                             HADA_ARG(window),
                             HADA_ARG(step),
                             HADA_ARG(add)};
    /* the mean needs neither x nor y: two tensors, three arguments each, less */
    const size_t skip = pool == HADA_POOL_MAX ? 0 : 6;
    HADA_TRY(hada_layer_launch(slot, "net_pool",
                               pool == HADA_POOL_MAX ? "net_pool_max_backward" : "net_pool_mean_backward", x, &grid,
                               args + skip, HADA_COUNT(args) - skip, err));
done:
    return status;
}
