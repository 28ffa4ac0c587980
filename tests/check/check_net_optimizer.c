/* Optimisers: three steps with other gradients each; s0 compares the parameters, s1 the state. Clipping: s0 compares
 * the gradients, s1 the norm. */
#include "check_net.h"
#include "net/optimizer.h"
#include "ref/ref_optimizer.h"

enum { STEPS = 3 };
#define RATE 0.01

/* Letters: b the optimiser, c1 centered, m1 momentum, w1 weight decay, f1 gradients scaled. */
static hada_optimizer_desc desc_of(const check_state *state)
{
    hada_optimizer_desc desc;
    hada_optimizer_desc_init(&desc, (hada_optimizer)check_get(state, 'b', 0));
    desc.centered = check_get(state, 'c', 0);
    desc.momentum = check_get(state, 'm', 0) ? 0.5 : 0.0;
    desc.weight_decay = check_get(state, 'w', 0) ? 0.125 : 0.0;
    desc.scale = check_get(state, 'f', 0) ? 0.375 : 1.0;
    desc.eps = 1e-3; /* large enough to see where it stands */
    return desc;
}

static hada_status launch(check_state *state, hada_error *err)
{
    const check_net *own = state->own;
    const hada_optimizer_desc desc = desc_of(state);
    const size_t count = (size_t)check_get(state, 'n', 1);
    hada_buffer out = state->out;
    if (!state->timing) {
        hada_status status = check_clear(state, 0, state->out_count, err);
        const cl_int code =
            clEnqueueCopyBuffer(state->slot->queue, own->memory[0].mem, out.mem, 0, state->out_offset * sizeof(float),
                                count * sizeof(float), 0, NULL, NULL);
        if (status || code != CL_SUCCESS)
            return status ? status : hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    }
    const hada_floats parameters = {out.mem, state->out_offset}, at = {out.mem, state->out_offset + count};
    hada_status status = HADA_OK;
    for (int t = 1; !status && t <= (state->timing ? 1 : STEPS); t++) {
        const hada_floats gradient = {own->memory[1].mem, (size_t)(t - 1) * count};
        status = hada_optimizer_step(state->slot, &desc, (uint64_t)t, RATE / t, gradient, parameters, at, count, err);
    }
    return status;
}

static void expect(const hada_optimizer_desc *desc, size_t count, const double *gradients, double *out)
{
    for (int t = 1; t <= STEPS; t++) {
        const double *g = gradients + (size_t)(t - 1) * count;
        double *p = out, *first = p + count, *second = first + count, *third = second + count;
        const hada_ref_rmsprop rms = {RATE / t,       desc->decay,        desc->eps,
                                      desc->momentum, desc->weight_decay, desc->centered};
        const hada_ref_adam adam = {RATE / t,  desc->beta1,        desc->beta2,
                                    desc->eps, desc->weight_decay, desc->optimizer == HADA_OPTIMIZER_ADAMW};
        if (desc->optimizer == HADA_OPTIMIZER_RMSPROP)
            hada_ref_rmsprop_keras(&rms, count, g, p, first, second, desc->centered ? third : second);
        else if (desc->optimizer == HADA_OPTIMIZER_RMSPROP_TORCH)
            hada_ref_rmsprop_torch(&rms, count, g, p, first, second, desc->centered ? third : second);
        else
            hada_ref_adam_step(&adam, t, count, g, p, first, second);
    }
}

static hada_status prepare(check_state *state, hada_error *err)
{
    check_net *own;
    const hada_optimizer_desc desc = desc_of(state);
    const size_t count = (size_t)check_get(state, 'n', 1), states = hada_optimizer_state_floats(&desc, count);
    own = check_net_own(state, NULL);
    /* small parameters, so that errors of the steps show */
    HADA_TRY(check_net_floats(state, own, count, 0, err));
    HADA_TRY(check_net_floats(state, own, count * STEPS, 0, err));
    HADA_TRY(check_output(state, count + states, err));
    float *small = check_room(state, count * sizeof *small);
    for (size_t i = 0; i < count; i++) {
        small[i] = 0.01f * (float)own->plain[0][i];
        state->expected[i] = small[i];
    }
    HADA_TRY(hada_buffer_write(&own->memory[0], state->slot, 0, small, count * sizeof *small, err));
    for (size_t i = 0; i < count * STEPS; i++)
        own->plain[1][i] *= desc.scale;
    if (!state->timing)
        expect(&desc, count, own->plain[1], state->expected);
    check_net_ignore(state, check_get(state, 's', 0) ? 0 : count, check_get(state, 's', 0) ? count : states);
    state->tolerance = desc.centered ? 3e-6 : 1e-6; /* centered: a difference of squares */
    state->bytes = (double)(3 * count + 2 * states) * sizeof(float);
    return HADA_OK;
}

const check_op check_net_optimizer = {"net_optimizer",
                                      "n parameters, b 0 RMSprop (Keras), 1 RMSprop (PyTorch), 2 Adam, 3 AdamW, c1 "
                                      "centered, m1 momentum, w1 weight decay, f1 gradients scaled, s1 the "
                                      "state compared",
                                      prepare, launch, NULL};

/* Two parts of the output clipped together; behind them norm and factor. */
static hada_status launch_clip(check_state *state, hada_error *err)
{
    const check_net *own = state->own;
    const size_t first = (size_t)check_get(state, 'n', 1), second = (size_t)check_get(state, 'm', 1);
    cl_mem out = state->out.mem;
    const size_t at = state->out_offset;
    const cl_int code = clEnqueueCopyBuffer(state->slot->queue, own->memory[0].mem, out, 0, at * sizeof(float),
                                            (first + second) * sizeof(float), 0, NULL, NULL);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    const hada_gradient_part parts[] = {{{out, at}, first}, {{out, at + first}, second}};
    const hada_floats norm = {out, at + first + second};
    return hada_clip_gradients(state->slot, parts, 2, (float)check_get(state, 'l', 1), norm, own->scratch.mem, err);
}

static hada_status prepare_clip(check_state *state, hada_error *err)
{
    check_net *own;
    const size_t first = (size_t)check_get(state, 'n', 1), second = (size_t)check_get(state, 'm', 1);
    const size_t count = first + second;
    const hada_gradient_part parts[] = {{{NULL, 0}, first}, {{NULL, 0}, second}};
    own = check_net_own(state, NULL);
    HADA_TRY(check_net_floats(state, own, count, 0, err));
    HADA_TRY(check_output(state, count + 2, err));
    HADA_TRY(check_scratch(state, &own->scratch, hada_clip_scratch(parts, 2), err));
    double norm = 0.0, limit = check_get(state, 'l', 1);
    for (size_t i = 0; i < count; i++)
        norm += own->plain[0][i] * own->plain[0][i];
    norm = sqrt(norm);
    const double factor = limit > 0.0 ? fmin(1.0, limit / (norm + 1e-6)) : 1.0;
    for (size_t i = 0; i < count; i++)
        state->expected[i] = factor * own->plain[0][i];
    state->expected[count] = norm;
    state->expected[count + 1] = factor;
    check_net_ignore(state, check_get(state, 's', 0) ? 0 : count, check_get(state, 's', 0) ? count : 2);
    state->tolerance = 1e-6;
    state->bytes = 3.0 * (double)count * sizeof(float);
    return HADA_OK;
}

const check_op check_net_clip = {
    "net_clip", "n and m values of two parts, l limit of the norm, 0: measured only, s1 the norm compared",
    prepare_clip, launch_clip, NULL};
