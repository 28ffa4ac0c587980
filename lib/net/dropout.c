#include <math.h>

#include "net/layer_launch.h"

hada_status hada_dropout(hada_slot *slot, float p, uint64_t seed, uint64_t step, const hada_tensor *x,
                         const hada_tensor *y, hada_error *err)
{
    hada_status status = hada_layer_check("dropout", x, y, 1, err);
    if (status)
        return status;
    if (!(p >= 0.0f && p < 1.0f))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "dropout of %g is not possible; it must be from 0 to below 1", p);
    const hada_layer_grid grid = hada_layer_grid_of(slot, x, x->rows, x->cols);
    const hada_tensor_place at_x = hada_tensor_place_of(x), at_y = hada_tensor_place_of(y);
    const cl_int blocks = hada_tensor_blocks(x);
    const cl_uint key0 = (cl_uint)seed, key1 = (cl_uint)(seed >> 32) ^ (cl_uint)(step >> 32), count = (cl_uint)step;
    const cl_uint threshold = (cl_uint)ceil((double)p * 16777216.0);
    const cl_float scale = (cl_float)(1.0 / (1.0 - (double)p));
    const hada_arg args[] = {HADA_ARG_TENSOR(x, at_x), HADA_ARG_TENSOR(y, at_y), HADA_ARG(x->rows), HADA_ARG(x->cols),
                             HADA_ARG(blocks),         HADA_ARG(grid.span),      HADA_ARG(key0),    HADA_ARG(key1),
                             HADA_ARG(count),          HADA_ARG(threshold),      HADA_ARG(scale)};
    return hada_layer_launch(slot, "net_dropout", "net_dropout", x, &grid, args, HADA_COUNT(args), err);
}
