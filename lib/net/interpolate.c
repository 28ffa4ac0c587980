/* Resizing. */
#include <limits.h>

#include "core/alloc.h"
#include "launch/net_planes.h"
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

/* Rows of a work-item that takes runs of columns, and work-items of a group otherwise. */
enum { PLANES_TALL = 32, PLANES_LOCAL = 64 };

hada_status hada_resize_planes(hada_slot *slot, const hada_planes *from, const hada_planes *to, int images,
                               int channels, float floor, hada_error *err)
{
    const int groups = slot->context->shape == HADA_SHAPE_GROUPS, tall = groups ? 1 : PLANES_TALL;
    const hada_program_net_planes program = groups ? HADA_PROGRAM_NET_PLANES_WIDE1 : HADA_PROGRAM_NET_PLANES_DEFAULT;
    const hada_planes_sizes sizes = {from->rows, from->cols, to->rows, to->cols, channels, tall};
    const size_t wide = (size_t)hada_macros_of_net_planes(program)->planes_wide;
    if (images < 1 || channels < 1 || from->rows < 1 || from->cols < 1 || to->rows < 1 || to->cols < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "resizing: planes have at least one image, channel, row and column");
    if (!countable(from->rows, to->rows) || !countable(from->cols, to->cols))
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "resizing from %d x %d to %d x %d: too large", from->rows,
                         from->cols, to->rows, to->cols);
    const hada_range range =
        hada_range_of(hada_divide_up((size_t)to->cols, wide), groups ? PLANES_LOCAL : 1,
                      hada_divide_up((size_t)to->rows, (size_t)tall), (size_t)images * (size_t)channels);
    return hada_launch_net_planes_resize(slot, program, &range, err, .from = from->at.mem, .to = to->at.mem,
                                         .at_from = hada_planar_layout_of(&from->at),
                                         .at_to = hada_planar_layout_of(&to->at), .floor = floor, .sizes = sizes);
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
