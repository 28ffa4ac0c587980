/* Clipping of planes at zero, and blending with others: exact on integers and a share of a quarter; from floats on that
 * stand between two boundaries of 128 bits as well. */
#include "check.h"
#include "filter/hadamard.h"
#include "launch/filter_clip.h"

static hada_status prepare(check_state *state, hada_error *err)
{
    const size_t count = (size_t)check_get(state, 'n', 8);
    float *values = check_room(state, count * sizeof *values);
    hada_buffer *in = check_own(state, sizeof *in);
    check_fill_integers(state, 1, values, count, 99);
    HADA_TRY(check_output(state, count, err));
    for (size_t i = 0; i < count; i++)
        state->expected[i] = values[i] > 0.0f || i < (size_t)check_get(state, 'o', 0) ? values[i] : 0.0;
    HADA_TRY(check_upload(state, in, values, count * sizeof *values, err));
    state->bytes = 2.0 * (double)count * sizeof(float);
    state->flops = (double)count;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    const hada_buffer *in = state->own;
    const cl_int code = clEnqueueCopyBuffer(state->slot->queue, in->mem, state->out.mem, 0,
                                            state->out_offset * sizeof(float), in->bytes, 0, NULL, NULL);
    const size_t before = (size_t)check_get(state, 'o', 0), offset = state->out_offset + before;
    const hada_range range = hada_values_range(state->slot, offset, state->out_count - before);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    return hada_launch_filter_clip(state->slot, hada_program_filter_clip_of(state->slot), &range, err,
                                   .values = state->out.mem, .offset = offset, .count = state->out_count - before);
}

const check_op check_clip = {"filter_clip", "n values, o before them", prepare, launch, NULL};

#define SHARE 0.25

typedef struct blending {
    hada_buffer in, others;
} blending;

static hada_status prepare_blend(check_state *state, hada_error *err)
{
    const size_t count = (size_t)check_get(state, 'n', 8);
    float *values = check_room(state, count * sizeof *values), *others = check_room(state, count * sizeof *others);
    blending *own = check_own(state, sizeof *own);
    check_fill_integers(state, 1, values, count, 99);
    check_fill_integers(state, 2, others, count, 99);
    HADA_TRY(check_output(state, count, err));
    for (size_t i = 0; i < count; i++)
        state->expected[i] = values[i];
    for (size_t i = (size_t)check_get(state, 'o', 0); i < count; i++)
        state->expected[i] = SHARE * fmax((double)values[i], 0.0) +
                             (1.0 - SHARE) * fmax((double)others[i - (size_t)check_get(state, 'o', 0)], 0.0);
    HADA_TRY(check_upload(state, &own->in, values, count * sizeof *values, err));
    HADA_TRY(check_upload(state, &own->others, others, count * sizeof *others, err));
    state->bytes = 3.0 * (double)count * sizeof(float);
    state->flops = 5.0 * (double)count;
    return HADA_OK;
}

static hada_status launch_blend(check_state *state, hada_error *err)
{
    const blending *own = state->own;
    const cl_int code = clEnqueueCopyBuffer(state->slot->queue, own->in.mem, state->out.mem, 0,
                                            state->out_offset * sizeof(float), own->in.bytes, 0, NULL, NULL);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    const size_t before = (size_t)check_get(state, 'o', 0);
    return hada_image_blend(state->slot, state->out.mem, state->out_offset + before, own->others.mem,
                            state->out_count - before, SHARE, err);
}

const check_op check_filter_blend = {"filter_blend", "n values, o before them", prepare_blend, launch_blend, NULL};
