/* Launches of the passes of a convolution: packed weights, direct sums, the definition, and Winograd's tiles, in one
 * launch or, with many channels, in three. */
#include "launch/conv_direct.h"
#include "launch/conv_few.h"
#include "launch/conv_group.h"
#include "launch/conv_group_finish.h"
#include "launch/conv_pack.h"
#include "launch/conv_plain.h"
#include "launch/conv_tf32.h"
#include "launch/conv_winograd.h"
#include "launch/conv_winograd_steps.h"
#include "net/conv_plan.h"
#include "net/layers.h"

enum {
    PLAIN_LOCAL = 8, /* work-items of a group of conv_plain and conv_pack */
    FINISH_LOCAL = 128
};

void hada_conv_cost(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine)
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

hada_conv_problem hada_conv_problem_of(const hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *out,
                                       const hada_conv_finish *finish, int pools)
{
    hada_conv_problem problem = geometry_of(conv, index);
    problem.in = hada_layout_of(in);
    problem.out = hada_layout_of(out);
    problem.epilogue = epilogue_of(finish, pools);
    if (streams(conv, out))
        problem.epilogue.flags |= HADA_CONV_STREAMS;
    return problem;
}

hada_status hada_conv_pack(hada_conv *conv, int index, hada_floats weights, hada_error *err)
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
                                .problem = hada_conv_problem_of(conv, index, in, out, finish, 0));
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
                                   .problem = hada_conv_problem_of(conv, index, in, out, finish, 0));
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
    hada_conv_problem problem = hada_conv_problem_of(conv, index, in, out, finish, 0);
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

hada_status hada_conv_direct(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *out,
                             const hada_conv_finish *finish, hada_error *err)
{
    HADA_TRY(conv->plan.groups ? direct_groups_all(conv, index, in, out, finish, err)
                               : direct_lanes(conv, index, in, out, finish, err));
    if (finish->pooled)
        HADA_TRY(hada_pool_forward(conv->slot, HADA_POOL_MAX, 2, 2, out, finish->pooled, err));
    return HADA_OK;
}

hada_status hada_conv_plain(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *out,
                            const hada_conv_finish *finish, hada_error *err)
{
    const hada_conv_problem problem = hada_conv_problem_of(conv, index, in, out, finish, 0);
    const hada_range range = hada_range_divisible(hada_range_of((size_t)out->cols, PLAIN_LOCAL, (size_t)out->rows,
                                                                (size_t)problem.out.blocks * (size_t)in->images),
                                                  1);
    HADA_TRY(hada_launch_conv_plain(conv->slot, HADA_PROGRAM_BY_BLOCK(CONV_PLAIN, conv->plan.block), &range, err,
                                    .x = in->mem, .w = conv->weights[index].mem, .bias = finish->bias.mem,
                                    .y = out->mem, .mask = hada_conv_mask(finish), .problem = problem));
    if (finish->pooled)
        HADA_TRY(hada_pool_forward(conv->slot, HADA_POOL_MAX, 2, 2, out, finish->pooled, err));
    return HADA_OK;
}

/* Winograd's tiles. */

enum { TILE = 4, PLACES = (TILE + 2) * (TILE + 2) };

hada_status hada_conv_winograd_pack(hada_conv *conv, int index, hada_floats weights, hada_error *err)
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

hada_status hada_conv_winograd(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *low,
                               const hada_tensor *out, const hada_conv_finish *finish, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    /* tiles of odd sizes stand on odd pixels at the far edges */
    const int pools = finish->pooled && out->rows % 2 == 0 && out->cols % 2 == 0;
    hada_conv_problem problem = hada_conv_problem_of(conv, index, in, out, finish, pools);
    if (low)
        problem.low = hada_layout_of(low);
    const size_t tiles = hada_divide_up((size_t)out->cols, TILE) * hada_divide_up((size_t)out->rows, TILE);
    if (pass->tiles) {
        HADA_TRY(one_launch(conv, index, in, low, out, finish, &problem, tiles, err));
    } else {
        const int all = (int)tiles * in->images, most = pass->room;
        for (int begin = 0; begin < all; begin += most)
            HADA_TRY(three_launches(conv, index, in, low, out, finish, &problem, begin,
                                    all - begin < most ? all - begin : most, err));
    }
    if (finish->pooled && !pools)
        HADA_TRY(hada_pool_forward(conv->slot, HADA_POOL_MAX, 2, 2, out, finish->pooled, err));
    return HADA_OK;
}
