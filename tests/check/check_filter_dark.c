/* Dark level and dark frame taken off, through the Hadamard stage: exact. */
#include "check.h"
#include "filter/hadamard.h"

enum { MAX_CHANNELS = 16 };

typedef struct dark_state {
    hada_hadamard *stage;
    float *raw;
    double levels[MAX_CHANNELS];
} dark_state;

static hada_status prepare(check_state *state, hada_error *err)
{
    dark_state *own = check_own(state, sizeof *own);
    const int rows = check_get(state, 'r', 8), cols = check_get(state, 'c', 8), channels = check_get(state, 'k', 1);
    const double distance = 100.0;
    hada_model_info info = {.depths = 1,
                            .channels = channels,
                            .form = HADA_FORM_COMPLEX,
                            .boundary = HADA_BOUNDARY_CIRCULAR,
                            .distances_mm = &distance};
    if (channels > MAX_CHANNELS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "at most %d channels", MAX_CHANNELS);
    const size_t area = (size_t)rows * (size_t)cols, count = area * (size_t)channels;
    float *dark = check_room(state, count * sizeof *dark);
    own->raw = check_room(state, count * sizeof *own->raw);
    HADA_TRY(hada_model_set_sizes(&info, rows, cols, rows, cols, err));
    HADA_TRY(hada_hadamard_create(&own->stage, state->slot, &info, 1, err));
    HADA_TRY(check_output(state, count, err));
    const int framed = check_get(state, 'f', 0);
    check_fill_integers(state, 1, own->raw, count, 99);
    check_fill_integers(state, 2, dark, count, 9);
    for (size_t i = 0; i < count; i++) {
        own->levels[i / area] = (double)(i / area) + 3.0;
        state->expected[i] = own->raw[i] - own->levels[i / area] - (framed ? dark[i] : 0.0);
    }
    HADA_TRY(framed ? hada_hadamard_set_dark(own->stage, dark, err) : HADA_OK);
    state->bytes = 2.0 * (double)count * sizeof(float);
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    dark_state *own = state->own;
    const hada_hadamard *stage = own->stage;
    hada_pixels raw;
    hada_pixels_planar(&raw, own->raw, HADA_PIXEL_F32, stage->channels, stage->raw_rows, stage->raw_cols);
    HADA_TRY(hada_hadamard_frame(own->stage, &raw, own->levels, err));
    const cl_int code =
        clEnqueueCopyBuffer(state->slot->queue, own->stage->raw.mem, state->out.mem, 0,
                            state->out_offset * sizeof(float), state->out_count * sizeof(float), 0, NULL, NULL);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clEnqueueCopyBuffer");
}

static void release(check_state *state)
{
    dark_state *own = state->own;
    hada_hadamard_destroy(&own->stage);
}

const check_op check_dark = {
    "filter_dark",
    "r rows, c columns, k channels, f1 with a dark frame; times hold the upload and the transform as well", prepare,
    launch, release};
