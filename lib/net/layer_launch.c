#include "net/layer_launch.h"

#include <limits.h>

#include "launch/net_sum.h"

enum {
    ITEM_FLOATS = 8192, /* of a tensor per work-item on CPUs: above what a work-group's start costs, within the cache */
    GROUP_ITEMS = 128,  /* of a group that makes no sum, on GPUs */
    FEWEST_ITEMS = 8,   /* of its items in a row */
    SUM_VECTORS = 32,   /* that a work-item adds up on GPUs before its group does */
    FLAT_LOCAL = 128
};

/* Runs of whole rows. */
static hada_layer_grid lanes_grid(const hada_tensor *tensor, int rows, int cols)
{
    const size_t row_floats = (size_t)cols * (size_t)tensor->block, wanted = ITEM_FLOATS / row_floats;
    const int span = wanted < 2 ? 1 : wanted < (size_t)rows ? (int)wanted : rows;
    return (hada_layer_grid){
        hada_range_groups(1, 1, hada_divide_up((size_t)rows, (size_t)span), hada_tensor_planes(tensor)), span};
}

/* A vector for each work-item; narrow rows share a group. */
static hada_layer_grid groups_grid(const hada_tensor *tensor, int rows, size_t vectors)
{
    size_t across = GROUP_ITEMS;
    while (across > FEWEST_ITEMS && across / 2 >= vectors)
        across /= 2;
    const size_t down = GROUP_ITEMS / across;
    return (hada_layer_grid){
        {{hada_round_up(vectors, across), hada_round_up((size_t)rows, down), hada_tensor_planes(tensor)},
         {across, down, 1},
         0},
        1};
}

/* A group for some rows. */
static hada_layer_grid groups_sum_grid(const hada_tensor *tensor)
{
    const size_t vectors = (size_t)tensor->cols * (size_t)(tensor->block / HADA_LAYER_FOUR);
    const size_t wanted = SUM_VECTORS * HADA_NET_GROUP / vectors, rows = (size_t)tensor->rows;
    const size_t span = wanted < 1 ? 1 : wanted < rows ? wanted : rows;
    return (hada_layer_grid){
        hada_range_groups(1, HADA_NET_GROUP, hada_divide_up(rows, span), hada_tensor_planes(tensor)), (int)span};
}

hada_layer_grid hada_layer_grid_of(const hada_slot *slot, const hada_tensor *tensor, int rows, int cols)
{
    return hada_slot_in_groups(slot)
               ? groups_grid(tensor, rows, (size_t)cols * (size_t)(tensor->block / HADA_LAYER_FOUR))
               : lanes_grid(tensor, rows, cols);
}

hada_layer_grid hada_layer_pixel_grid_of(const hada_slot *slot, const hada_tensor *tensor, int rows, int cols)
{
    return hada_slot_in_groups(slot) ? groups_grid(tensor, rows, (size_t)cols) : lanes_grid(tensor, rows, cols);
}

hada_layer_grid hada_layer_sum_grid_of(const hada_slot *slot, const hada_tensor *tensor)
{
    return hada_slot_in_groups(slot) ? groups_sum_grid(tensor) : lanes_grid(tensor, tensor->rows, tensor->cols);
}

size_t hada_layer_grid_sums(const hada_layer_grid *grid)
{
    const hada_range *r = &grid->range;
    return r->global[0] / r->local[0] * r->global[1] * r->global[2];
}

size_t hada_layer_sums_at_most(const hada_tensor *tensor)
{
    const hada_layer_grid lanes = lanes_grid(tensor, tensor->rows, tensor->cols), groups = groups_sum_grid(tensor);
    const size_t a = hada_layer_grid_sums(&lanes), b = hada_layer_grid_sums(&groups);
    return a > b ? a : b;
}

hada_range hada_layer_flat_range(const hada_slot *slot, size_t items, size_t lines)
{
    return hada_range_of(items, hada_slot_in_groups(slot) ? FLAT_LOCAL : 1, lines, 1);
}

size_t hada_sum_scratch(size_t count)
{
    size_t floats = 0;
    while (count > HADA_SUM_RUN)
        floats += count = hada_divide_up(count, HADA_SUM_RUN);
    return floats;
}

hada_status hada_sum_floats(hada_slot *slot, cl_mem scratch, size_t count, float scale, hada_floats out,
                            hada_error *err)
{
    size_t first = 0;
    if (count > UINT_MAX)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "a sum of %zu values is too long", count);
    for (int last = 0; !last;) {
        const size_t runs = hada_divide_up(count, HADA_SUM_RUN);
        const hada_range range = hada_layer_flat_range(slot, runs, 1);
        last = runs == 1;
        HADA_TRY(hada_launch_net_sum(slot, HADA_PROGRAM_NET_SUM_DEFAULT, &range, err, .in = scratch,
                                     .out = last ? out.mem : scratch, .in_offset = first,
                                     .out_offset = last ? out.offset : first + count, .in_count = (cl_uint)count,
                                     .scale = last ? scale : 1.0f));
        first += count;
        count = runs;
    }
    return HADA_OK;
}
