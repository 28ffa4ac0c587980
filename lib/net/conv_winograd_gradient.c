/* Launches of the gradients of weights by Winograd's tiles: in local memory part by part, or step by step. */
#include "core/alloc.h"
#include "launch/conv_winograd_reduce.h"
#include "launch/conv_winograd_steps.h"
#include "launch/conv_winograd_weight_steps.h"
#include "launch/conv_winograd_weights.h"
#include "net/conv_internal.h"

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
                                             .v = v, .d = d, .sizes = hada_conv_correlation_of(conv, coarse, fine));
}

/* The tiles begin ... begin + count - 1 of all images. */
static hada_status by_steps(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, int begin, int count,
                            size_t d_offset, size_t du_offset, hada_error *err)
{
    const hada_conv_gradient *g = &conv->plan.gradient;
    const hada_program_conv_winograd_weight_steps program = (hada_program_conv_winograd_weight_steps)g->program;
    /* the first step is that of convolutions, where neither blocks nor pixels matter */
    const hada_program_conv_winograd_steps inputs = conv->plan.block == 16
                                                        ? HADA_PROGRAM_CONV_WINOGRAD_STEPS_BLOCK16_BLOCKS2_PIXELS8_TILE4
                                                        : HADA_PROGRAM_CONV_WINOGRAD_STEPS_BLOCK8_BLOCKS2_PIXELS6_TILE4;
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
        HADA_TRY(
            hada_conv_reduce_bias(conv, g->part_floats * (size_t)parts, parts, coarse->channels, db, accumulate, err));
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
        HADA_TRY(hada_conv_bias(conv, coarse, db, accumulate, err));
    return HADA_OK;
}

hada_status hada_conv_winograd_weights(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine,
                                       hada_floats dw, hada_floats db, int accumulate, hada_error *err)
{
    const int all = (coarse->rows + TILE - 1) / TILE * ((coarse->cols + TILE - 1) / TILE) * coarse->images;
    return conv->plan.gradient.tiles ? in_parts(conv, coarse, fine, all, dw, db, accumulate, err)
                                     : in_steps(conv, coarse, fine, all, dw, db, accumulate, err);
}
