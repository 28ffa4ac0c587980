/* What the layers share on the host: tests of shapes, the launch over the pixels of a tensor (kernels/inc_layers.h),
 * sums in a fixed order. Internal. */
#ifndef HADA_NET_LAYER_LAUNCH_H
#define HADA_NET_LAYER_LAUNCH_H

#include "net/layers.h"

/* A tensor as kernels take it: memory, offset, distance of images. */
#define HADA_ARG_TENSOR(tensor, place) HADA_ARG((tensor)->mem), HADA_ARG((place).offset), HADA_ARG((place).image)
typedef struct hada_tensor_place {
    cl_ulong offset, image;
} hada_tensor_place;
hada_tensor_place hada_tensor_place_of(const hada_tensor *tensor);

cl_int hada_tensor_blocks(const hada_tensor *tensor);

/* How `rows` x `cols` pixels of every block and image are shared out. */
typedef struct hada_layer_grid {
    size_t global[3], local[3];
    cl_int span; /* rows that a work-item takes */
} hada_layer_grid;
hada_layer_grid hada_layer_grid_of(const hada_slot *slot, const hada_tensor *tensor, int rows, int cols);
size_t hada_layer_grid_items(const hada_layer_grid *grid);
/* The most work-items of a grid over a tensor of this shape on any device: what scratch must hold. */
size_t hada_layer_items_at_most(const hada_tensor *tensor);

/* Enqueues a kernel of a file that is compiled for the tensor's block. */
hada_status hada_layer_launch(hada_slot *slot, const char *file, const char *name, const hada_tensor *tensor,
                              const hada_layer_grid *grid, const hada_arg *args, size_t arg_count, hada_error *err);

/* The same over `items` times `lines` work-items, each doing one thing. `block` 0: the file has no blocks. */
hada_status hada_layer_launch_flat(hada_slot *slot, const char *file, const char *name, int block, size_t items,
                                   size_t lines, const hada_arg *args, size_t arg_count, hada_error *err);

/* Refuses tensors that are empty, of another block than 8 or 16, or (same_shape) of another shape than x. `layer` names
 * the operation in messages. */
hada_status hada_layer_check(const char *layer, const hada_tensor *x, const hada_tensor *y, int same_shape,
                             hada_error *err);

/* out = shift + scale * the sum of `count` floats from `first` of `scratch` on, which also has room for
 * hada_sum_scratch() floats behind them. */
size_t hada_sum_scratch(size_t count);
hada_status hada_sum_floats(hada_slot *slot, cl_mem scratch, size_t first, size_t count, float scale, float shift,
                            hada_floats out, hada_error *err);

#endif
