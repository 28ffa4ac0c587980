/* The distance of features in LPIPS. */
#include "check_net.h"
#include "metrics/metrics.h"
#include "ref/ref_lpips.h"

enum { FEATURES, WEIGHTS }; /* inputs */

static hada_status launch(check_state *state, hada_error *err)
{
    check_net *own = state->own;
    const hada_tensor *all = &own->x[FEATURES];
    const hada_floats weights = {own->memory[WEIGHTS].mem, 0};
    const int pairs = all->images / 2;
    const size_t pixels = (size_t)all->rows * (size_t)all->cols;
    if (!state->batch_limit)
        return hada_lpips_distance(state->slot, all, weights, (hada_floats){state->out.mem, state->out_offset}, err);
    for (int p = 0; p < pairs; p++) {
        hada_tensor pair = hada_tensor_images(all, p, 2);
        pair.image_stride *= (size_t)pairs;
        const hada_floats out = {state->out.mem, state->out_offset + (size_t)p * pixels};
        HADA_TRY(hada_lpips_distance(state->slot, &pair, weights, out, err));
    }
    return HADA_OK;
}

static hada_status prepare(check_state *state, hada_error *err)
{
    check_net *own;
    hada_ref_shape shape = check_net_shape(state), one = shape;
    const int pairs = shape.images;
    shape.images *= 2;
    one.images = 1;
    own = check_net_own(state, NULL);
    HADA_TRY(check_net_input(state, own, &shape, own->mode ? 1 : 0, err));
    HADA_TRY(check_net_floats(state, own, (size_t)shape.channels, 0, err));
    const size_t pixels = (size_t)shape.rows * (size_t)shape.cols, values = hada_ref_values(&one);
    HADA_TRY(check_output(state, (size_t)pairs * pixels, err));
    for (int p = 0; p < pairs; p++)
        hada_ref_lpips(&one, own->plain[FEATURES] + (size_t)p * values,
                       own->plain[FEATURES] + (size_t)(pairs + p) * values, own->plain[WEIGHTS],
                       state->expected + (size_t)p * pixels);
    /* Lengths and products of a dozen roundings of 6e-8 each; a sum over a block's channels adds about the same. */
    state->tolerance = 1e-6;
    state->bytes = (double)(2 * (size_t)pairs * values + (size_t)pairs * pixels) * sizeof(float);
    return HADA_OK;
}

const check_op check_lpips = {"lpips",
                              "n pairs, k channels, r rows, c columns, v block, p1 gaps between images, b1 features of "
                              "-1, 0 and 1, also pixels without any",
                              prepare, launch, NULL};
