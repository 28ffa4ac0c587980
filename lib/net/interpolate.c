/* Resizing. */
#include <limits.h>

#include "launch/net_resize.h"
#include "net/layer_launch.h"

static hada_resize_rule rule_of(hada_resize resize)
{
    if (resize == HADA_RESIZE_NEAREST)
        return HADA_RESIZE_FLOOR;
    return resize == HADA_RESIZE_LINEAR_ALIGNED || resize == HADA_RESIZE_CUBIC_ALIGNED ? HADA_RESIZE_ALIGNED
                                                                                       : HADA_RESIZE_HALF;
}

static int taps_of(hada_resize resize)
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
    const hada_tensor_layout at_x = hada_layout_of(x), at_y = hada_layout_of(y);
    const hada_program_net_resize program = HADA_PROGRAM_OF_LAYER(NET_RESIZE, slot, x->block);
    switch (taps_of(resize)) {
    case 1:
        return hada_launch_net_resize_nearest(slot, program, &grid.range, err, .x = x->mem, .y = y->mem, .at_x = at_x,
                                              .at_y = at_y, .span = grid.span);
    case 2:
        return hada_launch_net_resize_linear(slot, program, &grid.range, err, .x = x->mem, .y = y->mem, .at_x = at_x,
                                             .at_y = at_y, .span = grid.span, .rule = rule_of(resize));
    default:
        return hada_launch_net_resize_cubic(slot, program, &grid.range, err, .x = x->mem, .y = y->mem, .at_x = at_x,
                                            .at_y = at_y, .span = grid.span, .rule = rule_of(resize));
    }
}

hada_status hada_resize_backward(hada_slot *slot, hada_resize resize, const hada_tensor *dy, const hada_tensor *dx,
                                 int accumulate, hada_error *err)
{
    hada_status status = check_resize(resize, dx, dy, err);
    if (status)
        return status;
    const hada_layer_grid grid = hada_layer_grid_of(slot, dx, dx->rows, dx->cols);
    return hada_launch_net_resize_backward(slot, HADA_PROGRAM_OF_LAYER(NET_RESIZE, slot, dx->block), &grid.range, err,
                                           .dy = dy->mem, .dx = dx->mem, .at_dy = hada_layout_of(dy),
                                           .at_dx = hada_layout_of(dx), .span = grid.span, .rule = rule_of(resize),
                                           .taps = taps_of(resize), .accumulate = accumulate);
}
