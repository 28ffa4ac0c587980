/* Resizing. */
#include <limits.h>

#include "net/layer_launch.h"

/* As in net_resize.cl. */
enum { RULE_HALF = 0, RULE_ALIGNED = 1, RULE_NEAREST = 2 };

static cl_int rule_of(hada_resize resize)
{
    if (resize == HADA_RESIZE_NEAREST)
        return RULE_NEAREST;
    return resize == HADA_RESIZE_LINEAR_ALIGNED || resize == HADA_RESIZE_CUBIC_ALIGNED ? RULE_ALIGNED : RULE_HALF;
}

static cl_int taps_of(hada_resize resize)
{
    return resize == HADA_RESIZE_NEAREST                                        ? 1
           : resize == HADA_RESIZE_CUBIC || resize == HADA_RESIZE_CUBIC_ALIGNED ? 4
                                                                                : 2;
}

/* The kernels compute (2 out + 2) (in + 2) and the like in 32 bits. */
static int countable(int in, int out)
{
    return 2 * ((double)out + 2.0) * ((double)in + 2.0) < (double)INT_MAX;
}

static hada_status check_resize(hada_resize resize, const hada_tensor *in, const hada_tensor *out, hada_error *err)
{
    hada_status status = hada_layer_check("resizing", in, out, 0, err);
    if (status)
        return status;
    if ((int)resize < HADA_RESIZE_NEAREST || resize > HADA_RESIZE_CUBIC_ALIGNED)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no way %d of resizing", (int)resize);
    if (in->channels != out->channels)
        return hada_fail(err, HADA_ERROR_SIZE, "resizing: %d channels against %d", in->channels, out->channels);
    if (!countable(in->rows, out->rows) || !countable(in->cols, out->cols))
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "resizing from %d x %d to %d x %d: too large", in->rows, in->cols,
                         out->rows, out->cols);
    return HADA_OK;
}

hada_status hada_resize_forward(hada_slot *slot, hada_resize resize, const hada_tensor *x, const hada_tensor *y,
                                hada_error *err)
{
    hada_status status = check_resize(resize, x, y, err);
    if (status)
        return status;
    const hada_layer_grid grid = hada_layer_grid_of(slot, y, y->rows, y->cols);
    const hada_tensor_place at_x = hada_tensor_place_of(x), at_y = hada_tensor_place_of(y);
    const cl_int blocks = hada_tensor_blocks(x), rule = rule_of(resize), taps = taps_of(resize);
    const hada_arg args[] = {HADA_ARG_TENSOR(x, at_x), HADA_ARG_TENSOR(y, at_y), HADA_ARG(x->rows),
                             HADA_ARG(x->cols),        HADA_ARG(y->rows),        HADA_ARG(y->cols),
                             HADA_ARG(blocks),         HADA_ARG(grid.span),      HADA_ARG(rule)};
    const char *name = taps == 1 ? "net_resize_nearest" : taps == 2 ? "net_resize_linear" : "net_resize_cubic";
    return hada_layer_launch(slot, "net_resize", name, x, &grid, args, HADA_COUNT(args) - (taps == 1 ? 1 : 0), err);
}

hada_status hada_resize_backward(hada_slot *slot, hada_resize resize, const hada_tensor *dy, const hada_tensor *dx,
                                 int accumulate, hada_error *err)
{
    hada_status status = check_resize(resize, dx, dy, err);
    if (status)
        return status;
    const hada_layer_grid grid = hada_layer_grid_of(slot, dx, dx->rows, dx->cols);
    const hada_tensor_place at_dy = hada_tensor_place_of(dy), at_dx = hada_tensor_place_of(dx);
    const cl_int blocks = hada_tensor_blocks(dx), rule = rule_of(resize), taps = taps_of(resize), add = accumulate;
    const hada_arg args[] = {HADA_ARG_TENSOR(dy, at_dy),
                             HADA_ARG_TENSOR(dx, at_dx),
                             HADA_ARG(dx->rows),
                             HADA_ARG(dx->cols),
                             HADA_ARG(dy->rows),
                             HADA_ARG(dy->cols),
                             HADA_ARG(blocks),
                             HADA_ARG(grid.span),
                             HADA_ARG(rule),
                             HADA_ARG(taps),
                             HADA_ARG(add)};
    return hada_layer_launch(slot, "net_resize", "net_resize_backward", dx, &grid, args, HADA_COUNT(args), err);
}
