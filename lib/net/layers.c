/* The layers that are neither convolutions nor batch norms: activations, sums, dropout, placing; pooling; resizing;
 * fully connected layers. */
#include <limits.h>

#include "launch/net_dropout.h"
#include "launch/net_elementwise.h"
#include "launch/net_linear.h"
#include "launch/net_place.h"
#include "launch/net_planes.h"
#include "launch/net_pool.h"
#include "launch/net_resize.h"
#include "net/layer_launch.h"

static hada_status check_slope(hada_activation activation, float *slope, hada_error *err)
{
    if (activation == HADA_ACTIVATION_NONE)
        *slope = 1.0f;
    else if (activation == HADA_ACTIVATION_RELU)
        *slope = 0.0f;
    else if (activation == HADA_ACTIVATION_LEAKY_RELU && !(*slope >= 0.0f))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a leaky ReLU needs a slope of at least 0, not %g", *slope);
    return HADA_OK;
}

hada_status hada_activation_forward(hada_slot *slot, hada_activation activation, float slope, const hada_tensor *x,
                                    const hada_tensor *y, hada_error *err)
{
    HADA_TRY(check_slope(activation, &slope, err));
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_tensor_layout at_x = hada_layout_of(x), at_y = hada_layout_of(y);
    const hada_program_net_elementwise program = HADA_PROGRAM_OF_LAYER(NET_ELEMENTWISE, slot, x->block);
    return hada_launch_net_activation_forward(slot, program, &grid.range, err, .x = x->mem, .y = y->mem, .at_x = at_x,
                                              .at_y = at_y, .span = grid.span,
                                              .sigmoid = activation == HADA_ACTIVATION_SIGMOID, .slope = slope);
}

hada_status hada_activation_backward(hada_slot *slot, hada_activation activation, float slope, const hada_tensor *y,
                                     const hada_tensor *dy, const hada_tensor *dx, hada_error *err)
{
    HADA_TRY(check_slope(activation, &slope, err));
    const hada_layer_grid grid = hada_layer_grid_of(slot, y, y->rows, y->cols);
    const hada_tensor_layout at_y = hada_layout_of(y), at_dy = hada_layout_of(dy), at_dx = hada_layout_of(dx);
    const hada_program_net_elementwise program = HADA_PROGRAM_OF_LAYER(NET_ELEMENTWISE, slot, y->block);
    return hada_launch_net_activation_backward(
        slot, program, &grid.range, err, .y = y->mem, .dy = dy->mem, .dx = dx->mem, .at_y = at_y, .at_dy = at_dy,
        .at_dx = at_dx, .span = grid.span, .sigmoid = activation == HADA_ACTIVATION_SIGMOID, .slope = slope);
}

hada_status hada_blend(hada_slot *slot, float a, const hada_tensor *x, float b, const hada_tensor *y, hada_error *err)
{
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    return hada_launch_net_blend(slot, HADA_PROGRAM_OF_LAYER(NET_ELEMENTWISE, slot, x->block), &grid.range, err,
                                 .x = x->mem, .y = y->mem, .at_x = hada_layout_of(x), .at_y = hada_layout_of(y),
                                 .span = grid.span, .a = a, .b = b);
}

hada_status hada_dropout(hada_slot *slot, float p, uint64_t seed, uint64_t step, const hada_tensor *x,
                         const hada_tensor *y, hada_error *err)
{
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

hada_status hada_place(hada_slot *slot, const hada_tensor *x, const hada_tensor *y, int row, int col, int first_channel,
                       int accumulate, hada_error *err)
{
    const hada_placing to = {row, col, 0, first_channel, x->channels, accumulate};
    return place(slot, x, y, &to, err);
}

hada_status hada_place_backward(hada_slot *slot, const hada_tensor *dy, const hada_tensor *dx, int row, int col,
                                int first_channel, int accumulate, hada_error *err)
{
    const hada_placing to = {-row, -col, first_channel, 0, dx->channels, accumulate};
    return place(slot, dy, dx, &to, err);
}

/* Pooling. */

hada_status hada_pool_forward(hada_slot *slot, hada_pool pool, int size, int stride, const hada_tensor *x,
                              const hada_tensor *y, hada_error *err)
{
    const hada_layer_grid grid = hada_layer_grid_of(slot, y, y->rows, y->cols);
    const hada_tensor_layout at_x = hada_layout_of(x), at_y = hada_layout_of(y);
    const hada_pool_window windows = {size, stride};
    const hada_program_net_pool program = HADA_PROGRAM_OF_LAYER(NET_POOL, slot, x->block);
    return hada_launch_net_pool_forward(slot, program, &grid.range, err, .x = x->mem, .y = y->mem, .at_x = at_x,
                                        .at_y = at_y, .span = grid.span, .windows = windows,
                                        .mean = pool != HADA_POOL_MAX);
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

/* Resizing. */

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
static hada_status check_countable(int rows, int cols, int to_rows, int to_cols, hada_error *err)
{
    if (2 * ((double)to_rows + 2.0) * ((double)rows + 2.0) >= (double)INT_MAX ||
        2 * ((double)to_cols + 2.0) * ((double)cols + 2.0) >= (double)INT_MAX)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "resizing from %d x %d to %d x %d: too large", rows, cols,
                         to_rows, to_cols);
    return HADA_OK;
}

hada_status hada_resize_forward(hada_slot *slot, hada_resize resize, const hada_tensor *x, const hada_tensor *y,
                                hada_error *err)
{
    HADA_TRY(check_countable(x->rows, x->cols, y->rows, y->cols, err));
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
    HADA_TRY(check_countable(from->rows, from->cols, to->rows, to->cols, err));
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
    HADA_TRY(check_countable(dx->rows, dx->cols, dy->rows, dy->cols, err));
    const hada_layer_grid grid = hada_layer_grid_of(slot, dx, dx->rows, dx->cols);
    return hada_launch_net_resize_backward(slot, HADA_PROGRAM_OF_LAYER(NET_RESIZE, slot, dx->block), &grid.range, err,
                                           .dy = dy->mem, .dx = dx->mem, .at_dy = hada_layout_of(dy),
                                           .at_dx = hada_layout_of(dx), .span = grid.span, .rule = rule_of(resize),
                                           .taps = taps_of(resize), .accumulate = accumulate);
}

/* Fully connected layers. */

/* Inputs whose weights' gradients a work-item works out on CPUs: a piece of a row that stays in the nearest cache. */
enum { RUN = 2048 };

/* Work-items of a group: macro of the device's program. */
static size_t group_of(const hada_slot *slot)
{
    return (size_t)hada_macros_of_net_linear(hada_program_net_linear_of(slot))->linear_group;
}

/* Images side by side; on CPUs a work-item takes them one after the other. */
static size_t lines_of(const hada_slot *slot, const hada_linear *shape)
{
    return hada_slot_in_groups(slot) ? hada_divide_up((size_t)shape->images, HADA_LINEAR_IMAGES) : 1;
}

static hada_linear_layout linear_layout(const hada_linear *shape, hada_floats w, hada_floats bias, hada_floats x,
                                        hada_floats y)
{
    return (hada_linear_layout){.w = w.offset,
                                .bias = bias.offset,
                                .x = x.offset,
                                .y = y.offset,
                                .images = shape->images,
                                .in = shape->in,
                                .out = shape->out,
                                .has_bias = bias.mem != NULL};
}

hada_status hada_linear_forward(hada_slot *slot, const hada_linear *shape, hada_floats w, hada_floats bias,
                                hada_floats x, hada_floats y, hada_error *err)
{
    const hada_range range = hada_range_groups(hada_divide_up((size_t)shape->out, HADA_LINEAR_OUTPUTS), group_of(slot),
                                               lines_of(slot, shape), 1);
    return hada_launch_net_linear_forward(slot, hada_program_net_linear_of(slot), &range, err, .w = w.mem,
                                          .bias = bias.mem ? bias.mem : w.mem, .x = x.mem, .y = y.mem,
                                          .at = linear_layout(shape, w, bias, x, y));
}

hada_status hada_linear_backward_data(hada_slot *slot, const hada_linear *shape, hada_floats w, hada_floats dy,
                                      hada_floats dx, hada_error *err)
{
    const size_t columns = hada_slot_in_groups(slot) ? 1 : HADA_LINEAR_COLUMNS;
    const hada_range range =
        hada_range_of(hada_divide_up((size_t)shape->in, columns), group_of(slot), lines_of(slot, shape), 1);
    return hada_launch_net_linear_data(slot, hada_program_net_linear_of(slot), &range, err, .w = w.mem, .dy = dy.mem,
                                       .dx = dx.mem, .at = linear_layout(shape, w, (hada_floats){0}, dx, dy));
}

hada_status hada_linear_backward_weights(hada_slot *slot, const hada_linear *shape, hada_floats x, hada_floats dy,
                                         hada_floats dw, hada_floats dbias, int accumulate, hada_error *err)
{
    const int run = hada_slot_in_groups(slot) ? 1 : RUN;
    const hada_program_net_linear program = hada_program_net_linear_of(slot);
    const hada_linear_layout at = linear_layout(shape, dw, dbias, x, dy);
    const hada_range weights =
        hada_range_of(hada_divide_up((size_t)shape->in, (size_t)run), group_of(slot), (size_t)shape->out, 1);
    const hada_range biases = hada_range_of((size_t)shape->out, group_of(slot), 1, 1);
    HADA_TRY(hada_launch_net_linear_weights(slot, program, &weights, err, .x = x.mem, .dy = dy.mem, .dw = dw.mem,
                                            .at = at, .run = run, .accumulate = accumulate));
    if (dbias.mem)
        HADA_TRY(hada_launch_net_linear_bias(slot, program, &biases, err, .dy = dy.mem, .dbias = dbias.mem, .at = at,
                                             .accumulate = accumulate));
    return HADA_OK;
}
