/* Launches of Winograd's convolutions: weights, one launch for all, or three for many channels. */
#include <stdio.h>

#include "net/conv_internal.h"

static size_t blocks_of(int channels, int block)
{
    return ((size_t)channels + (size_t)block - 1) / (size_t)block;
}

static int places_of(const hada_conv_pass *pass)
{
    return (pass->tile + 2) * (pass->tile + 2);
}

hada_status hada_conv_winograd_pack(hada_conv *conv, int index, cl_mem weights, size_t offset, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const size_t block = (size_t)conv->plan.block;
    const cl_ulong from = offset;
    const size_t local[3] = {1, 1, 1};
    const size_t global[3] = {blocks_of(pass->out_channels, conv->plan.block) * block / 8,
                              blocks_of(pass->in_channels, conv->plan.block) * block / 8, 1};
    const hada_arg args[] = {HADA_ARG(weights),
                             HADA_ARG(from),
                             HADA_ARG(pass->in_channels),
                             HADA_ARG(pass->out_channels),
                             HADA_ARG(pass->to_coarse),
                             HADA_ARG(pass->lanes),
                             HADA_ARG(conv->weights[index].mem)};
    return hada_conv_launch(conv->slot, "conv_pack", "conv_winograd_pack",
                            pass->tile == 4 ? "-DCONV_PACK=8" : "-DCONV_PACK=8 -DCONV_TILE=2", global, local, args,
                            HADA_COUNT(args), err);
}

static void make_options(const hada_conv *conv, const hada_conv_pass *pass, char *options, size_t size)
{
    snprintf(options, size, "-DNET_BLOCK=%d -DCONV_BLOCKS=%d -DCONV_PIXELS=%d -DCONV_TILE=%d", conv->plan.block,
             pass->lanes / conv->plan.block, pass->pixels, pass->tile);
}

/* Places of a work-item's tiles, a block apart (CONV_APART of kernels/inc_conv_winograd.h). */
static size_t local_bytes(const hada_conv_pass *pass, int channels, int block)
{
    return (size_t)places_of(pass) * (size_t)(pass->tiles * channels + block) * sizeof(float);
}

static hada_status one_launch(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *out,
                              const hada_conv_finish_args *f, size_t tiles, hada_error *err)
{
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const cl_ulong x_offset = in->offset, x_image = in->image_stride, y_offset = out->offset,
                   y_image = out->image_stride;
    const cl_int in_blocks = (cl_int)blocks_of(in->channels, in->block);
    const size_t local[3] = {1, 1, 1};
    const size_t global[3] = {(tiles + (size_t)pass->tiles - 1) / (size_t)pass->tiles, (size_t)in->images, 1};
    const hada_arg args[] = {HADA_ARG(in->mem),
                             HADA_ARG(x_offset),
                             HADA_ARG(x_image),
                             HADA_ARG(in_blocks),
                             HADA_ARG(conv->weights[index].mem),
                             HADA_ARG(f->bias),
                             HADA_ARG(f->bias_offset),
                             HADA_ARG(out->mem),
                             HADA_ARG(y_offset),
                             HADA_ARG(y_image),
                             HADA_ARG(out->channels),
                             HADA_ARG(out->rows),
                             HADA_ARG(out->cols),
                             HADA_ARG(pass->tiles),
                             HADA_ARG(f->flags),
                             HADA_ARG(f->activation),
                             HADA_ARG(f->slope),
                             HADA_ARG(f->mask),
                             HADA_ARG(f->mask_offset),
                             HADA_ARG(f->mask_image),
                             HADA_ARG(f->pooled),
                             HADA_ARG(f->pooled_offset),
                             HADA_ARG(f->pooled_image),
                             HADA_ARG_LOCAL(local_bytes(pass, in_blocks * in->block, in->block)),
                             HADA_ARG_LOCAL(local_bytes(pass, pass->lanes, in->block))};
    char options[96];
    make_options(conv, pass, options, sizeof options);
    return hada_conv_launch(conv->slot, "conv_winograd", "conv_winograd", options, global, local, args,
                            HADA_COUNT(args), err);
}

/* Inputs, products, outputs of the tiles begin ... begin + count - 1 of all images. */
static hada_status three_launches(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *out,
                                  const hada_conv_finish_args *f, cl_int begin, cl_int count, hada_error *err)
{
    hada_status status = HADA_OK;
    static const char file[] = "conv_winograd_steps";
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const cl_ulong x_offset = in->offset, x_image = in->image_stride, y_offset = out->offset,
                   y_image = out->image_stride;
    const cl_int in_blocks = (cl_int)blocks_of(in->channels, in->block);
    const size_t local[3] = {1, 1, 1}, tiles[3] = {(size_t)count, 1, 1};
    const size_t products[3] = {blocks_of(out->channels, out->block) * (size_t)out->block / (size_t)pass->lanes,
                                (size_t)places_of(pass), 1};
    const hada_arg in_args[] = {
        HADA_ARG(in->mem),  HADA_ARG(x_offset), HADA_ARG(x_image),    HADA_ARG(in_blocks),         HADA_ARG(in->rows),
        HADA_ARG(in->cols), HADA_ARG(begin),    HADA_ARG(pass->room), HADA_ARG(conv->scratch.mem),
    };
    const cl_ulong m_offset =
        (cl_ulong)places_of(pass) * (cl_ulong)in->block * ((cl_ulong)in_blocks * (cl_ulong)pass->room + 1);
    const hada_arg product_args[] = {
        HADA_ARG(conv->scratch.mem), HADA_ARG(m_offset), HADA_ARG(conv->weights[index].mem),
        HADA_ARG(in_blocks),         HADA_ARG(count),    HADA_ARG(pass->room)};
    const hada_arg out_args[] = {HADA_ARG(conv->scratch.mem), HADA_ARG(m_offset),         HADA_ARG(begin),
                                 HADA_ARG(pass->room),        HADA_ARG(f->bias),          HADA_ARG(f->bias_offset),
                                 HADA_ARG(out->mem),          HADA_ARG(y_offset),         HADA_ARG(y_image),
                                 HADA_ARG(out->channels),     HADA_ARG(out->rows),        HADA_ARG(out->cols),
                                 HADA_ARG(f->flags),          HADA_ARG(f->activation),    HADA_ARG(f->slope),
                                 HADA_ARG(f->mask),           HADA_ARG(f->mask_offset),   HADA_ARG(f->mask_image),
                                 HADA_ARG(f->pooled),         HADA_ARG(f->pooled_offset), HADA_ARG(f->pooled_image)};
    char options[96];
    make_options(conv, pass, options, sizeof options);
    HADA_TRY(hada_conv_launch(conv->slot, file, "conv_winograd_in", options, tiles, local, in_args, HADA_COUNT(in_args),
                              err));
    HADA_TRY(hada_conv_launch(conv->slot, file, "conv_winograd_products", options, products, local, product_args,
                              HADA_COUNT(product_args), err));
    HADA_TRY(hada_conv_launch(conv->slot, file, "conv_winograd_out", options, tiles, local, out_args,
                              HADA_COUNT(out_args), err));
done:
    return status;
}

hada_status hada_conv_winograd(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *out,
                               const hada_conv_finish *finish, hada_error *err)
{
    hada_status status = HADA_OK;
    const hada_conv_pass *pass = &conv->plan.pass[index];
    /* tiles of odd sizes stand on odd pixels at the far edges */
    const int pools = finish->pooled && out->rows % 2 == 0 && out->cols % 2 == 0;
    const hada_conv_finish_args f = hada_conv_finish_of(finish, pools);
    const size_t across = (size_t)((out->cols + pass->tile - 1) / pass->tile);
    const size_t tiles = across * (size_t)((out->rows + pass->tile - 1) / pass->tile);
    if (pass->tiles) {
        HADA_TRY(one_launch(conv, index, in, out, &f, tiles, err));
    } else {
        const int all = (int)tiles * in->images, most = pass->room;
        for (int begin = 0; begin < all; begin += most)
            HADA_TRY(three_launches(conv, index, in, out, &f, begin, all - begin < most ? all - begin : most, err));
    }
    if (finish->pooled && !pools)
        HADA_TRY(hada_conv_pool(conv, out, finish->pooled, err));
done:
    return status;
}
