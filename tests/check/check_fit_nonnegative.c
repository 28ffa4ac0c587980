/* Transfer functions of non-negative point spread functions: the library's loop on the device, sums to result. */
#include "check.h"
#include "filter/bank.h"
#include "fit/nonnegative.h"
#include "ref/ref_fft.h"
#include "ref/ref_fit.h"

enum { MAX_CHANNELS = 4 };

typedef struct nonnegative_state {
    hada_nonnegative *plan;
    hada_nonnegative_rule rule;
    hada_spectrum_layout layout;
    size_t stride;
    int channels;
    hada_buffer sums[MAX_CHANNELS];
    double mean[MAX_CHANNELS], trust[MAX_CHANNELS];
} nonnegative_state;

/* Sums as of pairs of a camera whose point spread function is partly negative: random spectra of real images, so that
 * all of them belong to real images. z: frequencies of which the pairs say nothing. Arrays `values` in rows. */
static hada_status make_sums(check_state *state, nonnegative_state *own, int c, double *values, hada_error *err)
{
    const int rows = own->layout.rows, cols = own->layout.cols;
    const size_t count = (size_t)rows * (size_t)(cols / 2 + 1), pixels = (size_t)rows * (size_t)cols;
    float *noise = check_room(state, 2 * pixels * sizeof *noise);
    double *image = check_room(state, pixels * sizeof *image), *scene = check_room(state, 2 * count * sizeof *scene);
    double *psf = check_room(state, 2 * count * sizeof *psf), total = 0.0;
    check_fill_normal(state, 10 + (uint64_t)c, noise, 2 * pixels);
    for (size_t i = 0; i < pixels; i++)
        image[i] = noise[i];
    HADA_TRY(hada_ref_fft_forward(image, rows, cols, scene, err));
    for (size_t i = 0; i < pixels; i++) {
        image[i] = 0.5 + noise[pixels + i];
        total += (double)noise[i] * noise[i];
    }
    HADA_TRY(hada_ref_fft_forward(image, rows, cols, psf, err));
    for (size_t i = 0; i < count; i++) {
        const double *x = scene + 2 * i, *h = psf + 2 * i;
        const int known = !check_get(state, 'z', 0) || i % (size_t)(cols / 2 + 1) < 3;
        const double power = known ? x[0] * x[0] + x[1] * x[1] : 0.0;
        const double sums[] = {h[0] * power, -h[1] * power, 1.0, power};
        for (size_t k = 0; k < 4; k++)
            values[k * count + i] = (float)sums[k]; /* what the device sees */
    }
    own->mean[c] = total;
    own->trust[c] = 1.0 / (1 + 3 * c);
    return HADA_OK;
}

static hada_status prepare_channel(check_state *state, nonnegative_state *own, int c, hada_error *err)
{
    const hada_spectrum_layout *layout = &own->layout;
    const size_t count = (size_t)layout->rows * (size_t)(layout->cols / 2 + 1);
    double *values = check_room(state, 4 * count * sizeof *values), *otf = check_room(state, 2 * count * sizeof *otf),
           weights[64];
    float *packed = check_room(state, 8 * own->stride * sizeof *packed),
          *rows = check_room(state, 2 * count * sizeof *rows);
    float *blocks = check_room(state, 2 * layout->count * sizeof *blocks);
    HADA_TRY(make_sums(state, own, c, values, err));
    for (size_t k = 0; k < 4; k++) {
        for (size_t i = 0; i < count; i++)
            rows[i] = (float)values[k * count + i];
        hada_layout_pack_real(layout, rows, packed + 2 * k * own->stride);
    }
    for (int i = 0; i < own->rule.steps; i++)
        weights[i] = own->rule.steps > 1
                         ? own->rule.first * pow(own->rule.last / own->rule.first, i / (own->rule.steps - 1.0))
                         : own->rule.first;
    HADA_TRY(hada_ref_fit_nonnegative(values, layout->rows, layout->cols, own->mean[c], own->rule.steps, weights,
                                      own->rule.relaxation, own->trust[c], otf, err));
    for (size_t i = 0; i < 2 * count; i++)
        rows[i] = (float)otf[i];
    hada_layout_pack(layout, rows, blocks);
    for (size_t i = 0; i < 2 * layout->count; i++)
        state->expected[2 * (size_t)c * layout->count + i] = blocks[i];
    HADA_TRY(check_upload(state, &own->sums[c], packed, 8 * own->stride * sizeof *packed, err));
    return HADA_OK;
}

/* Padding of the layout holds anything. */
static void mark_padding(check_state *state, const nonnegative_state *own)
{
    const size_t count = own->layout.count;
    float *weights = check_room(state, count * sizeof *weights);
    state->unspecified = check_room(state, state->out_count);
    hada_layout_weights(&own->layout, weights);
    for (size_t i = 0; i < state->out_count; i++)
        state->unspecified[i] = weights[i / 2 % count] == 0.0f;
}

static hada_status prepare(check_state *state, hada_error *err)
{
    nonnegative_state *own = check_own(state, sizeof *own);
    const int rows = check_get(state, 'r', 8), cols = check_get(state, 'c', 8);
    own->channels = check_get(state, 'k', 1);
    if (own->channels > MAX_CHANNELS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "at most %d channels", MAX_CHANNELS);
    hada_nonnegative_rule_init(&own->rule);
    own->rule.steps = check_get(state, 'n', 6);
    own->layout = hada_fft_layout(state->slot->context, rows, cols, HADA_FFT_AUTO);
    own->stride = ((own->layout.count + 7) / 8 + 63) / 64 * 64 * 8;
    const uint64_t held = hada_context_bytes(state->slot->context);
    hada_nonnegative *trial;
    hada_dry dry;
    hada_dry_begin(&dry, state->slot->context);
    hada_status status = hada_nonnegative_create(&trial, &dry.slot, rows, cols, own->channels, err);
    const uint64_t stated = hada_context_bytes(&dry.context);
    hada_nonnegative_destroy(&trial);
    hada_dry_end(&dry);
    if (!status)
        status = hada_nonnegative_create(&own->plan, state->slot, rows, cols, own->channels, err);
    if (!status && hada_context_bytes(state->slot->context) - held != stated)
        status = hada_fail(err, HADA_ERROR_STATE, "holds %llu bytes, states %llu",
                           (unsigned long long)(hada_context_bytes(state->slot->context) - held),
                           (unsigned long long)stated);
    if (!status)
        status = check_output(state, 2 * (size_t)own->channels * own->layout.count, err);
    for (int c = 0; !status && c < own->channels; c++)
        status = prepare_channel(state, own, c, err);
    if (!status)
        mark_padding(state, own);
    /* steps contract, so what counts is the rounding of a few transforms, each below 1e-6 of its result; clipping does
     * not grow it, and the last step's weight lets a dual's error in by 1.8 times 1.25 */
    state->tolerance = 1e-5;
    state->bytes = (double)own->channels * own->rule.steps * ((double)own->layout.count * 44.0 + 40.0 * rows * cols);
    return status;
}

static hada_status launch(check_state *state, hada_error *err)
{
    nonnegative_state *own = state->own;
    for (int c = 0, n; c < own->channels; c += n) {
        n = state->batch_limit && state->batch_limit < own->channels - c ? state->batch_limit : own->channels - c;
        HADA_TRY(hada_nonnegative_solve(own->plan, &own->rule, n, own->sums + c, own->stride, own->mean + c,
                                        own->trust + c, state->out.mem,
                                        state->out_offset / 2 + (size_t)c * own->layout.count, err));
    }
    return HADA_OK;
}

static void release(check_state *state)
{
    nonnegative_state *own = state->own;
    hada_nonnegative_destroy(&own->plan);
}

const check_op check_fit_nonnegative = {"fit_nonnegative",
                                        "r rows, c columns, k channels, n steps, z1 only a few frequencies known",
                                        prepare, launch, release};
