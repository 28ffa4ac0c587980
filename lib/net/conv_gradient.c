/* Launches of the gradients of weights and biases: partial sums, then their sum in order. */
#include <stdio.h>

#include "net/conv_internal.h"

static size_t rounded(size_t count, size_t to)
{
    return (count + to - 1) / to * to;
}

static hada_status plain_weights(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, cl_mem dw,
                                 size_t offset, int accumulate, hada_error *err)
{
    const hada_conv_desc *d = &conv->plan.desc;
    const cl_ulong coarse_offset = coarse->offset, coarse_image = coarse->image_stride, fine_offset = fine->offset,
                   fine_image = fine->image_stride, to = offset;
    const cl_int places = d->kernel_rows * d->kernel_cols;
    const size_t local[3] = {8, 1, 1};
    const size_t global[3] = {rounded((size_t)fine->channels * (size_t)places, 8), (size_t)coarse->channels, 1};
    const hada_arg args[] = {HADA_ARG(coarse->mem),  HADA_ARG(coarse_offset),  HADA_ARG(coarse_image),
                             HADA_ARG(coarse->rows), HADA_ARG(coarse->cols),   HADA_ARG(fine->mem),
                             HADA_ARG(fine_offset),  HADA_ARG(fine_image),     HADA_ARG(fine->channels),
                             HADA_ARG(fine->rows),   HADA_ARG(fine->cols),     HADA_ARG(coarse->images),
                             HADA_ARG(places),       HADA_ARG(d->kernel_cols), HADA_ARG(d->pad_rows),
                             HADA_ARG(d->pad_cols),  HADA_ARG(d->stride),      HADA_ARG(dw),
                             HADA_ARG(to),           HADA_ARG(accumulate)};
    return hada_conv_launch(conv->slot, "conv_plain", "conv_plain_weights", hada_conv_block_option(conv->plan.block),
                            global, local, args, HADA_COUNT(args), err);
}

static hada_status partial_weights(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, size_t parts,
                                   hada_error *err)
{
    const hada_conv_desc *d = &conv->plan.desc;
    const hada_conv_gradient *g = &conv->plan.gradient;
    const cl_ulong coarse_offset = coarse->offset, coarse_image = coarse->image_stride, fine_offset = fine->offset,
                   fine_image = fine->image_stride;
    const size_t items =
        (size_t)(d->kernel_rows * d->kernel_cols / (g->rows_each * g->cols_each)) * (size_t)g->fine_groups;
    char options[96];
    if (conv->plan.groups) {
        const size_t local[3] = {64, 1, 1}, global[3] = {items * 64, (size_t)g->coarse_groups, parts};
        const hada_arg args[] = {
            HADA_ARG(coarse->mem),    HADA_ARG(coarse_offset),  HADA_ARG(coarse_image),   HADA_ARG(coarse->channels),
            HADA_ARG(coarse->rows),   HADA_ARG(coarse->cols),   HADA_ARG(fine->mem),      HADA_ARG(fine_offset),
            HADA_ARG(fine_image),     HADA_ARG(fine->channels), HADA_ARG(fine->rows),     HADA_ARG(fine->cols),
            HADA_ARG(coarse->images), HADA_ARG(d->kernel_cols), HADA_ARG(d->pad_rows),    HADA_ARG(d->pad_cols),
            HADA_ARG(d->stride),      HADA_ARG(g->strip_rows),  HADA_ARG(g->fine_groups), HADA_ARG(conv->scratch.mem)};
        return hada_conv_launch(conv->slot, "conv_group_weights", "conv_group_weights",
                                hada_conv_block_option(conv->plan.block), global, local, args, HADA_COUNT(args), err);
    }
    const size_t local[3] = {1, 1, 1}, global[3] = {items, (size_t)g->coarse_groups, parts};
    const hada_arg args[] = {HADA_ARG(coarse->mem),   HADA_ARG(coarse_offset),  HADA_ARG(coarse_image),
                             HADA_ARG(coarse->rows),  HADA_ARG(coarse->cols),   HADA_ARG(fine->mem),
                             HADA_ARG(fine_offset),   HADA_ARG(fine_image),     HADA_ARG(fine->rows),
                             HADA_ARG(fine->cols),    HADA_ARG(coarse->images), HADA_ARG(d->kernel_cols),
                             HADA_ARG(d->pad_rows),   HADA_ARG(d->pad_cols),    HADA_ARG(d->stride),
                             HADA_ARG(g->strip_rows), HADA_ARG(g->fine_groups), HADA_ARG(conv->scratch.mem)};
    snprintf(options, sizeof options, "-DNET_BLOCK=%d -DCONV_BLOCKS=%d -DCONV_FINE=%d -DCONV_COLS=%d -DCONV_ROWS=%d",
             conv->plan.block, g->blocks, g->fine_each, g->cols_each, g->rows_each);
    return hada_conv_launch(conv->slot, "conv_weights", "conv_weights", options, global, local, args, HADA_COUNT(args),
                            err);
}

hada_status hada_conv_weights(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, cl_mem dw,
                              size_t offset, int accumulate, hada_error *err)
{
    const hada_conv_desc *d = &conv->plan.desc;
    const hada_conv_gradient *g = &conv->plan.gradient;
    if (g->method == HADA_CONV_PLAIN)
        return plain_weights(conv, coarse, fine, dw, offset, accumulate, err);
    /* every part has a strip at least */
    const int strips = coarse->images * ((coarse->rows + g->strip_rows - 1) / g->strip_rows);
    const cl_int parts = g->parts < strips ? g->parts : strips, block = conv->plan.block;
    hada_status status = partial_weights(conv, coarse, fine, (size_t)parts, err);
    if (status)
        return status;
    const cl_int places = d->kernel_rows * d->kernel_cols;
    const cl_int blocks = g->coarse_groups * (conv->plan.groups ? GROUP_LANES / block : g->blocks);
    const cl_int filled = g->fine_groups * (conv->plan.groups ? GROUP_LANES : g->fine_each);
    const cl_ulong to = offset;
    const size_t local[3] = {8, 1, 1};
    const size_t global[3] = {rounded((size_t)fine->channels, 8),
                              rounded((size_t)coarse->channels, (size_t)block) / (size_t)block, 1};
    const hada_arg args[] = {
        HADA_ARG(conv->scratch.mem), HADA_ARG(parts),  HADA_ARG(filled), HADA_ARG(blocks), HADA_ARG(coarse->channels),
        HADA_ARG(fine->channels),    HADA_ARG(places), HADA_ARG(dw),     HADA_ARG(to),     HADA_ARG(accumulate)};
    return hada_conv_launch(conv->slot, "conv_reduce", "conv_reduce_weights", hada_conv_block_option(block), global,
                            local, args, HADA_COUNT(args), err);
}

hada_status hada_conv_reduce_bias(hada_conv *conv, size_t scratch_offset, int parts, int channels, cl_mem db,
                                  size_t offset, int accumulate, hada_error *err)
{
    const int block = conv->plan.block;
    const cl_int blocks = (channels + block - 1) / block;
    const cl_ulong from = scratch_offset, to = offset;
    const size_t local[3] = {8, 1, 1}, global[3] = {rounded((size_t)channels, 8), 1, 1};
    const hada_arg args[] = {HADA_ARG(conv->scratch.mem), HADA_ARG(from), HADA_ARG(parts), HADA_ARG(blocks),
                             HADA_ARG(channels),          HADA_ARG(db),   HADA_ARG(to),    HADA_ARG(accumulate)};
    return hada_conv_launch(conv->slot, "conv_reduce", "conv_reduce_bias", hada_conv_block_option(block), global, local,
                            args, HADA_COUNT(args), err);
}

hada_status hada_conv_bias(hada_conv *conv, const hada_tensor *dy, cl_mem db, size_t offset, int accumulate,
                           hada_error *err)
{
    const int lines = dy->images * dy->rows, block = conv->plan.block;
    const cl_int parts = conv->plan.gradient.bias_parts < lines ? conv->plan.gradient.bias_parts : lines;
    const cl_int blocks = (dy->channels + block - 1) / block;
    const cl_ulong from = dy->offset, image = dy->image_stride;
    const size_t local[3] = {1, 1, 1}, global[3] = {(size_t)blocks, (size_t)parts, 1};
    const hada_arg sum[] = {HADA_ARG(dy->mem),          HADA_ARG(from),     HADA_ARG(image),
                            HADA_ARG(dy->images),       HADA_ARG(dy->rows), HADA_ARG(dy->cols),
                            HADA_ARG(conv->scratch.mem)};
    hada_status status = hada_conv_launch(conv->slot, "conv_reduce", "conv_bias_partial", hada_conv_block_option(block),
                                          global, local, sum, HADA_COUNT(sum), err);
    if (status)
        return status;
    return hada_conv_reduce_bias(conv, 0, parts, dy->channels, db, offset, accumulate, err);
}
