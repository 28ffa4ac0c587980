/* The map of content of planar images: exact. */
#include <math.h>
#include <stdlib.h>

#include "check.h"
#include "net/layer_launch.h"

static hada_status prepare(check_state *state, hada_error *err)
{
    const int channels = check_get(state, 'k', 1), rows = check_get(state, 'r', 8), cols = check_get(state, 'c', 8);
    const int cell = check_get(state, 'w', 32), cells = (cols + cell - 1) / cell;
    const size_t count = (size_t)channels * (size_t)rows * (size_t)cols, before = 3;
    float *values = malloc((before + count) * sizeof *values);
    hada_buffer *in = calloc(1, sizeof *in);
    state->own = in;
    if (!values || !in) {
        free(values);
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the check");
    }
    check_fill_integers(state, 1, values, before + count, 99);
    hada_status status = check_output(state, (size_t)rows * (size_t)cells, err);
    for (size_t i = 0; !status && i < count; i++) {
        const size_t col = i % (size_t)cols, row = i / (size_t)cols % (size_t)rows;
        double *most = &state->expected[row * (size_t)cells + col / (size_t)cell];
        *most = fmax(*most, fabs((double)values[before + i]));
    }
    if (!status)
        status = check_upload(state, in, values, (before + count) * sizeof *values, err);
    free(values);
    state->bytes = (double)count * sizeof(float);
    state->flops = (double)count;
    return status;
}

static hada_status launch(check_state *state, hada_error *err)
{
    const hada_buffer *in = state->own;
    const cl_int channels = check_get(state, 'k', 1), rows = check_get(state, 'r', 8), cols = check_get(state, 'c', 8);
    const cl_int cell = check_get(state, 'w', 32), cells = (cols + cell - 1) / cell;
    const cl_ulong before = 3;
    cl_mem out;
    hada_status status = check_region(state, 0, state->out_count, &out, err);
    const hada_arg args[] = {HADA_ARG(in->mem), HADA_ARG(before), HADA_ARG(channels), HADA_ARG(rows),
                             HADA_ARG(cols),    HADA_ARG(cell),   HADA_ARG(cells),    HADA_ARG(out)};
    return status ? status
                  : hada_layer_launch_flat(state->slot, "net_content", "net_content", 0, (size_t)cells, (size_t)rows,
                                           args, HADA_COUNT(args), err);
}

static void release(check_state *state)
{
    if (state->own)
        hada_buffer_destroy(state->own);
    free(state->own);
}

const check_op check_net_content = {"net_content", "k channels, r rows, c columns, w columns to a cell", prepare,
                                    launch, release};
