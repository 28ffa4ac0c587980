/* Tensors: places, views, and how values come in and out. */
#include "net/tensor.h"

#include "runtime/kernel.h"

int hada_net_block(const hada_context *context)
{
    return context->vector_floats >= 16 ? 16 : 8;
}

static size_t blocks_of(int block, int channels)
{
    return ((size_t)channels + (size_t)block - 1) / (size_t)block;
}

static size_t plane_floats(int block, int rows, int cols)
{
    return ((size_t)rows + 2) * ((size_t)cols + 2) * (size_t)block;
}

size_t hada_tensor_image_floats(int block, int channels, int rows, int cols)
{
    return blocks_of(block, channels) * plane_floats(block, rows, cols);
}

hada_tensor hada_tensor_at(const hada_context *context, cl_mem mem, size_t offset, int images, int channels, int rows,
                           int cols)
{
    const int block = hada_net_block(context);
    return (hada_tensor){mem,  offset, hada_tensor_image_floats(block, channels, rows, cols), images, channels, rows,
                         cols, block};
}

hada_tensor hada_tensor_channels(const hada_tensor *tensor, int first, int count)
{
    hada_tensor view = *tensor;
    view.offset += (size_t)(first / tensor->block) * plane_floats(tensor->block, tensor->rows, tensor->cols);
    view.channels = count;
    return view;
}

hada_tensor hada_tensor_images(const hada_tensor *tensor, int first, int count)
{
    hada_tensor view = *tensor;
    view.offset += (size_t)first * tensor->image_stride;
    view.images = count;
    return view;
}

/* A work-item takes a whole row on CPUs, where each costs a call; one pixel on GPUs. */
static hada_status launch(hada_slot *slot, const char *name, const hada_tensor *tensor, int width, int height,
                          cl_int *step, const hada_arg *args, size_t count, hada_error *err)
{
    hada_status status = HADA_OK;
    const int groups = slot->context->shape == HADA_SHAPE_GROUPS;
    const size_t local[3] = {groups ? 64 : 1, 1, 1};
    const size_t global[3] = {groups ? ((size_t)width + 63) / 64 * 64 : 1, (size_t)height,
                              blocks_of(tensor->block, tensor->channels) * (size_t)tensor->images};
    cl_kernel kernel;
    *step = groups ? 1 : width;
    HADA_TRY(hada_slot_kernel(slot, "net_tensor", name, "", &kernel, err));
    HADA_TRY(hada_slot_launch(slot, kernel, name, 3, global, local, args, count, err));
done:
    return status;
}

hada_status hada_tensor_load(hada_slot *slot, const hada_planar *in, const hada_tensor *out, hada_error *err)
{
    const cl_ulong in_offset = in->offset, in_image = in->image_stride, in_channel = in->channel_stride;
    const cl_ulong in_row = in->row_stride, out_offset = out->offset, out_image = out->image_stride;
    cl_int step;
    const hada_arg args[] = {HADA_ARG(in->mem),       HADA_ARG(in_offset), HADA_ARG(in_image),   HADA_ARG(in_channel),
                             HADA_ARG(in_row),        HADA_ARG(out->mem),  HADA_ARG(out_offset), HADA_ARG(out_image),
                             HADA_ARG(out->channels), HADA_ARG(out->rows), HADA_ARG(out->cols),  HADA_ARG(out->block),
                             HADA_ARG(step)};
    return launch(slot, "net_tensor_load", out, out->cols + 2, out->rows + 2, &step, args, HADA_COUNT(args), err);
}

hada_status hada_tensor_store(hada_slot *slot, const hada_tensor *in, const hada_planar *out, hada_error *err)
{
    const cl_ulong in_offset = in->offset, in_image = in->image_stride, out_offset = out->offset;
    const cl_ulong out_image = out->image_stride, out_channel = out->channel_stride, out_row = out->row_stride;
    cl_int step;
    const hada_arg args[] = {HADA_ARG(in->mem),      HADA_ARG(in_offset), HADA_ARG(in_image),    HADA_ARG(out->mem),
                             HADA_ARG(out_offset),   HADA_ARG(out_image), HADA_ARG(out_channel), HADA_ARG(out_row),
                             HADA_ARG(in->channels), HADA_ARG(in->rows),  HADA_ARG(in->cols),    HADA_ARG(in->block),
                             HADA_ARG(step)};
    return launch(slot, "net_tensor_store", in, in->cols, in->rows, &step, args, HADA_COUNT(args), err);
}

hada_status hada_tensor_clear_halo(hada_slot *slot, const hada_tensor *tensor, hada_error *err)
{
    hada_status status = HADA_OK;
    const cl_ulong offset = tensor->offset, image = tensor->image_stride;
    const hada_arg args[] = {HADA_ARG(tensor->mem),      HADA_ARG(offset),       HADA_ARG(image),
                             HADA_ARG(tensor->channels), HADA_ARG(tensor->rows), HADA_ARG(tensor->cols),
                             HADA_ARG(tensor->block)};
    const size_t local[3] = {1, 1, 1};
    const size_t global[3] = {1, (size_t)tensor->rows + 2,
                              blocks_of(tensor->block, tensor->channels) * (size_t)tensor->images};
    cl_kernel kernel;
    HADA_TRY(hada_slot_kernel(slot, "net_tensor", "net_tensor_halo", "", &kernel, err));
    HADA_TRY(hada_slot_launch(slot, kernel, "net_tensor_halo", 3, global, local, args, HADA_COUNT(args), err));
done:
    return status;
}
