/* Activations, sums of tensors, dropout: value by value. */
#include "check_net.h"

#define SLOPE 0.25f /* exact on integers */

static hada_status run_activation(check_state *state, check_net *own, int first, int count, hada_error *err)
{
    const hada_tensor x = hada_tensor_images(&own->x[0], first, count), y = hada_tensor_images(&own->y, first, count);
    const hada_activation activation = (hada_activation)own->mode;
    if (own->inputs == 1)
        return hada_activation_forward(state->slot, activation, SLOPE, &x, &y, err);
    const hada_tensor dy = hada_tensor_images(&own->x[1], first, count);
    return hada_activation_backward(state->slot, activation, SLOPE, &x, &dy, &y, err);
}

static hada_status prepare_activation(check_state *state, hada_error *err)
{
    check_net *own;
    double *out = NULL;
    const hada_ref_shape shape = check_net_shape(state);
    const size_t count = hada_ref_values(&shape);
    const int sigmoid = check_get(state, 'b', 0) == HADA_ACTIVATION_SIGMOID, backward = check_get(state, 'd', 0);
    own = check_net_own(state, run_activation);
    HADA_TRY(check_net_input(state, own, &shape, sigmoid ? 0 : 9, err));
    if (backward)
        HADA_TRY(check_net_input(state, own, &shape, sigmoid ? 0 : 9, err));
    HADA_TRY(check_net_output(state, own, &shape, 0, 9, &out, err));
    const double slope = own->mode == HADA_ACTIVATION_NONE ? 1.0 : own->mode == HADA_ACTIVATION_RELU ? 0.0 : SLOPE;
    for (size_t i = 0; i < count; i++)
        out[i] = 0.0;
    if (backward && sigmoid)
        hada_ref_sigmoid_backward(count, own->plain[0], own->plain[1], out);
    else if (backward)
        hada_ref_leaky_backward(count, slope, own->plain[0], own->plain[1], out);
    else if (sigmoid)
        hada_ref_sigmoid(count, own->plain[0], out);
    else
        hada_ref_leaky(count, slope, own->plain[0], out);
    check_net_expect(state, own, &shape, 0, out);
    state->tolerance = sigmoid ? 3e-7 : 0.0; /* a few roundings, and exp to 4 units in the last place */
    state->bytes = (backward ? 3.0 : 2.0) * (double)count * sizeof(float);
    return HADA_OK;
}

const check_op check_net_activation = {"net_activation",
                                       "n images, k channels, r rows, c columns, v block, p1 gaps between images, b 0 "
                                       "none, 1 ReLU, 2 leaky, 3 sigmoid, d1 "
                                       "backward",
                                       prepare_activation, check_net_launch, NULL};

static hada_status run_blend(check_state *state, check_net *own, int first, int count, hada_error *err)
{
    const hada_tensor x = hada_tensor_images(&own->x[0], first, count), y = hada_tensor_images(&own->y, first, count);
    return hada_blend(state->slot, 3.0f, &x, own->accumulate ? -2.0f : 0.0f, &y, err);
}

static hada_status prepare_blend(check_state *state, hada_error *err)
{
    check_net *own;
    double *out = NULL;
    const hada_ref_shape shape = check_net_shape(state);
    const size_t count = hada_ref_values(&shape);
    own = check_net_own(state, run_blend);
    HADA_TRY(check_net_input(state, own, &shape, 9, err));
    HADA_TRY(check_net_output(state, own, &shape, 0, 9, &out, err));
    for (size_t i = 0; i < count; i++)
        out[i] = 3.0 * own->plain[0][i] - (own->accumulate ? 2.0 * out[i] : 0.0);
    check_net_expect(state, own, &shape, 0, out);
    state->bytes = (own->accumulate ? 3.0 : 2.0) * (double)count * sizeof(float);
    return HADA_OK;
}

const check_op check_net_blend = {"net_blend",
                                  "n images, k channels, r rows, c columns, v block, p1 gaps between images, a1 y is "
                                  "read",
                                  prepare_blend, check_net_launch, NULL};

#define DROPOUT_SEED 0x123456789abcdefu
#define DROPOUT_STEP 0x5000000004u

/* The numbers count images from the beginning of a call, so the images come in one. */
static hada_status run_dropout(check_state *state, check_net *own, int first, int count, hada_error *err)
{
    (void)count;
    return first ? HADA_OK
                 : hada_dropout(state->slot, own->number, DROPOUT_SEED, DROPOUT_STEP, &own->x[0], &own->y, err);
}

static hada_status prepare_dropout(check_state *state, hada_error *err)
{
    check_net *own;
    double *out = NULL;
    const hada_ref_shape shape = check_net_shape(state);
    own = check_net_own(state, run_dropout);
    HADA_TRY(check_net_input(state, own, &shape, 9, err));
    HADA_TRY(check_net_output(state, own, &shape, 0, 9, &out, err));
    own->number = own->mode ? 0.3f : 0.5f;
    hada_ref_dropout(&shape, own->number, DROPOUT_SEED, DROPOUT_STEP, own->plain[0], out);
    check_net_expect(state, own, &shape, 0, out);
    state->bytes = 2.0 * (double)hada_ref_values(&shape) * sizeof(float);
    state->tolerance = check_get(state, 'b', 0) ? 1e-7 : 0.0;
    return HADA_OK;
}

const check_op check_net_dropout = {"net_dropout",
                                    "n images, k channels, r rows, c columns, v block, b 0: a half, 1: 0.3",
                                    prepare_dropout, check_net_launch, NULL};
