/* The steps of the learned ridge regulariser (refine_ridge). */
#include "check.h"
#include "ref/ref_ridge.h"
#include "refine/proximal.h"

typedef struct ridge_state {
    hada_ridge ridge;
    hada_buffer in, image, scratch;
    double noise;
    int planes;
    size_t bytes;
} ridge_state;

static hada_status prepare(check_state *state, hada_error *err)
{
    ridge_state *own = check_own(state, sizeof *own);
    const int rows = check_get(state, 'r', 24), cols = check_get(state, 'c', 24), channels = check_get(state, 'k', 1);
    own->planes = check_get(state, 'n', 1);
    const size_t each = (size_t)channels * (size_t)rows * (size_t)cols, values = (size_t)own->planes * each;
    double *exact;
    float *image = check_normal(state, values, &exact);
    own->noise = 0.01 * check_get(state, 'y', 20);
    own->bytes = values * sizeof(float);
    HADA_TRY(check_output(state, values, err));
    HADA_TRY(check_upload(state, &own->in, image, own->bytes, err));
    HADA_TRY(check_scratch(state, &own->image, own->bytes, err));
    HADA_TRY(
        check_scratch(state, &own->scratch, hada_ridge_floats(channels, rows, cols, own->planes) * sizeof(float), err));
    HADA_TRY(hada_ridge_prepare(&own->ridge, state->slot, channels, rows, cols, err));
    for (int n = 0; n < own->planes && !state->timing; n++)
        HADA_TRY(hada_ref_ridge(exact + (size_t)n * each, channels, rows, cols, own->noise,
                                state->expected + (size_t)n * each, err));
    /* a response is a sum of 75 products, a gradient one of 600, each step changes a pixel by less than itself, and the
     * division of the shape is right to 3 units in the last place at worst */
    state->tolerance = 4e-6;
    state->bytes = 2.0 * (double)own->bytes;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    ridge_state *own = state->own;
    HADA_TRY(hada_buffer_copy(state->slot, own->in.mem, 0, own->image.mem, 0, own->bytes, err));
    HADA_TRY(
        hada_ridge_apply(&own->ridge, state->slot, own->image.mem, own->scratch.mem, own->planes, own->noise, err));
    return hada_buffer_copy(state->slot, own->image.mem, 0, state->out.mem, state->out_offset * sizeof(float),
                            own->bytes, err);
}

const check_op check_ridge = {"refine_ridge", "r rows, c columns, k channels, n planes, y noise in hundredths", prepare,
                              launch, NULL};
