/* What the layers share on the host: the launch over the pixels of a tensor (kernels/inc_layers.h),
 * sums in a fixed order. Internal. */
#ifndef HADA_NET_LAYER_LAUNCH_H
#define HADA_NET_LAYER_LAUNCH_H

#include "net/layers.h"
#include "runtime/launch.h"

/* How `rows` x `cols` pixels of every block and image are shared out. */
typedef struct hada_layer_grid {
    hada_range range;
    int span; /* rows that a work-item takes */
} hada_layer_grid;
enum { HADA_LAYER_FOUR = 4 }; /* channels of a vector in work-groups */
hada_layer_grid hada_layer_grid_of(const hada_slot *slot, const hada_tensor *tensor, int rows, int cols);
/* The same for kernels whose work-items take whole pixels of a block on GPUs too. */
hada_layer_grid hada_layer_pixel_grid_of(const hada_slot *slot, const hada_tensor *tensor, int rows, int cols);
/* For kernels that make sums, one for each work-group: how many, and how many at most on any device, which scratch must
 * hold. */
hada_layer_grid hada_layer_sum_grid_of(const hada_slot *slot, const hada_tensor *tensor);
size_t hada_layer_grid_sums(const hada_layer_grid *grid);
size_t hada_layer_sums_at_most(const hada_tensor *tensor);

/* `items` times `lines` work-items, each doing one thing. */
hada_range hada_layer_flat_range(const hada_slot *slot, size_t items, size_t lines);

/* out = scale * the sum of the first `count` floats of `scratch`, which also has room for hada_sum_scratch() floats
 * behind them. */
size_t hada_sum_scratch(size_t count);
hada_status hada_sum_floats(hada_slot *slot, cl_mem scratch, size_t count, float scale, hada_floats out,
                            hada_error *err);

#endif
