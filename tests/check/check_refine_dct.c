/* Shrinkage of cosine transforms of overlapping blocks (refine_dct). */
#include "check.h"
#include "ref/ref_dct.h"
#include "refine/proximal.h"

typedef struct dct_state {
    hada_shrinkage shrinkage;
    hada_buffer in, image, scratch;
    double threshold;
    size_t bytes;
} dct_state;

static hada_status prepare(check_state *state, hada_error *err)
{
    dct_state *own = check_own(state, sizeof *own);
    const int rows = check_get(state, 'r', 24), cols = check_get(state, 'c', 24), channels = check_get(state, 'k', 1);
    const size_t values = (size_t)channels * (size_t)rows * (size_t)cols;
    double *exact;
    float *image = check_normal(state, values, &exact);
    own->threshold = 0.01 * check_get(state, 'y', 100);
    own->bytes = values * sizeof(float);
    HADA_TRY(check_output(state, values, err));
    HADA_TRY(check_upload(state, &own->in, image, own->bytes, err));
    HADA_TRY(check_scratch(state, &own->image, own->bytes, err));
    HADA_TRY(check_scratch(state, &own->scratch, hada_shrinkage_floats(channels, rows, cols) * sizeof(float), err));
    HADA_TRY(hada_shrinkage_prepare(&own->shrinkage, state->slot, channels, rows, cols, err));
    if (!state->timing)
        HADA_TRY(hada_ref_dct_shrink(exact, channels, rows, cols, own->threshold, HADA_SHRINKAGE_COLOUR,
                                     state->expected, err));
    /* a coefficient takes some 20 roundings, of which the garrote doubles at most; 16 blocks are added */
    state->tolerance = 2e-6;
    state->bytes = 2.0 * (double)own->bytes;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    dct_state *own = state->own;
    HADA_TRY(hada_buffer_copy(state->slot, own->in.mem, 0, own->image.mem, 0, own->bytes, err));
    HADA_TRY(hada_shrinkage_step(&own->shrinkage, state->slot, own->image.mem, own->scratch.mem, own->threshold, err));
    return hada_buffer_copy(state->slot, own->image.mem, 0, state->out.mem, state->out_offset * sizeof(float),
                            own->bytes, err);
}

const check_op check_dct = {"refine_dct", "r rows, c columns, k channels, y threshold in hundredths of the noise",
                            prepare, launch, NULL};
