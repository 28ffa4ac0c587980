/* Launches of Winograd's convolutions: weights, one launch for all, or three for many channels. */
#include "launch/conv_winograd.h"
#include "core/alloc.h"
#include "launch/conv_pack.h"
#include "launch/conv_winograd_steps.h"
#include "net/conv_internal.h"
#include "net/layers.h"

static size_t places_of(const hada_conv_pass *pass)
{
    return (size_t)(pass->tile + 2) * (size_t)(pass->tile + 2);
}

hada_status hada_conv_winograd_pack(hada_conv *conv, int index, hada_floats weights, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const hada_program_conv_pack program =
        pass->tile == 4 ? HADA_PROGRAM_CONV_PACK_PACK8 : HADA_PROGRAM_CONV_PACK_PACK8_TILE2;
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
    return places_of(pass) * (size_t)(pass->tiles * channels + block) * sizeof(float);
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
    const hada_range range = hada_range_of(hada_divide_up(tiles, (size_t)pass->tiles), 1, (size_t)in->images, 1);
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
    const hada_range products = hada_range_of(filled / (size_t)pass->lanes, 1, places_of(pass), 1);
    const size_t m_offset = places_of(pass) * (size_t)in->block * (in_blocks * (size_t)pass->room + 1);
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
    const size_t tiles =
        hada_divide_up((size_t)out->cols, (size_t)pass->tile) * hada_divide_up((size_t)out->rows, (size_t)pass->tile);
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
