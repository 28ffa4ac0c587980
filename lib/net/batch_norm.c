/* Batch normalisation. */
#include "launch/net_batch_norm.h"
#include "net/layer_launch.h"

/* Floats that a chain of sums of `vectors` values per channel takes, from `parts` parts of a block down to one. */
static size_t chain_floats(const hada_tensor *x, size_t parts, size_t vectors)
{
    size_t all = parts;
    while (parts > 1)
        all += parts = hada_divide_up(parts, HADA_NORM_MERGE);
    return all * vectors * (size_t)hada_layout_of(x).blocks * (size_t)x->block;
}

size_t hada_batch_norm_scratch(const hada_tensor *x)
{
    return chain_floats(x, hada_layer_sums_at_most(x) / (size_t)hada_layout_of(x).blocks, 3) * sizeof(float);
}

/* Parts of a block of channels: sums of the launch and images. */
static size_t parts_of(const hada_tensor *x, const hada_layer_grid *grid)
{
    return hada_layer_grid_sums(grid) / (size_t)hada_layout_of(x).blocks;
}

/* How a chain of sums goes on: from parts to fewer parts. */
typedef struct merging {
    size_t from, to; /* where they begin in scratch */
    size_t parts, fewer;
} merging;

/* The means, or the sums, of runs of parts. */
typedef hada_status merge_parts(hada_slot *slot, const hada_tensor *x, cl_mem scratch, const merging *m,
                                hada_error *err);

static hada_range merge_range(const hada_slot *slot, const hada_tensor *x, const merging *m)
{
    const size_t shares = slot->context->shape == HADA_SHAPE_GROUPS ? (size_t)x->block / HADA_LAYER_FOUR : 1;
    return hada_layer_flat_range(slot, m->fewer * shares, (size_t)hada_layout_of(x).blocks);
}

static hada_status merge_means(hada_slot *slot, const hada_tensor *x, cl_mem scratch, const merging *m, hada_error *err)
{
    const hada_range range = merge_range(slot, x, m);
    return hada_launch_net_batch_norm_merge(slot, HADA_PROGRAM_OF_LAYER(NET_BATCH_NORM, slot, x->block), &range, err,
                                            .parts = scratch, .in_offset = m->from, .in_count = (cl_uint)m->parts,
                                            .out_offset = m->to, .out_count = (cl_uint)m->fewer);
}

static hada_status merge_sums(hada_slot *slot, const hada_tensor *x, cl_mem scratch, const merging *m, hada_error *err)
{
    const hada_range range = merge_range(slot, x, m);
    return hada_launch_net_batch_norm_add(slot, HADA_PROGRAM_OF_LAYER(NET_BATCH_NORM, slot, x->block), &range, err,
                                          .parts = scratch, .in_offset = m->from, .in_count = (cl_uint)m->parts,
                                          .out_offset = m->to, .out_count = (cl_uint)m->fewer);
}

/* Joins the parts at the beginning of scratch, of `vectors` values per channel, until one is left, which stands at
 * *place. */
static hada_status join(hada_slot *slot, merge_parts *merge, const hada_tensor *x, size_t parts, size_t vectors,
                        cl_mem scratch, size_t *place, hada_error *err)
{
    const size_t part_floats = vectors * (size_t)hada_layout_of(x).blocks * (size_t)x->block;
    *place = 0;
    while (parts > 1) {
        const merging m = {*place, *place + parts * part_floats, parts, hada_divide_up(parts, HADA_NORM_MERGE)};
        HADA_TRY(merge(slot, x, scratch, &m, err));
        parts = m.fewer;
        *place = m.to;
    }
    return HADA_OK;
}

/* `second`: the variance, or 1 / sqrt(variance + eps). */
static hada_status apply(hada_slot *slot, const hada_batch_norm *norm, const hada_tensor *x, const hada_tensor *y,
                         hada_floats mean, hada_floats second, int is_variance, hada_error *err)
{
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_norm_values at = {.weight = norm->weight.offset,
                                 .bias = norm->bias.offset,
                                 .mean = mean.offset,
                                 .second = second.offset,
                                 .is_variance = is_variance,
                                 .eps = norm->eps,
                                 .span = grid.span};
    return hada_launch_net_batch_norm_apply(slot, HADA_PROGRAM_OF_LAYER(NET_BATCH_NORM, slot, x->block), &grid.range,
                                            err, .x = x->mem, .y = y->mem, .weight = norm->weight.mem,
                                            .bias = norm->bias.mem, .mean = mean.mem, .second = second.mem,
                                            .at_x = hada_layout_of(x), .at_y = hada_layout_of(y), .at = at);
}

hada_status hada_batch_norm_infer(hada_slot *slot, const hada_batch_norm *norm, const hada_tensor *x,
                                  const hada_tensor *y, hada_error *err)
{
    return apply(slot, norm, x, y, norm->mean, norm->variance, 1, err);
}

/* The batch's mean and 1 / sqrt(variance + eps) into saved; the running values. */
static hada_status measure(hada_slot *slot, const hada_batch_norm *norm, const hada_tensor *x, hada_floats saved,
                           cl_mem scratch, hada_error *err)
{
    const hada_layer_grid grid = hada_layer_sum_grid_of(slot, x);
    const hada_range channels = hada_layer_flat_range(slot, (size_t)x->channels, 1);
    const hada_program_net_batch_norm program = HADA_PROGRAM_OF_LAYER(NET_BATCH_NORM, slot, x->block);
    const size_t parts = parts_of(x, &grid);
    const hada_norm_values at = {.mean = norm->mean.offset, .second = norm->variance.offset, .eps = norm->eps};
    size_t place;
    HADA_TRY(hada_launch_net_batch_norm_statistics(slot, program, &grid.range, err, .x = x->mem, .parts = scratch,
                                                   .at_x = hada_layout_of(x), .span = grid.span,
                                                   .part_count = (cl_uint)parts));
    HADA_TRY(join(slot, merge_means, x, parts, 3, scratch, &place, err));
    return hada_launch_net_batch_norm_finish(slot, program, &channels, err, .parts = scratch, .saved = saved.mem,
                                             .mean = norm->mean.mem, .variance = norm->variance.mem,
                                             .parts_offset = place, .saved_offset = saved.offset,
                                             .channels = x->channels, .momentum = norm->momentum, .at = at);
}

hada_status hada_batch_norm_train(hada_slot *slot, const hada_batch_norm *norm, const hada_tensor *x,
                                  const hada_tensor *y, hada_floats saved, cl_mem scratch, hada_error *err)
{
    if ((double)x->images * x->rows * x->cols < 2.0)
        HADA_TRY(hada_fail(err, HADA_ERROR_SIZE,
                           "batch normalisation cannot learn from one value per channel: it "
                           "needs more images or pixels"));
    const hada_floats inverse = {saved.mem, saved.offset + (size_t)x->channels};
    HADA_TRY(measure(slot, norm, x, saved, scratch, err));
    return apply(slot, norm, x, y, saved, inverse, 0, err);
}

/* The sums of dy and of dy times the normalised x, at *place of scratch. */
static hada_status gradient_sums(hada_slot *slot, const hada_tensor *x, hada_floats saved, const hada_tensor *dy,
                                 cl_mem scratch, size_t *place, hada_error *err)
{
    const hada_layer_grid grid = hada_layer_sum_grid_of(slot, x);
    const size_t parts = parts_of(x, &grid);
    HADA_TRY(hada_launch_net_batch_norm_gradients(
        slot, HADA_PROGRAM_OF_LAYER(NET_BATCH_NORM, slot, x->block), &grid.range, err, .x = x->mem, .dy = dy->mem,
        .saved = saved.mem, .parts = scratch, .at_x = hada_layout_of(x), .at_dy = hada_layout_of(dy),
        .saved_offset = saved.offset, .span = grid.span, .part_count = (cl_uint)parts));
    return join(slot, merge_sums, x, parts, 2, scratch, place, err);
}

hada_status hada_batch_norm_backward(hada_slot *slot, const hada_batch_norm *norm, const hada_tensor *x,
                                     hada_floats saved, const hada_tensor *dy, const hada_tensor *dx,
                                     hada_floats dweight, hada_floats dbias, int accumulate, cl_mem scratch,
                                     hada_error *err)
{
    size_t place;
    HADA_TRY(gradient_sums(slot, x, saved, dy, scratch, &place, err));
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_range channels = hada_layer_flat_range(slot, (size_t)x->channels, 1);
    const hada_program_net_batch_norm program = HADA_PROGRAM_OF_LAYER(NET_BATCH_NORM, slot, x->block);
    const hada_norm_gradient at = {.x = hada_layout_of(x),
                                   .dy = hada_layout_of(dy),
                                   .dx = hada_layout_of(dx),
                                   .saved = saved.offset,
                                   .weight = norm->weight.offset,
                                   .sums = place,
                                   .per_value = (cl_float)(1.0 / ((double)x->images * x->rows * x->cols)),
                                   .span = grid.span};
    HADA_TRY(hada_launch_net_batch_norm_weights(slot, program, &channels, err, .parts = scratch, .dweight = dweight.mem,
                                                .dbias = dbias.mem, .parts_offset = place,
                                                .dweight_offset = dweight.offset, .dbias_offset = dbias.offset,
                                                .channels = x->channels, .accumulate = accumulate));
    return hada_launch_net_batch_norm_backward(slot, program, &grid.range, err, .x = x->mem, .dy = dy->mem,
                                               .dx = dx->mem, .saved = saved.mem, .weight = norm->weight.mem,
                                               .parts = scratch, .at = at);
}
