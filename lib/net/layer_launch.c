#include "net/layer_launch.h"

#include <limits.h>

#include "runtime/kernel.h"

enum {
    ITEM_FLOATS = 8192, /* of a tensor per work-item on CPUs: above what a work-group's start costs, within the cache */
    ROW_ITEMS = 32,     /* work-items that share a row on GPUs */
    FLAT_LOCAL = 64,
    SUM_RUN = 64 /* as in net_sum.cl */
};

static size_t divide_up(size_t a, size_t b)
{
    return (a + b - 1) / b;
}

hada_tensor_place hada_tensor_place_of(const hada_tensor *tensor)
{
    return (hada_tensor_place){tensor->offset, tensor->image_stride};
}

cl_int hada_tensor_blocks(const hada_tensor *tensor)
{
    return (tensor->channels + tensor->block - 1) / tensor->block;
}

static hada_layer_grid grid_of(int groups, const hada_tensor *tensor, int rows, int cols)
{
    const size_t row_floats = (size_t)cols * (size_t)tensor->block, wanted = ITEM_FLOATS / row_floats;
    hada_layer_grid grid = {.local = {groups ? ROW_ITEMS : 1, 1, 1}};
    grid.span = groups || wanted < 2 ? 1 : wanted < (size_t)rows ? (cl_int)wanted : rows;
    grid.global[0] = grid.local[0];
    grid.global[1] = divide_up((size_t)rows, (size_t)grid.span);
    grid.global[2] = (size_t)hada_tensor_blocks(tensor) * (size_t)tensor->images;
    return grid;
}

hada_layer_grid hada_layer_grid_of(const hada_slot *slot, const hada_tensor *tensor, int rows, int cols)
{
    return grid_of(slot->context->shape == HADA_SHAPE_GROUPS, tensor, rows, cols);
}

size_t hada_layer_grid_items(const hada_layer_grid *grid)
{
    return grid->global[0] * grid->global[1] * grid->global[2];
}

size_t hada_layer_items_at_most(const hada_tensor *tensor)
{
    const hada_layer_grid groups = grid_of(1, tensor, tensor->rows, tensor->cols);
    return hada_layer_grid_items(&groups); /* lanes have fewer: one item for a row or more */
}

static const char *options_of(int block)
{
    return block == 16 ? "-DNET_BLOCK=16" : "";
}

hada_status hada_layer_launch(hada_slot *slot, const char *file, const char *name, const hada_tensor *tensor,
                              const hada_layer_grid *grid, const hada_arg *args, size_t arg_count, hada_error *err)
{
    hada_status status = HADA_OK;
    cl_kernel kernel;
    HADA_TRY(hada_slot_kernel(slot, file, name, options_of(tensor->block), &kernel, err));
    HADA_TRY(hada_slot_launch(slot, kernel, name, 3, grid->global, grid->local, args, arg_count, err));
done:
    return status;
}

hada_status hada_layer_launch_flat(hada_slot *slot, const char *file, const char *name, int block, size_t items,
                                   size_t lines, const hada_arg *args, size_t arg_count, hada_error *err)
{
    hada_status status = HADA_OK;
    const size_t local[2] = {slot->context->shape == HADA_SHAPE_GROUPS ? FLAT_LOCAL : 1, 1};
    const size_t global[2] = {divide_up(items, local[0]) * local[0], lines};
    cl_kernel kernel;
    HADA_TRY(hada_slot_kernel(slot, file, name, options_of(block), &kernel, err));
    HADA_TRY(hada_slot_launch(slot, kernel, name, 2, global, local, args, arg_count, err));
done:
    return status;
}

static int possible(const hada_tensor *t)
{
    return t->images >= 1 && t->channels >= 1 && t->rows >= 1 && t->cols >= 1 && (t->block == 8 || t->block == 16);
}

hada_status hada_layer_check(const char *layer, const hada_tensor *x, const hada_tensor *y, int same_shape,
                             hada_error *err)
{
    if (!possible(x) || !possible(y))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "%s: a tensor has at least one image, channel, row and column, in blocks of 8 or 16", layer);
    if (x->images != y->images || x->block != y->block)
        return hada_fail(err, HADA_ERROR_SIZE, "%s: %d images in blocks of %d against %d images in blocks of %d", layer,
                         x->images, x->block, y->images, y->block);
    if (same_shape && (x->channels != y->channels || x->rows != y->rows || x->cols != y->cols))
        return hada_fail(err, HADA_ERROR_SIZE, "%s: %d channels of %d x %d against %d channels of %d x %d", layer,
                         x->channels, x->rows, x->cols, y->channels, y->rows, y->cols);
    return HADA_OK;
}

size_t hada_sum_scratch(size_t count)
{
    size_t floats = 0;
    while (count > SUM_RUN)
        floats += count = divide_up(count, SUM_RUN);
    return floats;
}

hada_status hada_sum_floats(hada_slot *slot, cl_mem scratch, size_t first, size_t count, float scale, float shift,
                            hada_floats out, hada_error *err)
{
    hada_status status = HADA_OK;
    if (count > UINT_MAX)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "a sum of %zu values is too long", count);
    for (int last = 0; !last;) {
        const size_t runs = divide_up(count, SUM_RUN);
        last = runs == 1;
        const cl_mem to = last ? out.mem : scratch;
        const cl_ulong in_offset = first, out_offset = last ? out.offset : first + count;
        const cl_uint in_count = (cl_uint)count;
        const cl_float times = last ? scale : 1.0f, plus = last ? shift : 0.0f;
        const hada_arg args[] = {HADA_ARG(scratch),    HADA_ARG(in_offset), HADA_ARG(in_count), HADA_ARG(to),
                                 HADA_ARG(out_offset), HADA_ARG(times),     HADA_ARG(plus)};
        const size_t one[2] = {1, 1}, global[2] = {runs, 1};
        cl_kernel kernel;
        HADA_TRY(hada_slot_kernel(slot, "net_sum", "net_sum", "", &kernel, err));
        HADA_TRY(hada_slot_launch(slot, kernel, "net_sum", 2, global, one, args, HADA_COUNT(args), err));
        first += count;
        count = runs;
    }
done:
    return status;
}
