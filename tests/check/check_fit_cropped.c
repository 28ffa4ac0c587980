/* What stands beside the non-negative steps where the sensor crops: what a model leaves of frames, and the sums of
 * whole frames. In the output, each at the next multiple of 256: what is left (c channels of p pixels), the sums of its
 * squares over chunks, and c images of n complex numbers. All channels have the same sums. */
#include "check_fit.h"
#include "launch/fit_cropped.h"

enum { CHUNK = 8 * HADA_FIT_CHUNK, PARTS = 3 };
static const float length = 3.0f, before = 0.5f; /* of the step; what stood in the sums of chunks */

typedef struct cropped_state {
    hada_buffer e, b, weights, h, g, sums;
    check_fit fit;
    int channels;
    size_t pixels, chunks, at[PARTS + 1];
} cropped_state;

static void expect(check_state *state, const cropped_state *own, const float *e, const float *b, const float *w,
                   const float *h, const float *g)
{
    const size_t n = own->fit.count, channels = (size_t)own->channels;
    double *left = state->expected, *sums = left + own->at[1], *filled = left + own->at[2];
    for (size_t i = 0; i < channels * own->chunks; i++)
        sums[i] = before;
    for (size_t i = 0; i < channels * own->pixels; i++) {
        const size_t c = i / own->pixels, p = i % own->pixels;
        left[i] = w && w[i] == 0.0f ? 0.0 : (double)e[i] - b[i];
        left[i] = w && w[i] < 0.0f ? fmin(left[i], 0.0) : left[i];
        sums[c * own->chunks + p / CHUNK] += left[i] * left[i];
    }
    for (size_t i = 0; i < 2 * channels * n; i++)
        filled[i] = own->fit.sums[3 * n + i / 2 % n] * h[i] - length * g[i];
}

static hada_status prepare(check_state *state, hada_error *err)
{
    cropped_state *own = check_own(state, sizeof *own);
    const size_t n = (size_t)check_get(state, 'n', 16);
    own->channels = check_get(state, 'c', 1);
    own->pixels = (size_t)check_get(state, 'p', 16);
    own->chunks = (own->pixels + CHUNK - 1) / CHUNK;
    check_fit_make(&own->fit, state, n, 3, 0);
    const size_t channels = (size_t)own->channels, frame = channels * own->pixels, spectra = 2 * channels * n + 16;
    const size_t counts[PARTS] = {frame, channels * own->chunks, spectra};
    for (size_t i = 0; i < PARTS; i++)
        own->at[i + 1] = (own->at[i] + counts[i] + 255) / 256 * 256;
    float *e = check_room(state, frame * sizeof *e), *b = check_room(state, frame * sizeof *b);
    float *h = check_room(state, spectra * sizeof *h), *g = check_room(state, spectra * sizeof *g);
    HADA_TRY(check_output(state, own->at[PARTS], err));
    check_fill_normal(state, 1, e, frame);
    check_fill_normal(state, 2, b, frame);
    check_fill_normal(state, 3, h, 2 * channels * n);
    check_fill_normal(state, 4, g, 2 * channels * n);
    float *weights = NULL;
    if (check_get(state, 'w', 0)) {
        weights = check_room(state, frame * sizeof *weights);
        for (size_t i = 0; i < frame; i++)
            weights[i] = (float)(i % 5 % 3) - 1.0f; /* below 0, 0 and 1 */
        HADA_TRY(check_upload(state, &own->weights, weights, frame * sizeof *weights, err));
    }
    expect(state, own, e, b, weights, h, g);
    HADA_TRY(check_upload(state, &own->e, e, frame * sizeof *e, err));
    HADA_TRY(check_upload(state, &own->b, b, frame * sizeof *b, err));
    HADA_TRY(check_upload(state, &own->h, h, spectra * sizeof *h, err));
    HADA_TRY(check_upload(state, &own->g, g, 2 * channels * n * sizeof *g, err));
    HADA_TRY(check_upload(state, &own->sums, own->fit.device_sums, 8 * (size_t)own->fit.kept * own->fit.stride, err));
    state->tolerance = 2e-6; /* sums of up to 32 groups of eight, one after the other */
    state->bytes = (double)frame * 12.0 + (double)(channels * n) * 28.0;
    return HADA_OK;
}

static hada_status copy(check_state *state, const hada_buffer *from, int region, size_t floats, hada_error *err)
{
    return hada_buffer_copy(state->slot, from->mem, 0, state->region[region], 0, floats * sizeof(float), err);
}

static hada_status set_up(check_state *state, hada_error *err)
{
    const cropped_state *own = state->own;
    const size_t channels = (size_t)own->channels;
    for (size_t i = 0; !state->region[PARTS - 1] && i < PARTS; i++) {
        cl_mem region;
        HADA_TRY(check_region(state, own->at[i], own->at[i + 1] - own->at[i], &region, err));
    }
    HADA_TRY(check_clear(state, 0, state->out_count, err));
    HADA_TRY(copy(state, &own->e, 0, channels * own->pixels, err));
    HADA_TRY(hada_buffer_fill(state->slot, state->region[1], 0, before, channels * own->chunks, err));
    return copy(state, &own->g, 2, 2 * channels * own->fit.count, err);
}

static hada_status launch(check_state *state, hada_error *err)
{
    const cropped_state *own = state->own;
    const hada_range chunks = hada_range_of(own->chunks, check_local(state, 32), (size_t)own->channels, 1);
    const hada_range vectors = hada_range_of(own->fit.vectors, 64, 1, 1);
    HADA_TRY(set_up(state, err));
    HADA_TRY(hada_launch_fit_remain(state->slot, HADA_PROGRAM_FIT_CROPPED_DEFAULT, &chunks, err, .e = state->region[0],
                                    .b = own->b.mem, .weights = own->weights.mem, .weighted = own->weights.mem != NULL,
                                    .out = state->region[1], .pixels = own->pixels, .chunks = own->chunks));
    for (int c = 0; c < own->channels; c++) {
        const hada_fit_image image = check_fit_image(&own->fit, (size_t)c);
        HADA_TRY(hada_launch_fit_fill(state->slot, HADA_PROGRAM_FIT_CROPPED_DEFAULT, &vectors, err,
                                      .sums = own->sums.mem, .h = own->h.mem, .g = state->region[2], .image = image,
                                      .step = length));
    }
    return HADA_OK;
}

const check_op check_fit_cropped = {
    "fit_cropped", "p pixels and n frequencies of each of c channels; w: pixels have weights", prepare, launch, NULL};
