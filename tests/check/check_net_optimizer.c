/* Optimisers: three steps with other gradients each; s0 compares the parameters, s1 the state. */
#include "check_net.h"
#include "net/optimizer.h"
#include "ref/ref_optimizer.h"

enum { STEPS = 3 };
#define RATE 0.01

/* Letters: b the optimiser, f1 gradients scaled. */
static hada_optimizer_desc desc_of(const check_state *state)
{
    hada_optimizer_desc desc;
    hada_optimizer_desc_init(&desc, (hada_optimizer)check_get(state, 'b', 0));
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
        double *p = out, *first = p + count, *second = first + count;
        const hada_ref_rmsprop rms = {RATE / t, HADA_RMSPROP_DECAY, desc->eps};
        const hada_ref_adam adam = {RATE / t, HADA_ADAM_BETA1, HADA_ADAM_BETA2, desc->eps};
        if (desc->optimizer == HADA_OPTIMIZER_RMSPROP)
            hada_ref_rmsprop_step(&rms, count, g, p, first);
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
    state->tolerance = 1e-6;
    state->bytes = (double)(3 * count + 2 * states) * sizeof(float);
    return HADA_OK;
}

const check_op check_net_optimizer = {
    "net_optimizer", "n parameters, b 0 RMSprop (Keras), 1 Adam, f1 gradients scaled, s1 the state compared", prepare,
    launch, NULL};

/* The sum of squares of two parts together. */
static void parts_of(const check_state *state, cl_mem mem, hada_gradient_part *parts)
{
    const size_t first = (size_t)check_get(state, 'n', 1), second = (size_t)check_get(state, 'm', 1);
    parts[0] = (hada_gradient_part){{mem, 0}, first};
    parts[1] = (hada_gradient_part){{mem, first}, second};
}

static hada_status launch_squares(check_state *state, hada_error *err)
{
    const check_net *own = state->own;
    hada_gradient_part parts[2];
    parts_of(state, own->memory[0].mem, parts);
    return hada_gradient_squares(state->slot, parts, 2, (hada_floats){state->out.mem, state->out_offset},
                                 own->scratch.mem, err);
}

static hada_status prepare_squares(check_state *state, hada_error *err)
{
    check_net *own = check_net_own(state, NULL);
    hada_gradient_part parts[2];
    parts_of(state, NULL, parts);
    const size_t count = parts[0].count + parts[1].count;
    HADA_TRY(check_net_floats(state, own, count, 0, err));
    HADA_TRY(check_output(state, 1, err));
    HADA_TRY(check_scratch(state, &own->scratch, hada_squares_scratch(parts, 2), err));
    for (size_t i = 0; i < count; i++)
        state->expected[0] += own->plain[0][i] * own->plain[0][i];
    state->tolerance = 1e-6;
    state->bytes = (double)count * sizeof(float);
    return HADA_OK;
}

const check_op check_net_squares = {"net_squares", "n and m values of two parts", prepare_squares, launch_squares,
                                    NULL};
