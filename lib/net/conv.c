/* Convolutions: objects, which implementation a call goes to, the launches of each, and gradients of weights. */
#include "launch/conv_direct.h"
#include "launch/conv_few.h"
#include "launch/conv_group.h"
#include "launch/conv_group_finish.h"
#include "launch/conv_group_weights.h"
#include "launch/conv_pack.h"
#include "launch/conv_plain.h"
#include "launch/conv_reduce.h"
#include "launch/conv_tf32.h"
#include "launch/conv_weights.h"
#include "launch/conv_winograd.h"
#include "launch/conv_winograd_reduce.h"
#include "launch/conv_winograd_steps.h"
#include "launch/conv_winograd_weight_steps.h"
#include "launch/conv_winograd_weights.h"
#include "net/conv_plan.h"
#include "net/layers.h"

/* Launches of the passes of a convolution: packed weights, direct sums, the definition, and Winograd's tiles, in one
 * launch or, with many channels, in three. */

enum {
    PLAIN_LOCAL = 8, /* work-items of a group of conv_plain and conv_pack */
    FINISH_LOCAL = 128
};

/* States what the next launch needs at least, for profiles: the products of the definition. */
static void conv_cost(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine)
{
    const hada_conv_desc *d = &conv->plan.desc;
    const double pixels = (double)coarse->rows * coarse->cols * coarse->images;
    const double weights = (double)d->in_channels * d->out_channels * d->kernel_rows * d->kernel_cols;
    const double fine_pixels = (double)fine->rows * fine->cols * fine->images;
    const double values = pixels * coarse->channels + fine_pixels * (fine->channels + 0.25 * d->doubled);
    hada_slot_cost(conv->slot, (values + weights) * sizeof(float), 2.0 * pixels * weights);
}

static hada_conv_epilogue epilogue_of(const hada_conv_finish *finish, int pools)
{
    hada_conv_epilogue e = {.bias = finish->bias.offset,
                            .activation = (int)finish->activation,
                            .slope = finish->slope,
                            .flags = (finish->bias.mem ? HADA_CONV_HAS_BIAS : 0) |
                                     (finish->mask ? HADA_CONV_HAS_MASK : 0) |
                                     (finish->accumulate ? HADA_CONV_ACCUMULATES : 0) | (pools ? HADA_CONV_POOLS : 0)};
    if (finish->mask) {
        e.mask = finish->mask->offset;
        e.mask_image = finish->mask->image_stride;
    }
    if (pools) {
        e.pooled = finish->pooled->offset;
        e.pooled_image = finish->pooled->image_stride;
    }
    return e;
}

/* How a pass goes over its images, whatever they are. */
static hada_conv_problem geometry_of(const hada_conv *conv, int index)
{
    const hada_conv_desc *d = &conv->plan.desc;
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const int plain = pass->method == HADA_CONV_PLAIN;
    return (hada_conv_problem){.kernel_rows = d->kernel_rows,
                               .kernel_cols = d->kernel_cols,
                               .pad_rows = plain ? d->pad_rows : pass->taps_rows,
                               .pad_cols = plain ? d->pad_cols : pass->taps_cols,
                               .in_step = pass->in_step,
                               .step = pass->step,
                               .to_coarse = pass->to_coarse,
                               .rows_each = pass->rows_each,
                               .flat = pass->flat,
                               .tiles = pass->tiles,
                               .parts = pass->parts};
}

/* Larger outputs have left the caches of a core long before they are read. */
#define STREAM_BYTES ((size_t)4 << 20)

static int streams(const hada_conv *conv, const hada_tensor *out)
{
    const size_t block = (size_t)out->block, floats = out->image_stride * (size_t)out->images;
    return conv->slot->context->info.kind == HADA_DEVICE_CPU && floats * sizeof(float) >= STREAM_BYTES &&
           out->offset % block == 0 && out->image_stride % block == 0;
}

/* What kernels take of a pass. pools: the pooled output is written at once. */
static hada_conv_problem conv_problem_of(const hada_conv *conv, int index, const hada_tensor *in,
                                         const hada_tensor *out, const hada_conv_finish *finish, int pools)
{
    hada_conv_problem problem = geometry_of(conv, index);
    problem.in = hada_layout_of(in);
    problem.out = hada_layout_of(out);
    problem.epilogue = epilogue_of(finish, pools);
    if (streams(conv, out))
        problem.epilogue.flags |= HADA_CONV_STREAMS;
    return problem;
}

static hada_status hada_conv_pack(hada_conv *conv, int index, hada_floats weights, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const hada_buffer *packed = &conv->weights[index];
    if (pass->method == HADA_CONV_PLAIN) {
        return hada_buffer_copy(conv->slot, weights.mem, weights.offset * sizeof(float), packed->mem, 0,
                                pass->weight_floats * sizeof(float), err);
    }
    const hada_program_conv_pack program =
        conv->plan.groups ? HADA_PROGRAM_CONV_PACK_DIRECT : HADA_PROGRAM_CONV_PACK_PACK8;
    const size_t each = (size_t)hada_macros_of_conv_pack(program)->conv_pack, block = (size_t)conv->plan.block;
    /* no more items than channels of whole groups: each writes */
    const size_t lanes = (size_t)pass->lanes, local = lanes < PLAIN_LOCAL ? lanes : PLAIN_LOCAL;
    const hada_range range = hada_range_of(hada_round_up((size_t)pass->out_channels, lanes) / each, local / each,
                                           hada_round_up((size_t)pass->in_channels, block) / each, 1);
    hada_conv_problem problem = geometry_of(conv, index);
    problem.in.channels = pass->in_channels;
    problem.out.channels = pass->out_channels;
    return hada_launch_conv_pack(conv->slot, program, &range, err, .w = weights.mem, .packed = packed->mem,
                                 .problem = problem, .w_offset = weights.offset, .block = conv->plan.block,
                                 .lanes = pass->lanes);
}

static hada_status direct_few(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *out,
                              const hada_conv_finish *finish, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const hada_conv_desc *d = &conv->plan.desc;
    const size_t taps = (size_t)(d->kernel_rows * d->kernel_cols), blocks = (size_t)hada_layout_of(in).blocks;
    const hada_range range = hada_range_divisible(
        hada_range_of(hada_divide_up((size_t)out->rows, (size_t)pass->rows_each), 1, (size_t)in->images, 1), 0);
    return hada_launch_conv_few(conv->slot, (hada_program_conv_few)pass->program, &range, err, .x = in->mem,
                                .weights = conv->weights[index].mem, .bias = finish->bias.mem, .y = out->mem,
                                .mask = hada_conv_mask(finish),
                                .w = {taps * (size_t)pass->few * blocks * (size_t)in->block * sizeof(float)},
                                .problem = conv_problem_of(conv, index, in, out, finish, 0));
}

static hada_status direct_lanes(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *out,
                                const hada_conv_finish *finish, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    if (pass->few)
        return direct_few(conv, index, in, out, finish, err);
    const size_t tiles = hada_divide_up((size_t)out->rows * ((size_t)out->cols + 2) - 2, (size_t)pass->pixels);
    const size_t rows = pass->flat ? tiles : (size_t)out->rows;
    const hada_range range =
        hada_range_divisible(hada_range_of(hada_divide_up((size_t)out->channels, (size_t)pass->lanes), 1,
                                           hada_divide_up(rows, (size_t)pass->rows_each), (size_t)in->images),
                             1);
    return hada_launch_conv_direct(conv->slot, (hada_program_conv_direct)pass->program, &range, err, .x = in->mem,
                                   .weights = conv->weights[index].mem, .bias = finish->bias.mem, .y = out->mem,
                                   .mask = hada_conv_mask(finish),
                                   .problem = conv_problem_of(conv, index, in, out, finish, 0));
}

/* So many images, whose parts find room in scratch. */
static hada_status direct_groups(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *out,
                                 const hada_conv_finish *finish, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const size_t step = (size_t)pass->step, tile = (size_t)hada_conv_group_tile(pass), parts = (size_t)pass->parts;
    const size_t pixels = hada_divide_up((size_t)out->rows, step) * hada_divide_up((size_t)out->cols, step);
    const size_t fours = (size_t)out->cols * (size_t)(out->block / 4), blocks = (size_t)hada_layout_of(out).blocks;
    const hada_range range = hada_range_groups(hada_divide_up(pixels, tile), HADA_CONV_GROUP_ITEMS,
                                               hada_divide_up((size_t)out->channels, (size_t)pass->lanes),
                                               (size_t)in->images * step * step * parts);
    const hada_range finish_range = hada_range_of(fours, FINISH_LOCAL, (size_t)out->rows, (size_t)out->images * blocks);
    hada_conv_problem problem = conv_problem_of(conv, index, in, out, finish, 0);
    const cl_mem to = parts > 1 ? conv->scratch.mem : out->mem;
    if (pass->method == HADA_CONV_TF32)
        HADA_TRY(hada_launch_conv_tf32(conv->slot, (hada_program_conv_tf32)pass->program, &range, err, .x = in->mem,
                                       .weights = conv->weights[index].mem, .bias = finish->bias.mem, .y = to,
                                       .mask = hada_conv_mask(finish), .problem = problem));
    else
        HADA_TRY(hada_launch_conv_group(conv->slot, (hada_program_conv_group)pass->program, &range, err, .x = in->mem,
                                        .weights = conv->weights[index].mem, .bias = finish->bias.mem, .y = to,
                                        .mask = hada_conv_mask(finish), .problem = problem));
    if (parts > 1)
        HADA_TRY(hada_launch_conv_group_finish(conv->slot, HADA_PROGRAM_BY_BLOCK(CONV_GROUP_FINISH, conv->plan.block),
                                               &finish_range, err, .partial = conv->scratch.mem,
                                               .bias = finish->bias.mem, .y = out->mem, .mask = hada_conv_mask(finish),
                                               .problem = problem));
    return HADA_OK;
}

static hada_status direct_groups_all(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *out,
                                     const hada_conv_finish *finish, hada_error *err)
{
    const int each = conv->plan.pass[index].images_each;
    for (int n = 0; n < in->images; n += each) {
        const int count = each < in->images - n ? each : in->images - n;
        const hada_tensor some_in = hada_tensor_images(in, n, count), some_out = hada_tensor_images(out, n, count);
        hada_conv_finish some = *finish;
        hada_tensor mask;
        if (finish->mask) {
            mask = hada_tensor_images(finish->mask, n, count);
            some.mask = &mask;
        }
        HADA_TRY(direct_groups(conv, index, &some_in, &some_out, &some, err));
    }
    return HADA_OK;
}

static hada_status conv_plain(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *out,
                              const hada_conv_finish *finish, hada_error *err)
{
    const hada_conv_problem problem = conv_problem_of(conv, index, in, out, finish, 0);
    const hada_range range = hada_range_divisible(hada_range_of((size_t)out->cols, PLAIN_LOCAL, (size_t)out->rows,
                                                                (size_t)problem.out.blocks * (size_t)in->images),
                                                  1);
    return hada_launch_conv_plain(conv->slot, HADA_PROGRAM_BY_BLOCK(CONV_PLAIN, conv->plan.block), &range, err,
                                  .x = in->mem, .w = conv->weights[index].mem, .bias = finish->bias.mem, .y = out->mem,
                                  .mask = hada_conv_mask(finish), .problem = problem);
}

/* Winograd's tiles. */

enum { TILE = 4, PLACES = (TILE + 2) * (TILE + 2) };

static hada_status conv_winograd_pack(hada_conv *conv, int index, hada_floats weights, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const hada_program_conv_pack program = HADA_PROGRAM_CONV_PACK_PACK8;
    const size_t each = (size_t)hada_macros_of_conv_pack(program)->conv_pack, block = (size_t)conv->plan.block;
    const hada_range range = hada_range_of(hada_round_up((size_t)pass->out_channels, block) / each, 1,
                                           hada_round_up((size_t)pass->in_channels, block) / each, 1);
    return hada_launch_conv_winograd_pack(conv->slot, program, &range, err, .w = weights.mem,
                                          .packed = conv->weights[index].mem, .w_offset = weights.offset,
                                          .in_channels = pass->in_channels, .out_channels = pass->out_channels,
                                          .to_coarse = pass->to_coarse, .lanes = pass->lanes);
}

/* Bytes of the places of a work-item's tiles, a block apart (CONV_APART of kernels/inc_conv_winograd.h). */
static size_t local_places(const hada_conv_pass *pass, int channels, int block)
{
    return (size_t)PLACES * (size_t)(pass->tiles * channels + block) * sizeof(float);
}

/* Where the pooled output is written at once. */
static cl_mem pooled_of(const hada_conv_finish *finish, const hada_conv_problem *problem)
{
    return problem->epilogue.flags & HADA_CONV_POOLS ? finish->pooled->mem : NULL;
}

static hada_status one_launch(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *low,
                              const hada_tensor *out, const hada_conv_finish *finish, const hada_conv_problem *problem,
                              size_t tiles, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const int in_blocks = problem->in.blocks + problem->low.blocks;
    const hada_range range =
        hada_range_divisible(hada_range_of(hada_divide_up(tiles, (size_t)pass->tiles), 1, (size_t)in->images, 1), 0);
    return hada_launch_conv_winograd(
        conv->slot, (hada_program_conv_winograd)pass->program, &range, err, .x = in->mem, .low = low ? low->mem : NULL,
        .weights = conv->weights[index].mem, .bias = finish->bias.mem, .y = out->mem, .mask = hada_conv_mask(finish),
        .pooled = pooled_of(finish, problem),
        .places = {local_places(pass, in_blocks * in->block, in->block) + local_places(pass, pass->lanes, in->block)},
        .problem = *problem);
}

/* Inputs, products, outputs of the tiles begin ... begin + count - 1 of all images. */
static hada_status three_launches(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *low,
                                  const hada_tensor *out, const hada_conv_finish *finish,
                                  const hada_conv_problem *problem, int begin, int count, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const hada_program_conv_winograd_steps program = (hada_program_conv_winograd_steps)pass->program;
    const size_t in_blocks = (size_t)(problem->in.blocks + problem->low.blocks);
    const size_t filled = (size_t)problem->out.blocks * (size_t)out->block;
    const hada_range tiles = hada_range_of((size_t)count, 1, 1, 1);
    const hada_range products = hada_range_of(filled / (size_t)pass->lanes, 1, (size_t)PLACES, 1);
    const size_t m_offset = (size_t)PLACES * (size_t)in->block * (in_blocks * (size_t)pass->room + 1);
    HADA_TRY(hada_launch_conv_winograd_in(conv->slot, program, &tiles, err, .x = in->mem, .low = low ? low->mem : NULL,
                                          .v = conv->scratch.mem, .at_x = problem->in, .at_low = problem->low,
                                          .begin = begin, .room = pass->room));
    HADA_TRY(hada_launch_conv_winograd_products(conv->slot, program, &products, err, .scratch = conv->scratch.mem,
                                                .weights = conv->weights[index].mem, .m_offset = m_offset,
                                                .in_blocks = (int)in_blocks, .tiles = count, .room = pass->room));
    return hada_launch_conv_winograd_out(conv->slot, program, &tiles, err, .m = conv->scratch.mem,
                                         .bias = finish->bias.mem, .y = out->mem, .mask = hada_conv_mask(finish),
                                         .pooled = pooled_of(finish, problem), .problem = *problem,
                                         .m_offset = m_offset, .begin = begin, .room = pass->room);
}

static hada_status conv_winograd(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *low,
                                 const hada_tensor *out, const hada_conv_finish *finish, int pools, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    hada_conv_problem problem = conv_problem_of(conv, index, in, out, finish, pools);
    if (low)
        problem.low = hada_layout_of(low);
    const size_t tiles = hada_divide_up((size_t)out->cols, TILE) * hada_divide_up((size_t)out->rows, TILE);
    if (pass->tiles)
        return one_launch(conv, index, in, low, out, finish, &problem, tiles, err);
    const int all = (int)tiles * in->images, most = pass->room;
    for (int begin = 0; begin < all; begin += most)
        HADA_TRY(three_launches(conv, index, in, low, out, finish, &problem, begin,
                                all - begin < most ? all - begin : most, err));
    return HADA_OK;
}

/* Gradients of weights and biases: partial sums, then their sum in order; or by Winograd's tiles, part by part in local
 * memory or step by step. */

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
enum { LEAST_TILES = 12, REDUCE_LOCAL = 8 };

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

hada_status hada_conv_create(hada_conv **out, hada_slot *slot, const hada_conv_desc *desc, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_conv_plan plan;
    hada_conv *conv = NULL;
    *out = NULL;
    HADA_TRY_OR_DONE(hada_conv_plan_make(&plan, slot->context, desc, err));
    HADA_TRY_OR_DONE(HADA_NEW(conv, 1, "a convolution", err));
    conv->slot = slot;
    conv->plan = plan;
    for (int p = 0; p < plan.pass_count; p++)
        HADA_TRY_OR_DONE(hada_buffer_create(&conv->weights[p], slot->context,
                                            plan.pass[p].weight_floats * sizeof(float), "the weights of a convolution",
                                            err));
    if (plan.scratch_floats)
        HADA_TRY_OR_DONE(hada_buffer_create(&conv->scratch, slot->context, plan.scratch_floats * sizeof(float),
                                            "the scratch memory of a convolution", err));
done:
    if (status)
        hada_conv_destroy(&conv);
    *out = conv;
    return status;
}

void hada_conv_destroy(hada_conv **pointer)
{
    hada_conv *conv = hada_taken(pointer);
    if (!conv)
        return;
    for (int p = 0; p < HADA_CONV_PASSES; p++)
        hada_buffer_destroy(&conv->weights[p]);
    hada_buffer_destroy(&conv->scratch);
    free(conv);
}

hada_conv_method hada_conv_serving(const hada_conv *conv)
{
    return conv->plan.pass[HADA_CONV_FORWARD].method;
}

hada_status hada_conv_set_weights(hada_conv *conv, hada_floats weights, hada_error *err)
{
    for (int p = 0; p < conv->plan.pass_count; p++)
        HADA_TRY(conv->plan.pass[p].winograd ? conv_winograd_pack(conv, p, weights, err)
                                             : hada_conv_pack(conv, p, weights, err));
    return HADA_OK;
}

static hada_status run(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *low,
                       const hada_tensor *out, const hada_conv_finish *finish, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    conv_cost(conv, pass->to_coarse ? out : in, pass->to_coarse ? in : out);
    /* only Winograd's tiles pool on their way, where they do not stand on odd pixels at the far edges */
    const int pools = pass->winograd && finish->pooled && out->rows % 2 == 0 && out->cols % 2 == 0;
    HADA_TRY(pass->winograd                    ? conv_winograd(conv, index, in, low, out, finish, pools, err)
             : pass->method == HADA_CONV_PLAIN ? conv_plain(conv, index, in, out, finish, err)
             : conv->plan.groups               ? direct_groups_all(conv, index, in, out, finish, err)
                                               : direct_lanes(conv, index, in, out, finish, err));
    if (finish->pooled && !pools)
        HADA_TRY(hada_pool_forward(conv->slot, HADA_POOL_MAX, 2, 2, out, finish->pooled, err));
    return HADA_OK;
}

int hada_conv_doubles(const hada_context *context, const hada_conv_desc *desc)
{
    hada_conv_plan plan;
    return desc->doubled && !hada_conv_plan_make(&plan, context, desc, NULL);
}

hada_status hada_conv_forward(hada_conv *conv, const hada_tensor *x, const hada_tensor *low, hada_floats bias,
                              const hada_tensor *y, const hada_tensor *pooled, hada_error *err)
{
    const hada_conv_desc *d = &conv->plan.desc;
    const hada_conv_finish finish = {bias, d->activation, d->slope, NULL, pooled, 0};
    return run(conv, HADA_CONV_FORWARD, x, low, y, &finish, err);
}

hada_status hada_conv_backward_data(hada_conv *conv, const hada_tensor *dy, const hada_tensor *masked_by,
                                    const hada_tensor *dx, int accumulate, hada_error *err)
{
    const hada_conv_finish finish = {.mask = masked_by, .accumulate = accumulate};
    return run(conv, HADA_CONV_DATA, dy, NULL, dx, &finish, err);
}

hada_status hada_conv_backward_weights(hada_conv *conv, const hada_tensor *x, const hada_tensor *dy, hada_floats dw,
                                       hada_floats db, int accumulate, hada_error *err)
{
    const int transposed = conv->plan.desc.transposed;
    const hada_tensor *coarse = transposed ? x : dy, *fine = transposed ? dy : x;
    conv_cost(conv, coarse, fine);
    if (conv->plan.gradient.winograd && !transposed) /* gives the gradient of the biases as well */
        return winograd_weights(conv, coarse, fine, dw, db, accumulate, err);
    HADA_TRY(conv->plan.gradient.winograd ? winograd_weights(conv, coarse, fine, dw, (hada_floats){0}, accumulate, err)
                                          : weights_of(conv, coarse, fine, dw, accumulate, err));
    return db.mem ? bias_of(conv, dy, db, accumulate, err) : HADA_OK;
}
