/* Opaque planes: weights that are multiples of 1/64 with opacities 0 and 1, exact. */
#include "check.h"
#include "optics/occlusion.h"
#include "ref/ref_forward.h"

typedef struct hide_state {
    hada_buffer light, opacity, weights;
    hada_taps taps;
    int channels, rows, cols;
} hide_state;

static hada_status prepare(check_state *state, hada_error *err)
{
    hide_state *own = check_own(state, sizeof *own);
    own->channels = check_get(state, 'k', 1);
    own->rows = check_get(state, 'r', 4);
    own->cols = check_get(state, 'c', 4);
    own->taps.rows = check_get(state, 'h', 2);
    own->taps.cols = check_get(state, 'w', 2);
    own->taps.row0 = check_get(state, 'y', 0) - check_get(state, 'm', 0);
    own->taps.col0 = check_get(state, 'x', 0) - check_get(state, 'n', 0);
    const size_t pixels = (size_t)own->rows * (size_t)own->cols, count = pixels * (size_t)own->channels,
                 taps = (size_t)own->taps.rows * (size_t)own->taps.cols;
    float *light = check_room(state, count * sizeof *light), *opacity = check_room(state, pixels * sizeof *opacity),
          *weight = check_room(state, taps * sizeof *weight);
    double *in = check_room(state, count * sizeof *in);
    HADA_TRY(check_output(state, count, err));
    check_fill_integers(state, 1, light, count, 9);
    check_fill_integers(state, 2, opacity, pixels, 1);
    check_fill_integers(state, 3, weight, taps, 9);
    for (size_t i = 0; i < taps; i++)
        weight[i] /= 64.0f;
    for (size_t i = 0; i < count; i++)
        in[i] = light[i];
    hada_ref_hide(in, opacity, own->channels, own->rows, own->cols, weight, own->taps.row0, own->taps.col0,
                  own->taps.rows, own->taps.cols, state->expected);
    HADA_TRY(check_upload(state, &own->light, light, count * sizeof *light, err));
    HADA_TRY(check_upload(state, &own->opacity, opacity, pixels * sizeof *opacity, err));
    HADA_TRY(check_upload(state, &own->weights, weight, taps * sizeof *weight, err));
    state->bytes = (double)pixels * (8.0 * own->channels + 4.0);
    state->flops = (double)pixels * (2.0 * (double)taps + own->channels);
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    hide_state *own = state->own;
    return hada_optics_hide(state->slot, own->light.mem, state->out.mem, state->out_offset, own->opacity.mem, 0,
                            own->weights.mem, &own->taps, own->channels, own->rows, own->cols, err);
}

const check_op check_hide = {"optics_hide", "k channels of r x c pixels, h x w weights from row y - m, column x - n on",
                             prepare, launch, NULL};
