/* Gradients of weights and biases: partial sums, then their sum in order; or by Winograd's tiles, part by part in local
 * memory or step by step. */
#include "launch/conv_group_weights.h"
#include "launch/conv_plain.h"
#include "launch/conv_reduce.h"
#include "launch/conv_weights.h"
#include "launch/conv_winograd_reduce.h"
#include "launch/conv_winograd_steps.h"
#include "launch/conv_winograd_weight_steps.h"
#include "launch/conv_winograd_weights.h"
#include "net/conv_plan.h"

enum { LOCAL = 8 }; /* work-items of a group where each works alone */

static hada_conv_correlation correlation_of(const hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine)
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
    const hada_conv_correlation sizes = correlation_of(conv, coarse, fine);
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
    const hada_conv_correlation sizes = correlation_of(conv, coarse, fine);
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

static hada_program_conv_reduce reduce_program(const hada_conv *conv)
{
    return (hada_program_conv_reduce)hada_find_conv_reduce(.net_block = conv->plan.block,
                                                           .conv_groups = conv->plan.groups);
}

static hada_status reduce_lanes(hada_conv *conv, const hada_tensor *coarse, hada_floats dw,
                                const hada_conv_partials *sizes, int accumulate, hada_error *err)
{
    const hada_range range =
        hada_range_of((size_t)sizes->fine_channels, LOCAL, (size_t)hada_layout_of(coarse).blocks, 1);
    return hada_launch_conv_reduce_weights(conv->slot, reduce_program(conv), &range, err, .partial = conv->scratch.mem,
                                           .dw = dw.mem, .sizes = *sizes, .dw_offset = dw.offset,
                                           .accumulate = accumulate);
}

static hada_status reduce_groups(hada_conv *conv, const hada_tensor *coarse, hada_floats dw,
                                 const hada_conv_partials *sizes, int accumulate, hada_error *err)
{
    const size_t fours = (size_t)conv->plan.block / 4 * (size_t)sizes->places;
    const hada_range range = hada_range_of((size_t)sizes->fine_channels * fours, HADA_CONV_GROUP_ITEMS,
                                           (size_t)hada_layout_of(coarse).blocks, 1);
    return hada_launch_conv_group_reduce_weights(conv->slot, reduce_program(conv), &range, err,
                                                 .partial = conv->scratch.mem, .dw = dw.mem, .sizes = *sizes,
                                                 .dw_offset = dw.offset, .accumulate = accumulate);
}

static hada_status weights_of(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, hada_floats dw,
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

static hada_status reduce_bias(hada_conv *conv, size_t scratch_offset, int parts, int channels, hada_floats db,
                               int accumulate, hada_error *err)
{
    const int block = conv->plan.block;
    const hada_range range = hada_range_of((size_t)channels, LOCAL, 1, 1);
    return hada_launch_conv_reduce_bias(conv->slot, reduce_program(conv), &range, err, .partial = conv->scratch.mem,
                                        .db = db.mem, .offset = scratch_offset, .db_offset = db.offset, .parts = parts,
                                        .blocks = (channels + block - 1) / block, .channels = channels,
                                        .accumulate = accumulate);
}

static hada_status bias_of(hada_conv *conv, const hada_tensor *dy, hada_floats db, int accumulate, hada_error *err)
{
    const int lines = dy->images * dy->rows, most = conv->plan.gradient.bias_parts;
    const int parts = most < lines ? most : lines;
    const hada_tensor_layout at_dy = hada_layout_of(dy);
    const hada_range range = hada_range_of((size_t)at_dy.blocks, 1, (size_t)parts, 1);
    const hada_range groups = hada_range_groups(1, HADA_CONV_GROUP_ITEMS, (size_t)at_dy.blocks, (size_t)parts);
    if (conv->plan.groups)
        HADA_TRY(hada_launch_conv_group_bias(conv->slot, reduce_program(conv), &groups, err, .dy = dy->mem,
                                             .partial = conv->scratch.mem, .at_dy = at_dy, .images = dy->images));
    else
        HADA_TRY(hada_launch_conv_bias_partial(conv->slot, reduce_program(conv), &range, err, .dy = dy->mem,
                                               .partial = conv->scratch.mem, .at_dy = at_dy, .images = dy->images));
    return reduce_bias(conv, 0, parts, dy->channels, db, accumulate, err);
}

/* Winograd's tiles. */

/* A part has so many tiles at least: its sums are written once, however few it has. */
enum { TILE = 4, PLACES = 36, LEAST_TILES = 12, REDUCE_LOCAL = 8 };

static size_t blocks_of(const hada_tensor *tensor)
{
    return (size_t)hada_layout_of(tensor).blocks;
}

/* dw from the transformed gradients in scratch. */
static hada_status reduce(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, size_t from, int parts,
                          hada_floats dw, int accumulate, hada_error *err)
{
    const hada_range range = hada_range_of((size_t)fine->channels, REDUCE_LOCAL, blocks_of(coarse), 1);
    return hada_launch_conv_winograd_reduce(conv->slot, HADA_PROGRAM_BY_BLOCK(CONV_WINOGRAD_REDUCE, conv->plan.block),
                                            &range, err, .partial = conv->scratch.mem, .dw = dw.mem, .offset = from,
                                            .dw_offset = dw.offset, .parts = parts, .coarse_channels = coarse->channels,
                                            .fine_channels = fine->channels, .accumulate = accumulate);
}

static hada_status by_parts(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, int parts,
                            hada_error *err)
{
    const hada_conv_gradient *g = &conv->plan.gradient;
    const size_t place = PLACES * (size_t)coarse->block * sizeof(float), tiles = (size_t)g->tiles;
    const hada_range range = hada_range_of((size_t)parts, 1, 1, 1);
    const hada_local v = {place * (blocks_of(fine) * tiles + 1)}, d = {place * (blocks_of(coarse) * tiles + 1)};
    return hada_launch_conv_winograd_weights(conv->slot, (hada_program_conv_winograd_weights)g->program, &range, err,
                                             .coarse = coarse->mem, .fine = fine->mem, .partial = conv->scratch.mem,
                                             .v = v, .d = d, .sizes = correlation_of(conv, coarse, fine));
}

/* The tiles begin ... begin + count - 1 of all images. */
static hada_status by_steps(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, int begin, int count,
                            size_t d_offset, size_t du_offset, hada_error *err)
{
    const hada_conv_gradient *g = &conv->plan.gradient;
    const hada_program_conv_winograd_weight_steps program = (hada_program_conv_winograd_weight_steps)g->program;
    /* the first step is that of convolutions, where neither blocks nor pixels matter */
    const hada_program_conv_winograd_steps inputs = conv->plan.block == 16
                                                        ? HADA_PROGRAM_CONV_WINOGRAD_STEPS_BLOCK16_BLOCKS2_PIXELS8
                                                        : HADA_PROGRAM_CONV_WINOGRAD_STEPS_BLOCK8_BLOCKS2_PIXELS6;
    const hada_range tiles = hada_range_of((size_t)count, 1, 1, 1);
    const hada_range products = hada_range_of(blocks_of(fine) * (size_t)fine->block / (size_t)g->fine_each, 1,
                                              blocks_of(coarse) / (size_t)g->blocks, PLACES);
    HADA_TRY(hada_launch_conv_winograd_in(conv->slot, inputs, &tiles, err, .x = fine->mem, .low = NULL,
                                          .v = conv->scratch.mem, .at_x = hada_layout_of(fine), .at_low = {0},
                                          .begin = begin, .room = g->room));
    HADA_TRY(hada_launch_conv_winograd_back(conv->slot, program, &tiles, err, .dy = coarse->mem,
                                            .scratch = conv->scratch.mem, .at_dy = hada_layout_of(coarse),
                                            .d_offset = d_offset, .begin = begin, .room = g->room));
    return hada_launch_conv_winograd_correlate(conv->slot, program, &products, err, .scratch = conv->scratch.mem,
                                               .d_offset = d_offset, .du_offset = du_offset, .tiles = count,
                                               .room = g->room, .adds = begin > 0);
}

/* All in local memory, each part with sums of its own. */
static hada_status in_parts(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, int all,
                            hada_floats dw, hada_floats db, int accumulate, hada_error *err)
{
    const hada_conv_gradient *g = &conv->plan.gradient;
    const int most = (all + LEAST_TILES - 1) / LEAST_TILES, parts = g->parts < most ? g->parts : most;
    HADA_TRY(by_parts(conv, coarse, fine, parts, err));
    HADA_TRY(reduce(conv, coarse, fine, 0, parts, dw, accumulate, err));
    if (db.mem)
        HADA_TRY(reduce_bias(conv, g->part_floats * (size_t)parts, parts, coarse->channels, db, accumulate, err));
    return HADA_OK;
}

/* Through scratch memory, so many tiles at a time as there is room for. */
static hada_status in_steps(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, int all,
                            hada_floats dw, hada_floats db, int accumulate, hada_error *err)
{
    const int room = conv->plan.gradient.room;
    const size_t place = PLACES * (size_t)coarse->block;
    const size_t d_offset = place * (blocks_of(fine) * (size_t)room + 1);
    const size_t du_offset = d_offset + place * (blocks_of(coarse) * (size_t)room + 1);
    for (int begin = 0; begin < all; begin += room)
        HADA_TRY(
            by_steps(conv, coarse, fine, begin, all - begin < room ? all - begin : room, d_offset, du_offset, err));
    HADA_TRY(reduce(conv, coarse, fine, du_offset, 1, dw, accumulate, err));
    if (db.mem)
        HADA_TRY(bias_of(conv, coarse, db, accumulate, err));
    return HADA_OK;
}

static hada_status winograd_weights(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, hada_floats dw,
                                    hada_floats db, int accumulate, hada_error *err)
{
    const int all = (coarse->rows + TILE - 1) / TILE * ((coarse->cols + TILE - 1) / TILE) * coarse->images;
    return conv->plan.gradient.tiles ? in_parts(conv, coarse, fine, all, dw, db, accumulate, err)
                                     : in_steps(conv, coarse, fine, all, dw, db, accumulate, err);
}

hada_status hada_conv_gradients(hada_conv *conv, const hada_tensor *x, const hada_tensor *dy, hada_floats dw,
                                hada_floats db, int accumulate, hada_error *err)
{
    const int transposed = conv->plan.desc.transposed;
    const hada_tensor *coarse = transposed ? x : dy, *fine = transposed ? dy : x;
    hada_conv_cost(conv, coarse, fine);
    if (conv->plan.gradient.winograd && !transposed) /* gives the gradient of the biases as well */
        return winograd_weights(conv, coarse, fine, dw, db, accumulate, err);
    HADA_TRY(conv->plan.gradient.winograd ? winograd_weights(conv, coarse, fine, dw, (hada_floats){0}, accumulate, err)
                                          : weights_of(conv, coarse, fine, dw, accumulate, err));
    return db.mem ? bias_of(conv, dy, db, accumulate, err) : HADA_OK;
}
