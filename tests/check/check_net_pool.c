/* Pooling, and its gradient. */
#include "check_net.h"

static hada_status run(check_state *state, check_net *own, int first, int count, hada_error *err)
{
    const hada_tensor x = hada_tensor_images(&own->x[0], first, count), out = hada_tensor_images(&own->y, first, count);
    if (own->inputs == 1)
        return hada_pool_forward(state->slot, (hada_pool)own->mode, own->size, own->stride, &x, &out, err);
    const hada_tensor y = hada_tensor_images(&own->x[1], first, count);
    const hada_tensor dy = hada_tensor_images(&own->x[2], first, count);
    return hada_pool_backward(state->slot, (hada_pool)own->mode, own->size, own->stride, &x, &y, &dy, &out,
                              own->accumulate, err);
}

/* The second input is the output of the forward direction, which the gradient of a maximum needs. */
static hada_status pooled(check_state *state, check_net *own, const hada_ref_shape *pool, hada_error *err)
{
    HADA_TRY(check_net_input(state, own, pool, 9, err));
    const hada_tensor *x = &own->x[0], *y = &own->x[1];
    HADA_TRY(hada_pool_forward(state->slot, (hada_pool)own->mode, own->size, own->stride, x, y, err));
    return check_net_input(state, own, pool, 9, err);
}

static hada_status prepare(check_state *state, hada_error *err)
{
    check_net *own;
    double *out = NULL;
    const hada_ref_shape shape = check_net_shape(state);
    const int backward = check_get(state, 'd', 0);
    own = check_net_own(state, run);
    own->size = check_get(state, 's', 2);
    own->stride = check_get(state, 'i', 2);
    const hada_ref_shape pool = hada_ref_pool_shape(&shape, own->size, own->stride);
    const hada_ref_shape *made = backward ? &shape : &pool;
    /* few different values, so that windows hold equal ones */
    HADA_TRY(check_net_input(state, own, &shape, own->mode == HADA_POOL_MAX ? 2 : 9, err));
    if (backward)
        HADA_TRY(pooled(state, own, &pool, err));
    HADA_TRY(check_net_output(state, own, made, 0, 9, &out, err));
    if (!backward)
        hada_ref_pool(&shape, own->mode, own->size, own->stride, own->plain[0], out);
    else if (!own->accumulate)
        memset(out, 0, hada_ref_values(&shape) * sizeof *out);
    if (backward)
        hada_ref_pool_backward(&shape, own->mode, own->size, own->stride, own->plain[0], own->plain[2], out);
    check_net_expect(state, own, made, 0, out);
    state->tolerance = own->mode == HADA_POOL_MEAN && (own->size & (own->size - 1)) ? 3e-7 : 0.0;
    const double in_bytes = (double)hada_ref_values(&shape) * sizeof(float);
    const double out_bytes = (double)hada_ref_values(&pool) * sizeof(float);
    state->bytes = !backward                                    ? in_bytes + out_bytes
                   : check_get(state, 'b', 0) == HADA_POOL_MEAN ? in_bytes + out_bytes
                                                                : 2.0 * in_bytes + 2.0 * out_bytes;
    return HADA_OK;
}

const check_op check_net_pool = {"net_pool",
                                 "n images, k channels, r rows, c columns, v block, p1 gaps between images, b 0 "
                                 "largest, 1 mean, s size of windows, i "
                                 "stride, d1 backward, a1 added to",
                                 prepare, check_net_launch, NULL};
