/* A batch norm with given statistics and a convolution behind it, in one launch. */
#include "check_net.h"
#include "ref/ref_conv.h"

#define EPS 1e-3

enum { X, NORM, KERNELS };                     /* inputs; the convolution's biases follow its kernels */
enum { WEIGHT, BIAS, MEAN, VARIANCE, VALUES }; /* of a norm, `channels` each */

/* Each run makes its convolution anew. */
static hada_status run(check_state *state, check_net *own, int first, int count, hada_error *err)
{
    const hada_tensor x = hada_tensor_images(&own->x[X], first, count), y = hada_tensor_images(&own->y, first, count);
    const hada_conv_desc desc = {.images = count,
                                 .in_channels = x.channels,
                                 .out_channels = y.channels,
                                 .in_rows = x.rows,
                                 .in_cols = x.cols,
                                 .kernel_rows = 3,
                                 .kernel_cols = 3,
                                 .stride = 1,
                                 .pad_rows = 1,
                                 .pad_cols = 1,
                                 .activation = (hada_activation)own->mode};
    const size_t channels = (size_t)x.channels;
    const cl_mem values = own->memory[NORM].mem;
    const hada_batch_norm norm = {.weight = {values, WEIGHT * channels},
                                  .bias = {values, BIAS * channels},
                                  .mean = {values, MEAN * channels},
                                  .variance = {values, VARIANCE * channels},
                                  .eps = (float)EPS};
    const hada_floats kernels = {own->memory[KERNELS].mem, 0};
    const hada_floats biases = {kernels.mem, 9 * (size_t)x.channels * (size_t)y.channels};
    hada_conv *conv = NULL;
    hada_status status = HADA_OK;
    if (!hada_conv_norms(state->slot->context, &desc))
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "convolutions here do not take what is to be normalised");
    HADA_TRY_OR_DONE(hada_conv_create(&conv, state->slot, &desc, err));
    HADA_TRY_OR_DONE(hada_conv_set_weights(conv, kernels, err));
    HADA_TRY_OR_DONE(hada_conv_forward_normed(conv, &norm, &x, biases, &y, err));
    HADA_TRY_OR_DONE(hada_slot_finish(state->slot, err));
done:
    hada_conv_destroy(&conv);
    return status;
}

static hada_status inputs(check_state *state, check_net *own, const hada_ref_shape *x, const hada_ref_shape *y,
                          hada_error *err)
{
    const size_t channels = (size_t)x->channels, outs = (size_t)y->channels;
    hada_status status = check_net_input(state, own, x, 0, err);
    if (!status)
        status = check_net_floats(state, own, VALUES * channels, 0, err);
    if (!status)
        status = check_net_floats(state, own, (9 * channels + 1) * outs, 0, err);
    float *variance = check_room(state, channels * sizeof *variance);
    double *plain = status ? NULL : own->plain[NORM] + VARIANCE * channels;
    for (size_t c = 0; !status && c < channels; c++)
        plain[c] = variance[c] = (float)fabs(plain[c]);
    return status ? status
                  : hada_buffer_write(&own->memory[NORM], state->slot, VARIANCE * channels * sizeof *variance, variance,
                                      channels * sizeof *variance, err);
}

static void expect(check_state *state, const check_net *own, const hada_ref_shape *x, const hada_ref_shape *y,
                   double *out)
{
    const size_t values = hada_ref_values(x), weights = 9 * (size_t)(x->channels * y->channels);
    const size_t each = values / (size_t)x->images, pixels = (size_t)x->rows * (size_t)x->cols;
    double *normed = check_room(state, values * sizeof *normed);
    float *single = check_room(state, values * sizeof *single), *w = check_room(state, weights * sizeof *w);
    const hada_ref_conv shape = {y->channels, x->rows, x->cols, x->channels, x->rows, x->cols, 3, 3, 1, 1, 1};
    const double *norm = own->plain[NORM];
    const size_t channels = (size_t)x->channels;
    hada_ref_batch_norm(x, norm + WEIGHT * channels, norm + BIAS * channels, norm + MEAN * channels,
                        norm + VARIANCE * channels, EPS, own->plain[X], normed);
    for (size_t i = 0; i < values; i++)
        single[i] = (float)normed[i];
    for (size_t i = 0; i < weights; i++)
        w[i] = (float)own->plain[KERNELS][i];
    for (int n = 0; n < x->images; n++)
        hada_ref_conv_to_coarse(&shape, w, single + (size_t)n * each, out + (size_t)n * pixels * (size_t)y->channels);
    for (size_t i = 0; i < hada_ref_values(y); i++) {
        const size_t channel = i / pixels % (size_t)y->channels;
        out[i] = hada_ref_activation((hada_activation)own->mode, 0.0f, out[i] + own->plain[KERNELS][weights + channel]);
    }
}

static hada_status prepare(check_state *state, hada_error *err)
{
    double *out = NULL;
    const hada_ref_shape x = check_net_shape(state);
    const hada_ref_shape y = {x.images, check_get(state, 'o', 1), x.rows, x.cols};
    check_net *own = check_net_own(state, run);
    HADA_TRY(inputs(state, own, &x, &y, err));
    HADA_TRY(check_net_output(state, own, &y, 0, 0, &out, err));
    if (!state->timing)
        expect(state, own, &x, &y, out);
    if (!state->timing)
        check_net_expect(state, own, &y, 0, out);
    state->tolerance = 1e-6; /* as convolutions */
    state->bytes = (double)(hada_ref_values(&x) + hada_ref_values(&y)) * sizeof(float);
    return HADA_OK;
}

const check_op check_net_normed = {
    "net_normed",
    "n images, k channels, r rows, c columns, o channels after, b activation, v block, p1 gaps between images", prepare,
    check_net_launch, NULL};
