/* The map of content of planar images, and parts of them copied: exact. */
#include "check.h"
#include "launch/net_tensor.h"
#include "net/layer_launch.h"

static hada_status prepare(check_state *state, hada_error *err)
{
    const int channels = check_get(state, 'k', 1), rows = check_get(state, 'r', 8), cols = check_get(state, 'c', 8);
    const int cell = check_get(state, 'w', 32), cells = (cols + cell - 1) / cell;
    const size_t count = (size_t)channels * (size_t)rows * (size_t)cols, before = 3;
    float *values = check_room(state, (before + count) * sizeof *values);
    hada_buffer *in = check_own(state, sizeof *in);
    check_fill_integers(state, 1, values, before + count, 99);
    HADA_TRY(check_output(state, (size_t)rows * (size_t)cells, err));
    for (size_t i = 0; i < count; i++) {
        const size_t col = i % (size_t)cols, row = i / (size_t)cols % (size_t)rows;
        double *most = &state->expected[row * (size_t)cells + col / (size_t)cell];
        *most = fmax(*most, fabs((double)values[before + i]));
    }
    HADA_TRY(check_upload(state, in, values, (before + count) * sizeof *values, err));
    state->bytes = (double)count * sizeof(float);
    state->flops = (double)count;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    const hada_buffer *in = state->own;
    const int channels = check_get(state, 'k', 1), rows = check_get(state, 'r', 8), cols = check_get(state, 'c', 8);
    const int cell = check_get(state, 'w', 32), cells = (cols + cell - 1) / cell;
    const hada_range range = hada_layer_flat_range(state->slot, (size_t)cells, (size_t)rows);
    cl_mem out;
    HADA_TRY(check_region(state, 0, state->out_count, &out, err));
    return hada_launch_net_content(state->slot, hada_program_net_tensor_of(state->slot), &range, err, .image = in->mem,
                                   .out = out, .offset = 3, .channels = channels, .rows = rows, .cols = cols,
                                   .cell = cell, .cells = cells);
}

const check_op check_net_content = {"net_content", "k channels, r rows, c columns, w columns to a cell", prepare,
                                    launch, NULL};

typedef struct part_state {
    hada_buffer in;
    int channels, rows, cols, row, col; /* of the part, and its place in images of 3 rows and 5 columns more */
} part_state;

static hada_status prepare_part(check_state *state, hada_error *err)
{
    part_state *own = check_own(state, sizeof *own);
    own->channels = check_get(state, 'k', 1);
    own->rows = check_get(state, 'r', 8);
    own->cols = check_get(state, 'c', 8);
    own->row = check_get(state, 'y', 0);
    own->col = check_get(state, 'x', 0);
    const size_t row = (size_t)own->cols + 5, plane = row * ((size_t)own->rows + 3);
    const size_t pixels = (size_t)own->rows * (size_t)own->cols, count = pixels * (size_t)own->channels;
    float *values = check_room(state, plane * (size_t)own->channels * sizeof *values);
    check_fill_integers(state, 1, values, plane * (size_t)own->channels, 99);
    HADA_TRY(check_output(state, count, err));
    for (size_t i = 0; i < count; i++) {
        const size_t c = i / pixels, r = i % pixels / (size_t)own->cols, x = i % (size_t)own->cols;
        state->expected[i] = values[c * plane + (r + (size_t)own->row) * row + x + (size_t)own->col];
    }
    HADA_TRY(check_upload(state, &own->in, values, plane * (size_t)own->channels * sizeof *values, err));
    state->bytes = 2.0 * (double)count * sizeof(float);
    return HADA_OK;
}

static hada_status launch_part(check_state *state, hada_error *err)
{
    const part_state *own = state->own;
    const hada_ulong row = (hada_ulong)own->cols + 5, to_row = (hada_ulong)own->cols;
    const hada_planar_layout from = {.offset = (hada_ulong)own->row * row + (hada_ulong)own->col,
                                     .channel = row * ((hada_ulong)own->rows + 3),
                                     .row = row};
    const hada_planar_layout to = {
        .offset = state->out_offset, .channel = to_row * (hada_ulong)own->rows, .row = to_row};
    const hada_range range = hada_layer_flat_range(state->slot, hada_divide_up((size_t)own->cols, HADA_PART_COLS),
                                                   (size_t)own->rows * (size_t)own->channels);
    return hada_launch_net_part(state->slot, hada_program_net_tensor_of(state->slot), &range, err, .from = own->in.mem,
                                .to = state->out.mem, .at_from = from, .at_to = to, .rows = own->rows,
                                .cols = own->cols);
}

const check_op check_net_part = {"net_part", "k channels, r rows, c columns, y row and x column of the part",
                                 prepare_part, launch_part, NULL};
