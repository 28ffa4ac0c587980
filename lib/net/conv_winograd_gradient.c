/* Launches of the gradients of weights by Winograd's tiles: in local memory part by part, or step by step. */
#include <stdio.h>

#include "net/conv_internal.h"

/* A part has so many tiles at least: its sums are written once, however few it has. */
enum { PLACES = 36, LEAST_TILES = 12 };

static size_t blocks_of(const hada_tensor *tensor)
{
    return ((size_t)tensor->channels + (size_t)tensor->block - 1) / (size_t)tensor->block;
}

static void make_options(const hada_conv *conv, char *options, size_t size)
{
    snprintf(options, size, "-DNET_BLOCK=%d -DCONV_BLOCKS=%d -DCONV_FINE=%d", conv->plan.block,
             conv->plan.gradient.blocks, conv->plan.gradient.fine_each);
}

/* dw from the transformed gradients in scratch. */
static hada_status reduce(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, cl_ulong from,
                          cl_int parts, cl_mem dw, size_t offset, int accumulate, hada_error *err)
{
    const cl_ulong to = offset;
    const size_t local[3] = {8, 1, 1};
    const size_t global[3] = {((size_t)fine->channels + 7) / 8 * 8, blocks_of(coarse), 1};
    const hada_arg args[] = {HADA_ARG(conv->scratch.mem), HADA_ARG(from), HADA_ARG(parts), HADA_ARG(coarse->channels),
                             HADA_ARG(fine->channels),    HADA_ARG(dw),   HADA_ARG(to),    HADA_ARG(accumulate)};
    return hada_conv_launch(conv->slot, "conv_winograd_reduce", "conv_winograd_reduce",
                            hada_conv_block_option(conv->plan.block), global, local, args, HADA_COUNT(args), err);
}

static hada_status by_parts(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, cl_int parts,
                            hada_error *err)
{
    const hada_conv_gradient *g = &conv->plan.gradient;
    const cl_ulong coarse_offset = coarse->offset, coarse_image = coarse->image_stride, fine_offset = fine->offset,
                   fine_image = fine->image_stride;
    const cl_int coarse_blocks = (cl_int)blocks_of(coarse), fine_blocks = (cl_int)blocks_of(fine);
    const size_t place = PLACES * (size_t)coarse->block * sizeof(float);
    const size_t local[3] = {1, 1, 1}, global[3] = {(size_t)parts, 1, 1};
    const hada_arg args[] = {HADA_ARG(coarse->mem),
                             HADA_ARG(coarse_offset),
                             HADA_ARG(coarse_image),
                             HADA_ARG(coarse_blocks),
                             HADA_ARG(fine->mem),
                             HADA_ARG(fine_offset),
                             HADA_ARG(fine_image),
                             HADA_ARG(fine_blocks),
                             HADA_ARG(coarse->images),
                             HADA_ARG(coarse->rows),
                             HADA_ARG(coarse->cols),
                             HADA_ARG(g->tiles),
                             HADA_ARG(conv->scratch.mem),
                             HADA_ARG_LOCAL(place * ((size_t)fine_blocks * (size_t)g->tiles + 1)),
                             HADA_ARG_LOCAL(place * ((size_t)coarse_blocks * (size_t)g->tiles + 1))};
    char options[96];
    make_options(conv, options, sizeof options);
    return hada_conv_launch(conv->slot, "conv_winograd_weights", "conv_winograd_weights", options, global, local, args,
                            HADA_COUNT(args), err);
}

/* The tiles begin ... begin + count - 1 of all images. */
static hada_status by_steps(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, cl_int begin,
                            cl_int count, cl_ulong d_offset, cl_ulong du_offset, hada_error *err)
{
    hada_status status = HADA_OK;
    static const char file[] = "conv_winograd_weight_steps";
    const hada_conv_gradient *g = &conv->plan.gradient;
    const cl_ulong coarse_offset = coarse->offset, coarse_image = coarse->image_stride, fine_offset = fine->offset,
                   fine_image = fine->image_stride;
    const cl_int coarse_blocks = (cl_int)blocks_of(coarse), fine_blocks = (cl_int)blocks_of(fine), adds = begin > 0;
    const size_t local[3] = {1, 1, 1}, tiles[3] = {(size_t)count, 1, 1};
    const size_t products[3] = {(size_t)fine_blocks * (size_t)fine->block / (size_t)g->fine_each,
                                (size_t)coarse_blocks / (size_t)g->blocks, PLACES};
    const hada_arg in_args[] = {HADA_ARG(fine->mem),   HADA_ARG(fine_offset), HADA_ARG(fine_image),
                                HADA_ARG(fine_blocks), HADA_ARG(fine->rows),  HADA_ARG(fine->cols),
                                HADA_ARG(begin),       HADA_ARG(g->room),     HADA_ARG(conv->scratch.mem)};
    const hada_arg back_args[] = {HADA_ARG(coarse->mem),   HADA_ARG(coarse_offset), HADA_ARG(coarse_image),
                                  HADA_ARG(coarse_blocks), HADA_ARG(coarse->rows),  HADA_ARG(coarse->cols),
                                  HADA_ARG(begin),         HADA_ARG(g->room),       HADA_ARG(conv->scratch.mem),
                                  HADA_ARG(d_offset)};
    const hada_arg product_args[] = {HADA_ARG(conv->scratch.mem), HADA_ARG(d_offset),
                                     HADA_ARG(du_offset),         HADA_ARG(count),
                                     HADA_ARG(g->room),           HADA_ARG(adds)};
    char options[96];
    make_options(conv, options, sizeof options);
    HADA_TRY(hada_conv_launch(conv->slot, "conv_winograd_steps", "conv_winograd_in",
                              conv->plan.block == 16 ? HADA_CONV_STEPS_16 : HADA_CONV_STEPS_8, tiles, local, in_args,
                              HADA_COUNT(in_args), err));
    HADA_TRY(hada_conv_launch(conv->slot, file, "conv_winograd_back", options, tiles, local, back_args,
                              HADA_COUNT(back_args), err));
    HADA_TRY(hada_conv_launch(conv->slot, file, "conv_winograd_correlate", options, products, local, product_args,
                              HADA_COUNT(product_args), err));
done:
    return status;
}

hada_status hada_conv_winograd_weights(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, cl_mem dw,
                                       size_t offset, cl_mem db, size_t db_offset, int accumulate, hada_error *err)
{
    hada_status status = HADA_OK;
    const hada_conv_gradient *g = &conv->plan.gradient;
    const int all = ((coarse->rows + 3) / 4) * ((coarse->cols + 3) / 4) * coarse->images;
    if (g->tiles) {
        const cl_int most = (all + LEAST_TILES - 1) / LEAST_TILES, parts = g->parts < most ? g->parts : most;
        HADA_TRY(by_parts(conv, coarse, fine, parts, err));
        HADA_TRY(reduce(conv, coarse, fine, 0, parts, dw, offset, accumulate, err));
        if (db)
            HADA_TRY(hada_conv_reduce_bias(conv, g->part_floats * (size_t)parts, parts, coarse->channels, db, db_offset,
                                           accumulate, err));
        return status;
    }
    const size_t place = PLACES * (size_t)coarse->block;
    const cl_ulong d_offset = place * (blocks_of(fine) * (size_t)g->room + 1);
    const cl_ulong du_offset = d_offset + place * (blocks_of(coarse) * (size_t)g->room + 1);
    for (int begin = 0; begin < all; begin += g->room)
        HADA_TRY(by_steps(conv, coarse, fine, begin, all - begin < g->room ? all - begin : g->room, d_offset, du_offset,
                          err));
    HADA_TRY(reduce(conv, coarse, fine, du_offset, 1, dw, offset, accumulate, err));
    if (db)
        HADA_TRY(hada_conv_bias(conv, coarse, db, db_offset, accumulate, err));
done:
    return status;
}
