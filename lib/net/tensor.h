/* Activations of a net on the device: images in blocks of channels. Internal.
 *
 * The value (image n, channel c, row y, column x) stands at float
 *     offset + n * image_stride + ((c / block) * (rows + 2) + y + 1) * (cols + 2) * block + (x + 1) * block + c %
 * block. Around every plane stands a halo of one zero, so that 3 x 3 convolutions need no tests at the edge, and the
 * channels that fill up the last block are zero: both must hold whenever an operation reads a tensor. Operations write
 * the inside and zeros into the channels that fill up; hada_tensor_clear_halo() writes the halo where memory was used
 * for something else before. A tensor is a view: it owns nothing; a run of whole blocks of another tensor is one as
 * well, so that concatenation costs nothing where channel counts are multiples of the block. */
#ifndef HADA_NET_TENSOR_H
#define HADA_NET_TENSOR_H

#include "kernels/shared_net.h"
#include "runtime/buffer.h"

/* A plain array of floats in a buffer; mem NULL: none. */
typedef struct hada_floats {
    cl_mem mem;
    size_t offset;
} hada_floats;

typedef struct hada_tensor {
    cl_mem mem;
    size_t offset, image_stride; /* in floats */
    int images, channels, rows, cols;
    int block; /* hada_net_block() of the context */
} hada_tensor;

/* Channels in a block on this context: 8, or 16 where the device's vectors are that long. */
int hada_net_block(const hada_context *context);

/* A tensor as kernels take it beside its memory. */
hada_tensor_layout hada_layout_of(const hada_tensor *tensor);
/* Blocks of channels of all images. */
size_t hada_tensor_planes(const hada_tensor *tensor);

/* The program of a kernel file that has one for blocks of 8 and one for blocks of 16. */
#define HADA_PROGRAM_BY_BLOCK(FILE, block)                                                                             \
    ((block) == 16 ? HADA_PROGRAM_##FILE##_BLOCK16 : HADA_PROGRAM_##FILE##_DEFAULT)

/* The same where work-groups have programs of their own, which take four channels of a pixel at a time. */
#define HADA_PROGRAM_OF_LAYER(FILE, slot, block)                                                                       \
    ((slot)->context->shape != HADA_SHAPE_GROUPS ? HADA_PROGRAM_BY_BLOCK(FILE, block)                                  \
     : (block) == 16                             ? HADA_PROGRAM_##FILE##_BLOCK16_FOURS                                 \
                                                 : HADA_PROGRAM_##FILE##_FOURS)

/* Floats of one image: blocks x (rows + 2) x (cols + 2) x block. */
size_t hada_tensor_image_floats(int block, int channels, int rows, int cols);

/* A tensor of its own at `offset` of a buffer, images one after the other. */
hada_tensor hada_tensor_at(const hada_context *context, cl_mem mem, size_t offset, int images, int channels, int rows,
                           int cols);

/* The channels first ... first + count - 1 of a tensor; first is a multiple of the block. */
hada_tensor hada_tensor_channels(const hada_tensor *tensor, int first, int count);

/* The images first ... first + count - 1. */
hada_tensor hada_tensor_images(const hada_tensor *tensor, int first, int count);

/* Writes zeros into the halo (enqueued). */
hada_status hada_tensor_clear_halo(hada_slot *slot, const hada_tensor *tensor, hada_error *err);

/* From and to planar floats on the device, [image][channel][rows][cols] with the given strides in floats (enqueued).
 * Loading writes the whole tensor: inside, filling channels and halo. */
typedef struct hada_planar {
    cl_mem mem;
    size_t offset, image_stride, channel_stride, row_stride;
} hada_planar;
hada_planar_layout hada_planar_layout_of(const hada_planar *planar);
/* Images one after the other, without gaps; and such of a tensor's shape. */
hada_planar hada_planar_at(cl_mem mem, size_t offset, int channels, int rows, int cols);
static inline hada_planar hada_planar_like(const hada_tensor *tensor, cl_mem mem, size_t offset)
{
    return hada_planar_at(mem, offset, tensor->channels, tensor->rows, tensor->cols);
}
hada_status hada_tensor_load(hada_slot *slot, const hada_planar *in, const hada_tensor *out, hada_error *err);
hada_status hada_tensor_store(hada_slot *slot, const hada_tensor *in, const hada_planar *out, hada_error *err);

#endif
