/* Resizing and placing, and their gradients. */
#include "check_net.h"

static hada_status run_resize(check_state *state, check_net *own, int first, int count, hada_error *err)
{
    const hada_tensor in = hada_tensor_images(&own->x[0], first, count);
    const hada_tensor out = hada_tensor_images(&own->y, first, count);
    const hada_resize resize = (hada_resize)own->mode;
    return check_get(state, 'd', 0) ? hada_resize_backward(state->slot, resize, &in, &out, own->accumulate, err)
                                    : hada_resize_forward(state->slot, resize, &in, &out, err);
}

/* r and c: the size of x, h and w: that of y. Where both directions' input is normal, errors are relative. */
static hada_status prepare_resize(check_state *state, hada_error *err)
{
    check_net *own;
    double *out = NULL;
    const hada_ref_shape in = check_net_shape(state);
    const hada_ref_shape large = {in.images, in.channels, check_get(state, 'h', 16), check_get(state, 'w', 16)};
    const int backward = check_get(state, 'd', 0);
    own = check_net_own(state, run_resize);
    const int taps = own->mode == HADA_RESIZE_NEAREST ? 1 : own->mode >= HADA_RESIZE_CUBIC ? 4 : 2;
    const int aligned = own->mode == HADA_RESIZE_LINEAR_ALIGNED || own->mode == HADA_RESIZE_CUBIC_ALIGNED;
    const hada_ref_shape *made = backward ? &in : &large;
    HADA_TRY(check_net_input(state, own, backward ? &large : &in, taps == 1 ? 9 : 0, err));
    HADA_TRY(check_net_output(state, own, made, 0, taps == 1 ? 9 : 0, &out, err));
    if (!state->timing) {
        if (!backward)
            hada_ref_resize(&in, large.rows, large.cols, taps, aligned, own->plain[0], out);
        else if (!own->accumulate)
            memset(out, 0, hada_ref_values(&in) * sizeof *out);
        if (backward)
            hada_ref_resize_backward(&in, large.rows, large.cols, taps, aligned, own->plain[0], out);
        check_net_expect(state, own, made, 0, out);
    }
    /* weights and sums of at most 16 (forward) or some hundred terms, each rounded to 6e-8 */
    state->tolerance = taps == 1 ? 0.0 : 1e-6;
    state->bytes = (double)(hada_ref_values(&in) + hada_ref_values(&large)) * sizeof(float);
    return HADA_OK;
}

const check_op check_net_resize = {
    "net_resize",
    "n images, k channels, r and c size of x, h and w of y, v block, p1 gaps between images, b 0 nearest, 1 linear, 2 "
    "linear aligned, 3 cubic, 4 cubic aligned, d1 backward, a1 added to",
    prepare_resize, check_net_launch, NULL};

static hada_status run_place(check_state *state, check_net *own, int first, int count, hada_error *err)
{
    const hada_tensor in = hada_tensor_images(&own->x[0], first, count);
    const hada_tensor out = hada_tensor_images(&own->y, first, count);
    return check_get(state, 'd', 0)
               ? hada_place_backward(state->slot, &in, &out, own->row, own->col, own->channel, own->accumulate, err)
               : hada_place(state->slot, &in, &out, own->row, own->col, own->channel, own->accumulate, err);
}

static hada_status prepare_place(check_state *state, hada_error *err)
{
    check_net *own;
    double *out = NULL;
    const hada_ref_shape part = check_net_shape(state);
    const hada_ref_shape whole = {part.images, check_get(state, 'l', part.channels), check_get(state, 'h', 16),
                                  check_get(state, 'w', 16)};
    const int backward = check_get(state, 'd', 0);
    const hada_ref_shape *made = backward ? &part : &whole;
    own = check_net_own(state, run_place);
    own->row = check_get(state, 'y', 0);
    own->col = check_get(state, 'x', 0);
    own->channel = check_get(state, 'f', 0);
    HADA_TRY(check_net_input(state, own, backward ? &whole : &part, 9, err));
    HADA_TRY(check_net_output(state, own, made, 0, 9, &out, err));
    const size_t count = hada_ref_values(made);
    double *placed = check_room(state, count * sizeof *placed);
    if (backward) {
        hada_ref_place_backward(&part, &whole, own->row, own->col, own->channel, own->plain[0], placed);
    } else {
        if (!own->accumulate)
            memcpy(placed, out, count * sizeof *out);
        hada_ref_place(&part, &whole, own->row, own->col, own->channel, own->plain[0], placed);
    }
    for (size_t i = 0; own->accumulate && i < count; i++)
        placed[i] += out[i];
    check_net_expect(state, own, made, 0, placed);
    state->bytes = 2.0 * (double)hada_ref_values(&part) * sizeof(float);
    return HADA_OK;
}

const check_op check_net_place = {
    "net_place",
    "n images, k channels, r and c size of the part, l channels, h and w size of the whole, y row, x column, f first "
    "channel, v block, p1 gaps between images, d1 backward, a1 added to",
    prepare_place, check_net_launch, NULL};
