/* Tensors: places, views, and how values come in and out. */
#include "net/tensor.h"

#include "launch/net_tensor.h"

int hada_net_block(const hada_context *context)
{
    return context->vector_floats >= 16 ? 16 : 8;
}

static size_t blocks_of(int block, int channels)
{
    return hada_divide_up((size_t)channels, (size_t)block);
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

hada_tensor_layout hada_layout_of(const hada_tensor *tensor)
{
    return (hada_tensor_layout){.offset = tensor->offset,
                                .image = tensor->image_stride,
                                .channels = tensor->channels,
                                .rows = tensor->rows,
                                .cols = tensor->cols,
                                .blocks = (int)blocks_of(tensor->block, tensor->channels)};
}

hada_planar hada_planar_at(cl_mem mem, size_t offset, int channels, int rows, int cols)
{
    const size_t plane = (size_t)rows * (size_t)cols;
    return (hada_planar){mem, offset, plane * (size_t)channels, plane, (size_t)cols};
}

hada_planar_layout hada_planar_layout_of(const hada_planar *planar)
{
    return (hada_planar_layout){planar->offset, planar->image_stride, planar->channel_stride, planar->row_stride};
}

/* In work-groups a work-item for four channels of a pixel; of the halo, a few share a row. On CPUs, where each costs a
 * call, one takes a whole row. */
enum { FOUR = 4, GROUP_ITEMS = 128, HALO_ITEMS = 16 };

size_t hada_tensor_planes(const hada_tensor *tensor)
{
    return blocks_of(tensor->block, tensor->channels) * (size_t)tensor->images;
}

static hada_range rows_range(const hada_slot *slot, const hada_tensor *tensor, int width, int height)
{
    if (slot->context->shape != HADA_SHAPE_GROUPS)
        return hada_range_of(1, 1, (size_t)height, hada_tensor_planes(tensor));
    return hada_range_of((size_t)width * (size_t)(tensor->block / FOUR), GROUP_ITEMS, (size_t)height,
                         hada_tensor_planes(tensor));
}

static hada_range halo_range(const hada_slot *slot, const hada_tensor *tensor)
{
    const size_t height = (size_t)tensor->rows + 2, down = GROUP_ITEMS / HALO_ITEMS;
    if (slot->context->shape != HADA_SHAPE_GROUPS)
        return hada_range_of(1, 1, height, hada_tensor_planes(tensor));
    return (hada_range){
        {HALO_ITEMS, hada_round_up(height, down), hada_tensor_planes(tensor)}, {HALO_ITEMS, down, 1}, 0};
}

hada_status hada_tensor_load(hada_slot *slot, const hada_planar *in, const hada_tensor *out, hada_error *err)
{
    const hada_range range = rows_range(slot, out, out->cols + 2, out->rows + 2);
    return hada_launch_net_tensor_load(slot, hada_program_net_tensor_of(slot), &range, err, .in = in->mem,
                                       .out = out->mem, .at_in = hada_planar_layout_of(in),
                                       .at_out = hada_layout_of(out), .block = out->block);
}

hada_status hada_tensor_store(hada_slot *slot, const hada_tensor *in, const hada_planar *out, hada_error *err)
{
    const hada_range range = rows_range(slot, in, in->cols, in->rows);
    return hada_launch_net_tensor_store(slot, hada_program_net_tensor_of(slot), &range, err, .in = in->mem,
                                        .out = out->mem, .at_in = hada_layout_of(in),
                                        .at_out = hada_planar_layout_of(out), .block = in->block);
}

hada_status hada_tensor_clear_halo(hada_slot *slot, const hada_tensor *tensor, hada_error *err)
{
    const hada_range range = halo_range(slot, tensor);
    return hada_launch_net_tensor_halo(slot, hada_program_net_tensor_of(slot), &range, err, .out = tensor->mem,
                                       .at_out = hada_layout_of(tensor), .block = tensor->block);
}
