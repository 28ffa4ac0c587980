/* Fully connected layers. */
#include "net/layer_launch.h"
#include "runtime/kernel.h"

/* As in net_linear.cl. */
enum { COLUMNS = 256, IMAGES = 4, OUTPUTS = 4, GROUP = 64, RUN = 2048 };

static size_t divide_up(size_t a, size_t b)
{
    return (a + b - 1) / b;
}

/* A kernel over `items` things (`summed`: a work-group for each, on GPUs) times `lines`. */
static hada_status launch(hada_slot *slot, const char *name, size_t items, size_t lines, int summed,
                          const hada_arg *args, size_t arg_count, hada_error *err)
{
    const int groups = slot->context->shape == HADA_SHAPE_GROUPS;
    const size_t local[2] = {groups ? GROUP : 1, 1};
    const size_t global[2] = {groups && summed ? items * GROUP : divide_up(items, local[0]) * local[0], lines};
    cl_kernel kernel;
    hada_status status =
        hada_slot_kernel(slot, "net_linear", name, groups ? "-DLINEAR_WIDTH=1 -DLINEAR_GROUP=64" : "", &kernel, err);
    return status ? status : hada_slot_launch(slot, kernel, name, 2, global, local, args, arg_count, err);
}

/* Images side by side; on CPUs a work-item takes them one after the other. */
static size_t lines_of(const hada_slot *slot, const hada_linear *shape)
{
    return slot->context->shape == HADA_SHAPE_GROUPS ? divide_up((size_t)shape->images, IMAGES) : 1;
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
    const cl_ulong at_w = w.offset, at_bias = bias.offset, at_x = x.offset, at_y = y.offset;
    const cl_int has_bias = bias.mem != NULL;
    const cl_mem some_bias = has_bias ? bias.mem : w.mem;
    const hada_arg args[] = {HADA_ARG(w.mem),    HADA_ARG(at_w),          HADA_ARG(some_bias), HADA_ARG(at_bias),
                             HADA_ARG(has_bias), HADA_ARG(x.mem),         HADA_ARG(at_x),      HADA_ARG(y.mem),
                             HADA_ARG(at_y),     HADA_ARG(shape->images), HADA_ARG(shape->in), HADA_ARG(shape->out)};
    return launch(slot, "net_linear_forward", divide_up((size_t)shape->out, OUTPUTS), lines_of(slot, shape), 1, args,
                  HADA_COUNT(args), err);
}

hada_status hada_linear_backward_data(hada_slot *slot, const hada_linear *shape, hada_floats w, hada_floats dy,
                                      hada_floats dx, hada_error *err)
{
    hada_status status = check_linear(shape, err);
    if (status)
        return status;
    const cl_ulong at_w = w.offset, at_dy = dy.offset, at_dx = dx.offset;
    const hada_arg args[] = {HADA_ARG(w.mem),         HADA_ARG(at_w),      HADA_ARG(dy.mem),
                             HADA_ARG(at_dy),         HADA_ARG(dx.mem),    HADA_ARG(at_dx),
                             HADA_ARG(shape->images), HADA_ARG(shape->in), HADA_ARG(shape->out)};
    const size_t columns = slot->context->shape == HADA_SHAPE_GROUPS ? 1 : COLUMNS;
    return launch(slot, "net_linear_data", divide_up((size_t)shape->in, columns), lines_of(slot, shape), 0, args,
                  HADA_COUNT(args), err);
}

hada_status hada_linear_backward_weights(hada_slot *slot, const hada_linear *shape, hada_floats x, hada_floats dy,
                                         hada_floats dw, hada_floats dbias, int accumulate, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(check_linear(shape, err));
    const cl_ulong at_x = x.offset, at_dy = dy.offset, at_dw = dw.offset, at_dbias = dbias.offset;
    const cl_int run = slot->context->shape == HADA_SHAPE_GROUPS ? 1 : RUN, add = accumulate;
    const hada_arg args[] = {HADA_ARG(x.mem),         HADA_ARG(at_x),      HADA_ARG(dy.mem),
                             HADA_ARG(at_dy),         HADA_ARG(dw.mem),    HADA_ARG(at_dw),
                             HADA_ARG(shape->images), HADA_ARG(shape->in), HADA_ARG(shape->out),
                             HADA_ARG(run),           HADA_ARG(add)};
    HADA_TRY(launch(slot, "net_linear_weights", divide_up((size_t)shape->in, (size_t)run), (size_t)shape->out, 0, args,
                    HADA_COUNT(args), err));
    if (status || !dbias.mem)
        return status;
    const hada_arg ends[] = {HADA_ARG(dy.mem),        HADA_ARG(at_dy),      HADA_ARG(dbias.mem), HADA_ARG(at_dbias),
                             HADA_ARG(shape->images), HADA_ARG(shape->out), HADA_ARG(add)};
    HADA_TRY(launch(slot, "net_linear_bias", (size_t)shape->out, 1, 0, ends, HADA_COUNT(ends), err));
done:
    return status;
}
