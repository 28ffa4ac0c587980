/* Blocks of a frame's values that are held out: which ones exactly, and what they count by. */
#include "check.h"
#include "launch/filter_hold_out.h"

typedef struct hold_state {
    hada_buffer blocks, given, other; /* `other`: what is not looked at */
    cl_mem out;
} hold_state;

/* What an error of a held-out value of this weight counts by, where 1e30 is as good as infinite. */
static double score(double weight)
{
    const double root = sqrt(weight);
    return root < 1.0 ? root / (1.0 - root) : 1e30;
}

static hada_status prepare(check_state *state, hada_error *err)
{
    hold_state *own = check_own(state, sizeof *own);
    const int rows = check_get(state, 'r', 8), cols = check_get(state, 'c', 8), side = check_get(state, 's', 1),
              across = (cols + side - 1) / side, weighted = check_get(state, 'w', 0), by = check_get(state, 'y', 0);
    const size_t count = (size_t)rows * (size_t)cols, number = (size_t)((rows + side - 1) / side * across);
    static const float some[] = {0.81f, 0.25f, 0.0f, -1.0f, 0.5f, 0.0625f};
    unsigned char *blocks = check_room(state, number);
    float *weights = check_room(state, count * sizeof *weights);
    for (size_t i = 0; i < number; i++)
        blocks[i] = i * 7 % 5 == 1;
    HADA_TRY(check_output(state, count, err));
    HADA_TRY(check_region(state, 0, count, &own->out, err));
    for (size_t i = 0; i < count; i++) {
        const int row = (int)(i / (size_t)cols), col = (int)(i % (size_t)cols);
        const float weight = weighted ? some[i * 5 % 6] : 1.0f;
        const int out = blocks[row / side * across + col / side] && weight > 0.0f;
        weights[i] = weighted ? weight : NAN; /* is not looked at */
        state->expected[i] = !check_get(state, 'h', 0) ? (out ? 0.0 : weight) : !out ? 0.0 : by ? score(weight) : 1.0;
    }
    HADA_TRY(check_upload(state, &own->blocks, blocks, number, err));
    HADA_TRY(check_upload(state, &own->given, weights, count * sizeof *weights, err));
    HADA_TRY(check_upload(state, &own->other, weights, count * sizeof *weights, err));
    state->tolerance = by ? 1e-6 : 0.0; /* a root and a quotient */
    state->bytes = 12.0 * (double)count;
    state->flops = 4.0 * (double)count;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    const hold_state *own = state->own;
    const int cols = check_get(state, 'c', 8), shows_held = check_get(state, 'h', 0);
    cl_mem weights = shows_held ? own->other.mem : own->out;
    const hada_range range = hada_range_of((size_t)cols, 128, (size_t)check_get(state, 'r', 8), 1);
    const cl_int code =
        clEnqueueCopyBuffer(state->slot->queue, own->given.mem, weights, 0, 0, own->given.bytes, 0, NULL, NULL);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    return hada_launch_filter_hold_out(state->slot, HADA_PROGRAM_FILTER_HOLD_OUT_DEFAULT, &range, err,
                                       .blocks = own->blocks.octets, .side = check_get(state, 's', 1), .cols = cols,
                                       .by_weight = check_get(state, 'y', 0), .weighted = check_get(state, 'w', 0),
                                       .weights = weights, .held = shows_held ? own->out : own->other.mem);
}

const check_op check_hold_out = {
    "filter_hold_out",
    "r rows, c columns, s values a side of a block, w1 values have weights, y1 they count by them, h1 "
    "held-out values are compared, else weights",
    prepare, launch, NULL};
