/* The kernels that find a device's ceilings: exact. */
#include "check.h"
#include "runtime/profile.h"

enum { CHAINS = 12 };

static hada_status prepare_copy(check_state *state, hada_error *err)
{
    const size_t width = (size_t)hada_peak_width(state->slot->context);
    const size_t count = (size_t)check_get(state, 'n', 1) * width;
    float *values = check_room(state, count * sizeof *values);
    hada_buffer *in = check_own(state, sizeof *in);
    check_fill_integers(state, 1, values, count, 99);
    HADA_TRY(check_output(state, count, err));
    for (size_t i = 0; i < count; i++)
        state->expected[i] = values[i];
    HADA_TRY(check_upload(state, in, values, count * sizeof *values, err));
    state->bytes = 8.0 * (double)count;
    return HADA_OK;
}

static hada_status launch_copy(check_state *state, hada_error *err)
{
    const hada_buffer *in = state->own;
    cl_mem out = state->region[0];
    if (!state->regions)
        HADA_TRY(check_region(state, 0, state->out_count, &out, err));
    return hada_peak_copy(state->slot, in->mem, out, state->out_count, err);
}

static float factor_of(const check_state *state)
{
    return (float)check_get(state, 'f', -1);
}

static int width_of(const check_state *state)
{
    return check_get(state, 'w', hada_peak_width(state->slot->context));
}

static hada_status prepare_flops(check_state *state, hada_error *err)
{
    const hada_context *context = state->slot->context;
    const size_t width = (size_t)width_of(state), group = context->shape == HADA_SHAPE_GROUPS ? 256 : 1;
    /* whole groups: every work-item stores */
    const size_t items = ((size_t)check_get(state, 'n', 1) + group - 1) / group * group;
    const int rounds = check_get(state, 'r', 1), term = check_get(state, 'a', 1);
    HADA_TRY(check_output(state, items * width, err));
    for (size_t item = 0; item < items; item++) {
        double sum = 0;
        for (int k = 0; k < CHAINS; k++) {
            double v = (double)k + (double)(item % 16);
            for (int round = 0; round < rounds; round++)
                v = v * factor_of(state) + term;
            sum += v;
        }
        for (size_t lane = 0; lane < width; lane++)
            state->expected[item * width + lane] = sum;
    }
    state->flops = 2.0 * CHAINS * (double)(items * width) * rounds;
    return HADA_OK;
}

static hada_status launch_flops(check_state *state, hada_error *err)
{
    const size_t width = (size_t)width_of(state);
    cl_mem out = state->region[0];
    if (!state->regions)
        HADA_TRY(check_region(state, 0, state->out_count, &out, err));
    return hada_peak_flops(state->slot, width_of(state), out, state->out_count / width, factor_of(state),
                           (float)check_get(state, 'a', 1), check_get(state, 'r', 1), NULL, err);
}

const check_op check_peak_copy = {"peak_copy", "n vectors", prepare_copy, launch_copy, NULL};
const check_op check_peak_flops = {"peak_flops", "n work-items, r rounds, f factor, a term, w16 wide vectors",
                                   prepare_flops, launch_flops, NULL};
