/* Fully connected layers. */
#include "launch/net_linear.h"
#include "net/layer_launch.h"

/* Inputs whose weights' gradients a work-item works out on CPUs: a piece of a row that stays in the nearest cache. */
enum { RUN = 2048 };

static int has_groups(const hada_slot *slot)
{
    return slot->context->shape == HADA_SHAPE_GROUPS;
}

/* Work-items of a group: macro of the device's program. */
static size_t group_of(const hada_slot *slot)
{
    return (size_t)hada_macros_of_net_linear(hada_program_net_linear_of(slot))->linear_group;
}

/* Images side by side; on CPUs a work-item takes them one after the other. */
static size_t lines_of(const hada_slot *slot, const hada_linear *shape)
{
    return has_groups(slot) ? hada_divide_up((size_t)shape->images, HADA_LINEAR_IMAGES) : 1;
}

static hada_linear_layout layout_of(const hada_linear *shape, hada_floats w, hada_floats bias, hada_floats x,
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

static hada_status check_linear(const hada_linear *shape, hada_error *err)
{
    if (shape->images < 1 || shape->in < 1 || shape->out < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "a fully connected layer of %d inputs and %d outputs for %d images "
                         "is not possible",
                         shape->in, shape->out, shape->images);
    return HADA_OK;
}

hada_status hada_linear_forward(hada_slot *slot, const hada_linear *shape, hada_floats w, hada_floats bias,
                                hada_floats x, hada_floats y, hada_error *err)
{
    hada_status status = check_linear(shape, err);
    if (status)
        return status;
    const hada_range range = hada_range_groups(hada_divide_up((size_t)shape->out, HADA_LINEAR_OUTPUTS), group_of(slot),
                                               lines_of(slot, shape), 1);
    return hada_launch_net_linear_forward(slot, hada_program_net_linear_of(slot), &range, err, .w = w.mem,
                                          .bias = bias.mem ? bias.mem : w.mem, .x = x.mem, .y = y.mem,
                                          .at = layout_of(shape, w, bias, x, y));
}

hada_status hada_linear_backward_data(hada_slot *slot, const hada_linear *shape, hada_floats w, hada_floats dy,
                                      hada_floats dx, hada_error *err)
{
    hada_status status = check_linear(shape, err);
    if (status)
        return status;
    const size_t columns = has_groups(slot) ? 1 : HADA_LINEAR_COLUMNS;
    const hada_range range =
        hada_range_of(hada_divide_up((size_t)shape->in, columns), group_of(slot), lines_of(slot, shape), 1);
    return hada_launch_net_linear_data(slot, hada_program_net_linear_of(slot), &range, err, .w = w.mem, .dy = dy.mem,
                                       .dx = dx.mem, .at = layout_of(shape, w, (hada_floats){0}, dx, dy));
}

hada_status hada_linear_backward_weights(hada_slot *slot, const hada_linear *shape, hada_floats x, hada_floats dy,
                                         hada_floats dw, hada_floats dbias, int accumulate, hada_error *err)
{
    HADA_TRY(check_linear(shape, err));
    const int run = has_groups(slot) ? 1 : RUN;
    const hada_program_net_linear program = hada_program_net_linear_of(slot);
    const hada_linear_layout at = layout_of(shape, dw, dbias, x, dy);
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
