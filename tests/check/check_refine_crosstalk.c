/* Planes that fade beside brighter ones (refine_crosstalk). */
#include "check.h"
#include "ref/ref_crosstalk.h"
#include "refine/proximal.h"

typedef struct crosstalk_state {
    hada_crosstalk crosstalk;
    hada_buffer in, planes, scratch;
    int depths;
    double share;
    size_t bytes;
} crosstalk_state;

static hada_status prepare(check_state *state, hada_error *err)
{
    crosstalk_state *own = check_own(state, sizeof *own);
    const int rows = check_get(state, 'r', 24), cols = check_get(state, 'c', 24), channels = check_get(state, 'k', 1);
    own->depths = check_get(state, 'd', 2);
    own->share = 0.01 * check_get(state, 'y', (int)(100 * HADA_CROSSTALK));
    const size_t area = (size_t)rows * (size_t)cols, plane = (size_t)channels * area;
    const size_t values = (size_t)own->depths * plane;
    float *planes = check_room(state, values * sizeof *planes);
    double *exact = check_room(state, values * sizeof *exact);
    own->bytes = values * sizeof(float);
    check_fill_normal(state, 0, planes, values);
    /* light of very different strength, and pixels that are dark in all planes */
    for (size_t i = 0; i < values; i++) {
        planes[i] = i % plane % area % 97 < 11 ? 0.0f : fabsf(planes[i]) * powf(0.1f, (float)(i / plane));
        exact[i] = planes[i];
    }
    HADA_TRY(check_output(state, values, err));
    HADA_TRY(check_upload(state, &own->in, planes, own->bytes, err));
    HADA_TRY(check_scratch(state, &own->planes, own->bytes, err));
    HADA_TRY(check_scratch(state, &own->scratch, (size_t)own->depths * area * sizeof(float), err));
    HADA_TRY(hada_crosstalk_prepare(&own->crosstalk, state->slot, channels, rows, cols, err));
    if (!state->timing) {
        hada_ref_crosstalk(exact, own->depths, channels, rows, cols, own->share);
        for (size_t i = 0; i < values; i++)
            state->expected[i] = exact[i];
    }
    /* sums of up to 25 channels values, none negative, with half a rounding each; a weight has the fourth power of the
     * quotient of two */
    state->tolerance = (8.0 * 25.0 * channels + 8.0) * 6e-8;
    state->bytes = (3.0 + 2.0 / channels) * (double)own->bytes;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    crosstalk_state *own = state->own;
    HADA_TRY(hada_buffer_copy(state->slot, own->in.mem, 0, own->planes.mem, 0, own->bytes, err));
    HADA_TRY(hada_crosstalk_fade(&own->crosstalk, state->slot, own->planes.mem, own->scratch.mem, own->depths,
                                 own->share, err));
    return hada_buffer_copy(state->slot, own->planes.mem, 0, state->out.mem, state->out_offset * sizeof(float),
                            own->bytes, err);
}

const check_op check_crosstalk = {"refine_crosstalk", "r rows, c columns, k channels, d depths, y share in hundredths",
                                  prepare, launch, NULL};
