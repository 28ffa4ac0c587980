/* Launches of the passes of a convolution: packed weights, direct sums, the plain way, pooling. */
#include <stdio.h>

#include "net/conv_internal.h"
#include "runtime/kernel.h"

/* kernels/inc_conv.h */
enum { HAS_BIAS = 1, HAS_MASK = 2, ACCUMULATES = 4, POOLS = 8 };

static size_t rounded(size_t count, size_t to)
{
    return (count + to - 1) / to * to;
}

hada_status hada_conv_launch(hada_slot *slot, const char *file, const char *name, const char *options,
                             const size_t *global, const size_t *local, const hada_arg *args, size_t count,
                             hada_error *err)
{
    hada_status status = HADA_OK;
    cl_kernel kernel;
    HADA_TRY(hada_slot_kernel(slot, file, name, options, &kernel, err));
    HADA_TRY(hada_slot_launch(slot, kernel, name, 3, global, local, args, count, err));
done:
    return status;
}

void hada_conv_cost(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine)
{
    const hada_conv_desc *d = &conv->plan.desc;
    const double pixels = (double)coarse->rows * coarse->cols * coarse->images;
    const double weights = (double)d->in_channels * d->out_channels * d->kernel_rows * d->kernel_cols;
    const double values = pixels * coarse->channels + (double)fine->rows * fine->cols * fine->images * fine->channels;
    hada_slot_cost(conv->slot, (values + weights) * sizeof(float), 2.0 * pixels * weights);
}

const char *hada_conv_block_option(int block)
{
    return block == 16 ? "-DNET_BLOCK=16" : "";
}

hada_status hada_conv_pack(hada_conv *conv, int index, cl_mem weights, size_t offset, hada_error *err)
{
    const hada_conv_desc *d = &conv->plan.desc;
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const hada_buffer *packed = &conv->weights[index];
    if (pass->method == HADA_CONV_PLAIN) {
        const cl_int code = clEnqueueCopyBuffer(conv->slot->queue, weights, packed->mem, offset * sizeof(float), 0,
                                                pass->weight_floats * sizeof(float), 0, NULL, NULL);
        return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    }
    const cl_ulong from = offset;
    const cl_int block = conv->plan.block;
    const hada_arg args[] = {HADA_ARG(weights),
                             HADA_ARG(from),
                             HADA_ARG(pass->in_channels),
                             HADA_ARG(pass->out_channels),
                             HADA_ARG(pass->to_coarse),
                             HADA_ARG(d->kernel_rows),
                             HADA_ARG(d->kernel_cols),
                             HADA_ARG(pass->taps_rows),
                             HADA_ARG(pass->taps_cols),
                             HADA_ARG(pass->step),
                             HADA_ARG(block),
                             HADA_ARG(pass->lanes),
                             HADA_ARG(packed->mem)};
    const size_t each = conv->plan.groups ? 1 : 8;
    const size_t local[3] = {8 / each, 1, 1};
    const size_t global[3] = {rounded((size_t)pass->out_channels, (size_t)pass->lanes) / each,
                              rounded((size_t)pass->in_channels, (size_t)block) / each, 1};
    return hada_conv_launch(conv->slot, "conv_pack", "conv_pack", each == 1 ? "" : "-DCONV_PACK=8", global, local, args,
                            HADA_COUNT(args), err);
}

hada_status hada_conv_pool(hada_conv *conv, const hada_tensor *y, const hada_tensor *pooled, hada_error *err)
{
    const cl_ulong from = y->offset, from_image = y->image_stride, to = pooled->offset, to_image = pooled->image_stride;
    const int groups = conv->plan.groups;
    const size_t blocks = rounded((size_t)y->channels, (size_t)y->block) / (size_t)y->block;
    const cl_int each = groups ? 1 : pooled->cols;
    const size_t local[3] = {groups ? 64 : 1, 1, 1};
    const size_t global[3] = {groups ? rounded((size_t)pooled->cols, 64) : 1, (size_t)pooled->rows,
                              blocks * (size_t)y->images};
    const cl_int block_count = (cl_int)blocks;
    const hada_arg args[] = {HADA_ARG(y->mem),       HADA_ARG(from),         HADA_ARG(from_image),  HADA_ARG(y->rows),
                             HADA_ARG(y->cols),      HADA_ARG(pooled->mem),  HADA_ARG(to),          HADA_ARG(to_image),
                             HADA_ARG(pooled->rows), HADA_ARG(pooled->cols), HADA_ARG(block_count), HADA_ARG(each)};
    return hada_conv_launch(conv->slot, "conv_pool", "conv_pool", hada_conv_block_option(y->block), global, local, args,
                            HADA_COUNT(args), err);
}

hada_conv_finish_args hada_conv_finish_of(const hada_conv_finish *finish, int pools)
{
    hada_conv_finish_args f = {.bias = finish->bias,
                               .bias_offset = finish->bias_offset,
                               .activation = (cl_int)finish->activation,
                               .slope = finish->slope,
                               .flags = (finish->bias ? HAS_BIAS : 0) | (finish->mask ? HAS_MASK : 0) |
                                        (finish->accumulate ? ACCUMULATES : 0) | (pools ? POOLS : 0)};
    if (finish->mask) {
        f.mask = finish->mask->mem;
        f.mask_offset = finish->mask->offset;
        f.mask_image = finish->mask->image_stride;
    }
    if (pools) {
        f.pooled = finish->pooled->mem;
        f.pooled_offset = finish->pooled->offset;
        f.pooled_image = finish->pooled->image_stride;
    }
    return f;
}

hada_status hada_conv_direct(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *out,
                             const hada_conv_finish *finish, hada_error *err)
{
    hada_status status = HADA_OK;
    const hada_conv_desc *d = &conv->plan.desc;
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const hada_conv_finish_args f = hada_conv_finish_of(finish, 0);
    const cl_ulong x_offset = in->offset, x_image = in->image_stride, y_offset = out->offset,
                   y_image = out->image_stride;
    const int block = conv->plan.block, groups = conv->plan.groups;
    const size_t out_groups = rounded((size_t)out->channels, (size_t)pass->lanes) / (size_t)pass->lanes;
    /* both kernels go through the image in their own way: two numbers differ */
    const cl_int way[2] = {groups ? pass->in_step : pass->step, groups ? pass->step : pass->rows_each};
    const hada_arg args[] = {HADA_ARG(in->mem),
                             HADA_ARG(x_offset),
                             HADA_ARG(x_image),
                             HADA_ARG(in->channels),
                             HADA_ARG(in->rows),
                             HADA_ARG(in->cols),
                             HADA_ARG(conv->weights[index].mem),
                             HADA_ARG(f.bias),
                             HADA_ARG(f.bias_offset),
                             HADA_ARG(out->mem),
                             HADA_ARG(y_offset),
                             HADA_ARG(y_image),
                             HADA_ARG(out->channels),
                             HADA_ARG(out->rows),
                             HADA_ARG(out->cols),
                             HADA_ARG(d->kernel_rows),
                             HADA_ARG(d->kernel_cols),
                             HADA_ARG(pass->taps_rows),
                             HADA_ARG(pass->taps_cols),
                             HADA_ARG(way[0]),
                             HADA_ARG(way[1]),
                             HADA_ARG(f.flags),
                             HADA_ARG(f.activation),
                             HADA_ARG(f.slope),
                             HADA_ARG(f.mask),
                             HADA_ARG(f.mask_offset),
                             HADA_ARG(f.mask_image)};
    if (groups) {
        const size_t pixels =
            (size_t)((out->rows + pass->step - 1) / pass->step) * (size_t)((out->cols + pass->step - 1) / pass->step);
        const size_t local[3] = {64, 1, 1};
        const size_t global[3] = {rounded(pixels, 64), out_groups,
                                  (size_t)in->images * (size_t)(pass->step * pass->step)};
        HADA_TRY(hada_conv_launch(conv->slot, "conv_group", "conv_group", hada_conv_block_option(block), global, local,
                                  args, HADA_COUNT(args), err));
    } else {
        const size_t local[3] = {1, 1, 1};
        const size_t global[3] = {out_groups, (size_t)((out->rows + pass->rows_each - 1) / pass->rows_each),
                                  (size_t)in->images};
        char options[96];
        snprintf(options, sizeof options, "-DNET_BLOCK=%d -DCONV_BLOCKS=%d -DCONV_PIXELS=%d -DCONV_STEP=%d", block,
                 pass->lanes / block, pass->pixels, pass->in_step);
        HADA_TRY(hada_conv_launch(conv->slot, "conv_direct", "conv_direct", options, global, local, args,
                                  HADA_COUNT(args), err));
    }
    if (finish->pooled)
        HADA_TRY(hada_conv_pool(conv, out, finish->pooled, err));
done:
    return status;
}

hada_status hada_conv_plain(hada_conv *conv, int index, const hada_tensor *in, const hada_tensor *out,
                            const hada_conv_finish *finish, hada_error *err)
{
    hada_status status = HADA_OK;
    const hada_conv_desc *d = &conv->plan.desc;
    const hada_conv_pass *pass = &conv->plan.pass[index];
    const hada_conv_finish_args f = hada_conv_finish_of(finish, 0);
    const cl_ulong x_offset = in->offset, x_image = in->image_stride, y_offset = out->offset,
                   y_image = out->image_stride;
    const size_t block = (size_t)conv->plan.block, blocks = rounded((size_t)out->channels, block) / block;
    const size_t local[3] = {8, 1, 1};
    const size_t global[3] = {rounded((size_t)out->cols, 8), (size_t)out->rows, blocks * (size_t)in->images};
    const hada_arg args[] = {HADA_ARG(in->mem),
                             HADA_ARG(x_offset),
                             HADA_ARG(x_image),
                             HADA_ARG(in->channels),
                             HADA_ARG(in->rows),
                             HADA_ARG(in->cols),
                             HADA_ARG(conv->weights[index].mem),
                             HADA_ARG(f.bias),
                             HADA_ARG(f.bias_offset),
                             HADA_ARG(out->mem),
                             HADA_ARG(y_offset),
                             HADA_ARG(y_image),
                             HADA_ARG(out->channels),
                             HADA_ARG(out->rows),
                             HADA_ARG(out->cols),
                             HADA_ARG(pass->to_coarse),
                             HADA_ARG(d->kernel_rows),
                             HADA_ARG(d->kernel_cols),
                             HADA_ARG(d->pad_rows),
                             HADA_ARG(d->pad_cols),
                             HADA_ARG(d->stride),
                             HADA_ARG(f.flags),
                             HADA_ARG(f.activation),
                             HADA_ARG(f.slope),
                             HADA_ARG(f.mask),
                             HADA_ARG(f.mask_offset),
                             HADA_ARG(f.mask_image)};
    HADA_TRY(hada_conv_launch(conv->slot, "conv_plain", "conv_plain", hada_conv_block_option((int)block), global, local,
                              args, HADA_COUNT(args), err));
    if (finish->pooled)
        HADA_TRY(hada_conv_pool(conv, out, finish->pooled, err));
done:
    return status;
}
