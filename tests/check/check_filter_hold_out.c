/* Blocks of a frame's values that are held out: which ones exactly, what they count by, and errors less their mean. */
#include "check.h"
#include "launch/filter_hold_out.h"

typedef struct hold_state {
    hada_buffer blocks, given, other; /* `other`: what is not looked at; of errors, what they count by */
    cl_mem out;
} hold_state;

/* What an error of a held-out value of this weight counts by, where 1e30 is as good as infinite. */
static double score(double weight)
{
    const double root = sqrt(weight);
    return root < 1.0 ? root / (1.0 - root) : 1e30;
}

/* The reference: the mean of a block's values that count off each of them. */
static void level(double *values, const float *held, int side, int rows, int cols)
{
    for (int block = 0; block < (rows + side - 1) / side * cols; block++) {
        double sum = 0.0, count = 0.0;
        for (int pass = 0; pass < 2; pass++)
            for (int k = 0; k < side * side; k++) {
                const int row = block / cols * side + k / side, col = block % cols * side + k % side;
                if (row >= rows || col >= cols || !(held[row * cols + col] > 0.0f))
                    continue;
                values[row * cols + col] -= pass ? sum / count : 0.0;
                sum += pass ? 0.0 : values[row * cols + col];
                count += pass ? 0.0 : 1.0;
            }
    }
}

static hada_status prepare_errors(check_state *state, hold_state *own, hada_error *err)
{
    const int rows = check_get(state, 'r', 8), cols = check_get(state, 'c', 8);
    const size_t count = (size_t)rows * (size_t)cols;
    float *held = check_room(state, count * sizeof *held), *values = check_room(state, count * sizeof *values);
    check_fill_normal(state, 1, values, count);
    HADA_TRY(check_output(state, count, err));
    HADA_TRY(check_region(state, 0, count, &own->out, err));
    for (size_t i = 0; i < count; i++) {
        held[i] = i % 11 ? (float)(i * 7 % 5) - 2.0f : 1e30f; /* those of 0 and less stay */
        state->expected[i] = values[i] += 3.0f;
    }
    level(state->expected, held, check_get(state, 's', 1), rows, cols);
    HADA_TRY(check_upload(state, &own->given, values, count * sizeof *values, err));
    HADA_TRY(check_upload(state, &own->other, held, count * sizeof *held, err));
    state->tolerance = 1e-6; /* sums of 64 values */
    state->bytes = 8.0 * (double)count;
    state->flops = 2.0 * (double)count;
    return HADA_OK;
}

static hada_status prepare(check_state *state, hada_error *err)
{
    hold_state *own = check_own(state, sizeof *own);
    if (check_get(state, 'e', 0))
        return prepare_errors(state, own, err);
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
    const int rows = check_get(state, 'r', 8), cols = check_get(state, 'c', 8), side = check_get(state, 's', 1);
    const int shows_held = check_get(state, 'h', 0);
    cl_mem weights = shows_held ? own->other.mem : own->out;
    const hada_range range = hada_range_of((size_t)cols, 128, (size_t)rows, 1);
    const hada_range blocks =
        hada_range_of((size_t)((cols + side - 1) / side), 8, (size_t)((rows + side - 1) / side), 1);
    const cl_int code =
        clEnqueueCopyBuffer(state->slot->queue, own->given.mem, weights, 0, 0, own->given.bytes, 0, NULL, NULL);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    if (check_get(state, 'e', 0))
        return hada_launch_filter_level_blocks(state->slot, HADA_PROGRAM_FILTER_HOLD_OUT_DEFAULT, &blocks, err,
                                               .side = side, .rows = rows, .cols = cols, .held = own->other.mem,
                                               .values = own->out);
    return hada_launch_filter_hold_out(state->slot, HADA_PROGRAM_FILTER_HOLD_OUT_DEFAULT, &range, err,
                                       .blocks = own->blocks.octets, .side = side, .cols = cols,
                                       .by_weight = check_get(state, 'y', 0), .weighted = check_get(state, 'w', 0),
                                       .weights = weights, .held = shows_held ? own->out : own->other.mem);
}

const check_op check_hold_out = {
    "filter_hold_out",
    "r rows, c columns, s values a side of a block, w1 values have weights, y1 they count by them, h1 "
    "held-out values are compared, else weights; e1 errors less the mean of their block",
    prepare, launch, NULL};
