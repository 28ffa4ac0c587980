/* Fully connected layers: forward, the gradient of x, those of weights and biases. */
#include "check_net.h"

enum { FORWARD = 0, DATA = 1, WEIGHTS = 2 };
enum { W, BIAS, XS, DYS }; /* inputs */

typedef struct linear_state {
    hada_linear shape;
    check_net net;
} linear_state;

static hada_floats input(const linear_state *own, int i)
{
    return (hada_floats){own->net.memory[i].mem, 0};
}

/* The output starts as the values that it is added to. */
static hada_status launch(check_state *state, hada_error *err)
{
    linear_state *own = state->own;
    const hada_floats out = {state->out.mem, state->out_offset}, none = {NULL, 0};
    const hada_floats bias = check_get(state, 'o', 1) ? input(own, BIAS) : none;
    if (!state->timing) {
        const cl_int code =
            clEnqueueCopyBuffer(state->slot->queue, own->net.start.mem, state->out.mem, 0,
                                state->out_offset * sizeof(float), state->out_count * sizeof(float), 0, NULL, NULL);
        if (code != CL_SUCCESS)
            return hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    }
    if (own->net.mode == FORWARD)
        return hada_linear_forward(state->slot, &own->shape, input(own, W), bias, input(own, XS), out, err);
    if (own->net.mode == DATA)
        return hada_linear_backward_data(state->slot, &own->shape, input(own, W), input(own, DYS), out, err);
    const hada_floats dbias = {out.mem, out.offset + (size_t)own->shape.in * (size_t)own->shape.out};
    return hada_linear_backward_weights(state->slot, &own->shape, input(own, XS), input(own, DYS), out, dbias,
                                        own->net.accumulate, err);
}

static void expect(check_state *state, const linear_state *own, double *dx, double *dw, double *dbias)
{
    const hada_linear *s = &own->shape;
    double *const *plain = own->net.plain;
    if (own->net.mode == FORWARD) {
        hada_ref_linear(s->images, s->in, s->out, plain[W], check_get(state, 'o', 1) ? plain[BIAS] : NULL, plain[XS],
                        state->expected);
        return;
    }
    hada_ref_linear_backward(s->images, s->in, s->out, plain[W], plain[XS], plain[DYS], dx, dw, dbias);
    const size_t weights = (size_t)s->in * (size_t)s->out;
    if (own->net.mode == DATA) {
        memcpy(state->expected, dx, (size_t)s->images * (size_t)s->in * sizeof *dx);
    } else {
        memcpy(state->expected, dw, weights * sizeof *dw);
        memcpy(state->expected + weights, dbias, (size_t)s->out * sizeof *dbias);
    }
}

static hada_status prepare(check_state *state, hada_error *err)
{
    linear_state *own = check_own(state, sizeof *own);
    own->net.mode = check_get(state, 'b', 0);
    own->net.accumulate = check_get(state, 'a', 0);
    own->shape = (hada_linear){check_get(state, 'n', 1), check_get(state, 'i', 8), check_get(state, 'm', 8)};
    const size_t images = (size_t)own->shape.images, in = (size_t)own->shape.in, out = (size_t)own->shape.out;
    const size_t counts[] = {in * out, out, images * in, images * out};
    const size_t made = own->net.mode == FORWARD ? images * out : own->net.mode == DATA ? images * in : in * out + out;
    for (int i = 0; i < 4; i++)
        HADA_TRY(check_net_floats(state, &own->net, counts[i], 3, err));
    HADA_TRY(check_output(state, made, err));
    /* the output's first values are one more input, zeros where nothing is added to */
    float *start = check_room(state, made * sizeof *start);
    double *sums = check_room(state, (images * in + in * out + out) * sizeof *sums);
    check_fill_integers(state, 9, start, made, 9);
    for (size_t i = 0; i < made; i++)
        if (own->net.accumulate)
            sums[images * in + i] = start[i]; /* of the weights, then the biases */
        else
            start[i] = -777.0f;
    HADA_TRY(check_upload(state, &own->net.start, start, made * sizeof *start, err));
    if (!state->timing)
        expect(state, own, sums, sums + images * in, sums + images * in + in * out);
    state->bytes = (double)(in * out) * sizeof(float);
    state->flops = 2.0 * (double)(images * in * out);
    return HADA_OK;
}

const check_op check_net_linear = {"net_linear",
                                   "n images, i inputs, m outputs, b 0 forward, 1 gradient of x, 2 of weights and "
                                   "biases, o0 without bias, a1 added to; "
                                   "bytes are the weights'",
                                   prepare, launch, NULL};
