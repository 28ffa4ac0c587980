/* Batch normalisation. */
#include "net/layer_launch.h"

/* As NET_MERGE in net_batch_norm.cl. */
#define MERGE 32

static size_t divide_up(size_t a, size_t b)
{
    return (a + b - 1) / b;
}

/* Floats that a chain of sums of `vectors` values per channel takes, from `parts` parts of a block down to one. */
static size_t chain_floats(const hada_tensor *x, size_t parts, size_t vectors)
{
    size_t all = parts;
    while (parts > 1)
        all += parts = divide_up(parts, MERGE);
    return all * vectors * (size_t)hada_tensor_blocks(x) * (size_t)x->block;
}

size_t hada_batch_norm_scratch(const hada_tensor *x)
{
    return chain_floats(x, hada_layer_items_at_most(x) / (size_t)hada_tensor_blocks(x), 3) * sizeof(float);
}

/* Parts of a block of channels: work-items and images. */
static size_t parts_of(const hada_tensor *x, const hada_layer_grid *grid)
{
    return hada_layer_grid_items(grid) / (size_t)hada_tensor_blocks(x);
}

/* Joins the parts at the beginning of scratch until one is left, which stands at *place. */
static hada_status join(hada_slot *slot, const char *kernel, const hada_tensor *x, size_t parts, size_t vectors,
                        cl_mem scratch, cl_ulong *place, hada_error *err)
{
    hada_status status = HADA_OK;
    const size_t blocks = (size_t)hada_tensor_blocks(x);
    *place = 0;
    while (parts > 1) {
        const size_t fewer = divide_up(parts, MERGE);
        const cl_ulong in_offset = *place, out_offset = in_offset + parts * vectors * blocks * (size_t)x->block;
        const cl_uint in_count = (cl_uint)parts, out_count = (cl_uint)fewer;
        const hada_arg args[] = {HADA_ARG(scratch), HADA_ARG(in_offset), HADA_ARG(in_count), HADA_ARG(out_offset),
                                 HADA_ARG(out_count)};
        HADA_TRY(hada_layer_launch_flat(slot, "net_batch_norm", kernel, x->block, fewer, blocks, args, HADA_COUNT(args),
                                        err));
        parts = fewer;
        *place = out_offset;
    }
done:
    return status;
}

/* `second`: the variance, or 1 / sqrt(variance + eps). */
static hada_status apply(hada_slot *slot, const hada_batch_norm *norm, const hada_tensor *x, const hada_tensor *y,
                         hada_floats mean, hada_floats second, int is_variance, hada_error *err)
{
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_tensor_place at_x = hada_tensor_place_of(x), at_y = hada_tensor_place_of(y);
    const cl_int blocks = hada_tensor_blocks(x), variance = is_variance;
    const cl_ulong weight = norm->weight_offset, bias = norm->bias_offset, first = mean.offset, other = second.offset;
    const hada_arg args[] = {HADA_ARG_TENSOR(x, at_x), HADA_ARG_TENSOR(y, at_y), HADA_ARG(x->rows),
                             HADA_ARG(x->cols),        HADA_ARG(blocks),         HADA_ARG(grid.span),
                             HADA_ARG(x->channels),    HADA_ARG(norm->weight),   HADA_ARG(weight),
                             HADA_ARG(norm->bias),     HADA_ARG(bias),           HADA_ARG(mean.mem),
                             HADA_ARG(first),          HADA_ARG(second.mem),     HADA_ARG(other),
                             HADA_ARG(variance),       HADA_ARG(norm->eps)};
    return hada_layer_launch(slot, "net_batch_norm", "net_batch_norm_apply", x, &grid, args, HADA_COUNT(args), err);
}

hada_status hada_batch_norm_infer(hada_slot *slot, const hada_batch_norm *norm, const hada_tensor *x,
                                  const hada_tensor *y, hada_error *err)
{
    hada_status status = hada_layer_check("batch normalisation", x, y, 1, err);
    if (status)
        return status;
    const hada_floats mean = {norm->mean, norm->mean_offset}, variance = {norm->variance, norm->variance_offset};
    return apply(slot, norm, x, y, mean, variance, 1, err);
}

/* The batch's mean and 1 / sqrt(variance + eps) into saved; the running values. */
static hada_status measure(hada_slot *slot, const hada_batch_norm *norm, const hada_tensor *x, hada_floats saved,
                           cl_mem scratch, hada_error *err)
{
    hada_status status = HADA_OK;
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_tensor_place at_x = hada_tensor_place_of(x);
    const cl_int blocks = hada_tensor_blocks(x);
    const size_t parts = parts_of(x, &grid);
    const cl_uint part_count = (cl_uint)parts;
    const hada_arg args[] = {HADA_ARG_TENSOR(x, at_x), HADA_ARG(x->rows), HADA_ARG(x->cols),   HADA_ARG(blocks),
                             HADA_ARG(grid.span),      HADA_ARG(scratch), HADA_ARG(part_count)};
    cl_ulong place;
    HADA_TRY(
        hada_layer_launch(slot, "net_batch_norm", "net_batch_norm_statistics", x, &grid, args, HADA_COUNT(args), err));
    HADA_TRY(join(slot, "net_batch_norm_merge", x, parts, 3, scratch, &place, err));
    const cl_ulong to = saved.offset, mean = norm->mean_offset, variance = norm->variance_offset;
    const hada_arg ends[] = {
        HADA_ARG(scratch),        HADA_ARG(place),          HADA_ARG(x->channels), HADA_ARG(norm->eps),
        HADA_ARG(norm->momentum), HADA_ARG(saved.mem),      HADA_ARG(to),          HADA_ARG(norm->mean),
        HADA_ARG(mean),           HADA_ARG(norm->variance), HADA_ARG(variance)};
    HADA_TRY(hada_layer_launch_flat(slot, "net_batch_norm", "net_batch_norm_finish", x->block, (size_t)x->channels, 1,
                                    ends, HADA_COUNT(ends), err));
done:
    return status;
}

hada_status hada_batch_norm_train(hada_slot *slot, const hada_batch_norm *norm, const hada_tensor *x,
                                  const hada_tensor *y, cl_mem saved, size_t saved_offset, cl_mem scratch,
                                  hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(hada_layer_check("batch normalisation", x, y, 1, err));
    if ((double)x->images * x->rows * x->cols < 2.0)
        HADA_TRY(hada_fail(err, HADA_ERROR_SIZE,
                           "batch normalisation cannot learn from one value per channel: it "
                           "needs more images or pixels"));
    const hada_floats mean = {saved, saved_offset}, inverse = {saved, saved_offset + (size_t)x->channels};
    HADA_TRY(measure(slot, norm, x, mean, scratch, err));
    HADA_TRY(apply(slot, norm, x, y, mean, inverse, 0, err));
done:
    return status;
}

/* The sums of dy and of dy times the normalised x, at *place of scratch. */
static hada_status gradient_sums(hada_slot *slot, const hada_tensor *x, hada_floats saved, const hada_tensor *dy,
                                 cl_mem scratch, cl_ulong *place, hada_error *err)
{
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_tensor_place at_x = hada_tensor_place_of(x), at_dy = hada_tensor_place_of(dy);
    const cl_int blocks = hada_tensor_blocks(x);
    const size_t parts = parts_of(x, &grid);
    const cl_uint part_count = (cl_uint)parts;
    const cl_ulong from = saved.offset;
    const hada_arg args[] = {HADA_ARG_TENSOR(x, at_x), HADA_ARG_TENSOR(dy, at_dy), HADA_ARG(x->rows),
                             HADA_ARG(x->cols),        HADA_ARG(blocks),           HADA_ARG(grid.span),
                             HADA_ARG(x->channels),    HADA_ARG(saved.mem),        HADA_ARG(from),
                             HADA_ARG(scratch),        HADA_ARG(part_count)};
    hada_status status =
        hada_layer_launch(slot, "net_batch_norm", "net_batch_norm_gradients", x, &grid, args, HADA_COUNT(args), err);
    return status ? status : join(slot, "net_batch_norm_add", x, parts, 2, scratch, place, err);
}

hada_status hada_batch_norm_backward(hada_slot *slot, const hada_batch_norm *norm, const hada_tensor *x, cl_mem saved,
                                     size_t saved_offset, const hada_tensor *dy, const hada_tensor *dx, cl_mem dweight,
                                     size_t dweight_offset, cl_mem dbias, size_t dbias_offset, int accumulate,
                                     cl_mem scratch, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY(hada_layer_check("batch normalisation", x, dy, 1, err));
    HADA_TRY(hada_layer_check("batch normalisation", x, dx, 1, err));
    cl_ulong place;
    HADA_TRY(gradient_sums(slot, x, (hada_floats){saved, saved_offset}, dy, scratch, &place, err));
    const cl_ulong to_weight = dweight_offset, to_bias = dbias_offset, from = saved_offset;
    const cl_ulong weight = norm->weight_offset;
    const cl_int add = accumulate, blocks = hada_tensor_blocks(x);
    const hada_arg ends[] = {HADA_ARG(scratch),   HADA_ARG(place), HADA_ARG(x->channels), HADA_ARG(dweight),
                             HADA_ARG(to_weight), HADA_ARG(dbias), HADA_ARG(to_bias),     HADA_ARG(add)};
    HADA_TRY(hada_layer_launch_flat(slot, "net_batch_norm", "net_batch_norm_weights", x->block, (size_t)x->channels, 1,
                                    ends, HADA_COUNT(ends), err));
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_tensor_place at_x = hada_tensor_place_of(x), at_dy = hada_tensor_place_of(dy);
    const hada_tensor_place at_dx = hada_tensor_place_of(dx);
    const cl_float per_value = (cl_float)(1.0 / ((double)x->images * x->rows * x->cols));
    const hada_arg args[] = {HADA_ARG_TENSOR(x, at_x),
                             HADA_ARG_TENSOR(dy, at_dy),
                             HADA_ARG_TENSOR(dx, at_dx),
                             HADA_ARG(x->rows),
                             HADA_ARG(x->cols),
                             HADA_ARG(blocks),
                             HADA_ARG(grid.span),
                             HADA_ARG(x->channels),
                             HADA_ARG(saved),
                             HADA_ARG(from),
                             HADA_ARG(norm->weight),
                             HADA_ARG(weight),
                             HADA_ARG(scratch),
                             HADA_ARG(place),
                             HADA_ARG(per_value)};
    HADA_TRY(
        hada_layer_launch(slot, "net_batch_norm", "net_batch_norm_backward", x, &grid, args, HADA_COUNT(args), err));
done:
    return status;
}
