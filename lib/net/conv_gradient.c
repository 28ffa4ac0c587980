/* Launches of the gradients of weights and biases: partial sums, then their sum in order. */
#include "core/alloc.h"
#include "launch/conv_group_reduce.h"
#include "launch/conv_group_weights.h"
#include "launch/conv_plain.h"
#include "launch/conv_reduce.h"
#include "launch/conv_weights.h"
#include "net/conv_internal.h"

enum { LOCAL = 8 }; /* work-items of a group where each works alone */

hada_conv_correlation hada_conv_correlation_of(const hada_conv *conv, const hada_tensor *coarse,
                                               const hada_tensor *fine)
{
    const hada_conv_desc *d = &conv->plan.desc;
    const hada_conv_gradient *g = &conv->plan.gradient;
    return (hada_conv_correlation){.coarse = hada_layout_of(coarse),
                                   .fine = hada_layout_of(fine),
                                   .images = coarse->images,
                                   .kernel_cols = d->kernel_cols,
                                   .places = d->kernel_rows * d->kernel_cols,
                                   .pad_rows = d->pad_rows,
                                   .pad_cols = d->pad_cols,
                                   .stride = d->stride,
                                   .strip_rows = g->strip_rows,
                                   .fine_groups = g->fine_groups,
                                   .tiles = g->tiles};
}

static hada_status plain_weights(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, hada_floats dw,
                                 int accumulate, hada_error *err)
{
    const hada_conv_correlation sizes = hada_conv_correlation_of(conv, coarse, fine);
    const hada_range range =
        hada_range_of((size_t)fine->channels * (size_t)sizes.places, LOCAL, (size_t)coarse->channels, 1);
    return hada_launch_conv_plain_weights(conv->slot, HADA_PROGRAM_BY_BLOCK(CONV_PLAIN, conv->plan.block), &range, err,
                                          .coarse = coarse->mem, .fine = fine->mem, .dw = dw.mem, .sizes = sizes,
                                          .dw_offset = dw.offset, .accumulate = accumulate);
}

static hada_status partial_weights(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, size_t parts,
                                   hada_error *err)
{
    const hada_conv_gradient *g = &conv->plan.gradient;
    const hada_conv_correlation sizes = hada_conv_correlation_of(conv, coarse, fine);
    const size_t items = (size_t)(sizes.places / (g->rows_each * g->cols_each)) * (size_t)g->fine_groups;
    const hada_range range =
        hada_range_groups(items, conv->plan.groups ? HADA_CONV_GRADIENT_ITEMS : 1, (size_t)g->coarse_groups, parts);
    if (conv->plan.groups)
        return hada_launch_conv_group_weights(conv->slot, HADA_PROGRAM_BY_BLOCK(CONV_GROUP_WEIGHTS, conv->plan.block),
                                              &range, err, .coarse = coarse->mem, .fine = fine->mem,
                                              .partial = conv->scratch.mem, .sizes = sizes);
    return hada_launch_conv_weights(conv->slot, (hada_program_conv_weights)g->program, &range, err,
                                    .coarse = coarse->mem, .fine = fine->mem, .partial = conv->scratch.mem,
                                    .sizes = sizes);
}

static hada_status reduce_lanes(hada_conv *conv, const hada_tensor *coarse, hada_floats dw,
                                const hada_conv_partials *sizes, int accumulate, hada_error *err)
{
    const hada_range range =
        hada_range_of((size_t)sizes->fine_channels, LOCAL, (size_t)hada_layout_of(coarse).blocks, 1);
    return hada_launch_conv_reduce_weights(conv->slot, HADA_PROGRAM_BY_BLOCK(CONV_REDUCE, conv->plan.block), &range,
                                           err, .partial = conv->scratch.mem, .dw = dw.mem, .sizes = *sizes,
                                           .dw_offset = dw.offset, .accumulate = accumulate);
}

static hada_status reduce_groups(hada_conv *conv, const hada_tensor *coarse, hada_floats dw,
                                 const hada_conv_partials *sizes, int accumulate, hada_error *err)
{
    const size_t fours = (size_t)conv->plan.block / 4 * (size_t)sizes->places;
    const hada_range range = hada_range_of((size_t)sizes->fine_channels * fours, HADA_CONV_GROUP_ITEMS,
                                           (size_t)hada_layout_of(coarse).blocks, 1);
    return hada_launch_conv_group_reduce_weights(conv->slot, HADA_PROGRAM_BY_BLOCK(CONV_GROUP_REDUCE, conv->plan.block),
                                                 &range, err, .partial = conv->scratch.mem, .dw = dw.mem,
                                                 .sizes = *sizes, .dw_offset = dw.offset, .accumulate = accumulate);
}

hada_status hada_conv_weights(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, hada_floats dw,
                              int accumulate, hada_error *err)
{
    const hada_conv_desc *d = &conv->plan.desc;
    const hada_conv_gradient *g = &conv->plan.gradient;
    const int groups = conv->plan.groups, block = conv->plan.block;
    if (g->method == HADA_CONV_PLAIN)
        return plain_weights(conv, coarse, fine, dw, accumulate, err);
    if (g->swapped) {
        const hada_tensor *was = fine;
        fine = coarse;
        coarse = was;
    }
    /* every part has a strip at least */
    const int strips = coarse->images * ((coarse->rows + g->strip_rows - 1) / g->strip_rows);
    const hada_conv_partials sizes = {
        .parts = g->parts < strips ? g->parts : strips,
        .blocks = g->coarse_groups * (groups ? HADA_CONV_GRADIENT_LANES / block : g->blocks),
        .fine_filled = g->fine_groups * (groups ? HADA_CONV_GRADIENT_LANES : g->fine_each),
        .places = d->kernel_rows * d->kernel_cols,
        .coarse_channels = coarse->channels,
        .fine_channels = fine->channels,
        .swapped = g->swapped};
    HADA_TRY(partial_weights(conv, coarse, fine, (size_t)sizes.parts, err));
    return groups ? reduce_groups(conv, coarse, dw, &sizes, accumulate, err)
                  : reduce_lanes(conv, coarse, dw, &sizes, accumulate, err);
}

hada_status hada_conv_reduce_bias(hada_conv *conv, size_t scratch_offset, int parts, int channels, hada_floats db,
                                  int accumulate, hada_error *err)
{
    const int block = conv->plan.block;
    const hada_range range = hada_range_of((size_t)channels, LOCAL, 1, 1);
    const int program = hada_find_conv_reduce(.net_block = block, .conv_partials = !conv->plan.groups);
    return hada_launch_conv_reduce_bias(
        conv->slot, (hada_program_conv_reduce)program, &range, err, .partial = conv->scratch.mem, .db = db.mem,
        .offset = scratch_offset, .db_offset = db.offset, .parts = parts, .blocks = (channels + block - 1) / block,
        .channels = channels, .accumulate = accumulate);
}

hada_status hada_conv_bias(hada_conv *conv, const hada_tensor *dy, hada_floats db, int accumulate, hada_error *err)
{
    const int lines = dy->images * dy->rows, most = conv->plan.gradient.bias_parts;
    const int parts = most < lines ? most : lines;
    const hada_tensor_layout at_dy = hada_layout_of(dy);
    const hada_range range = hada_range_of((size_t)at_dy.blocks, 1, (size_t)parts, 1);
    const hada_range groups = hada_range_groups(1, HADA_CONV_GROUP_ITEMS, (size_t)at_dy.blocks, (size_t)parts);
    if (conv->plan.groups)
        HADA_TRY(hada_launch_conv_group_bias(conv->slot, HADA_PROGRAM_BY_BLOCK(CONV_GROUP_REDUCE, conv->plan.block),
                                             &groups, err, .dy = dy->mem, .partial = conv->scratch.mem, .at_dy = at_dy,
                                             .images = dy->images));
    else
        HADA_TRY(hada_launch_conv_bias_partial(conv->slot, HADA_PROGRAM_BY_BLOCK(CONV_REDUCE, conv->plan.block), &range,
                                               err, .dy = dy->mem, .partial = conv->scratch.mem, .at_dy = at_dy,
                                               .images = dy->images));
    return hada_conv_reduce_bias(conv, 0, parts, dy->channels, db, accumulate, err);
}
