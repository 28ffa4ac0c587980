/* Images at another place, cells of planes, differences, and light shared out to depths (kernels/refine_move.cl): one
 * after the other. */
#include "check.h"
#include "launch/refine_move.h"
#include "refine/shift.h"

typedef struct move_state {
    hada_buffer in, moved;
    hada_refine_move move;
    int images, channels, scale;
    size_t cells;
} move_state;

static int within(int i, int count)
{
    return i < 0 ? 0 : i < count ? i : count - 1;
}

/* The sum over the taps, as the kernel's comment has it. */
static double moved(const move_state *own, const float *image, int row, int col)
{
    const hada_refine_move *move = &own->move;
    double sum = 0.0;
    for (int a = 0; a < HADA_REFINE_MOVE_TAPS; a++)
        for (int b = 0; b < HADA_REFINE_MOVE_TAPS; b++)
            sum +=
                (double)move->down[a] * move->across[b] *
                image[within(row + move->row + a, move->rows) * move->cols + within(col + move->col + b, move->cols)];
    return sum > move->least ? sum : move->least;
}

static double cell(const move_state *own, const float *plane, int i, int j)
{
    const int rows = own->move.rows, cols = own->move.cols;
    double sum = 0.0;
    for (int c = 0; c < own->channels; c++)
        for (int a = 0; a < own->scale; a++)
            for (int b = 0; b < own->scale; b++)
                sum += plane[(c * rows + i * own->scale + a) * cols + j * own->scale + b];
    return sum;
}

/* A plane's part of what all have at a pixel, by their light before, which is the moved images' own here. */
static double light(const move_state *own, const float *plane, int row, int col)
{
    const int rows = own->move.rows, cols = own->move.cols;
    double here = 0.0, around = 0.0;
    for (int c = 0; c < own->channels; c++) {
        here += plane[(c * rows + row) * cols + col];
        for (int a = -2; a <= 2; a++)
            for (int b = -2; b <= 2; b++)
                around += plane[(c * rows + within(row + a, rows)) * cols + within(col + b, cols)];
    }
    return here + (double)HADA_REFINE_MOVE_AROUND * around;
}

static void share(const move_state *own, const float *before, double *to)
{
    const int rows = own->move.rows, cols = own->move.cols, channels = own->channels, planes = own->images / channels;
    const size_t area = (size_t)rows * (size_t)cols, each = (size_t)channels * area;
    for (int row = 0; row < rows; row++)
        for (int col = 0; col < cols; col++) {
            const size_t at = (size_t)row * (size_t)cols + (size_t)col;
            double all = 1e-30;
            for (int z = 0; z < planes; z++)
                all += light(own, before + (size_t)z * each, row, col);
            for (int c = 0; c < channels; c++) {
                double sum = 0.0;
                for (int z = 0; z < planes; z++)
                    sum += before[(size_t)z * each + (size_t)c * area + at];
                for (int z = 0; z < planes; z++)
                    to[(size_t)z * each + (size_t)c * area + at] =
                        sum * light(own, before + (size_t)z * each, row, col) / all;
            }
        }
}

/* The difference of two images, of which the second, the first of the next plane, counts by a part. */
static const float PART = 0.75f;
static double rest(const move_state *own, const float *in, size_t i)
{
    return in[i] - (double)PART * in[i + (size_t)own->move.rows * (size_t)own->move.cols];
}

static hada_status prepare(check_state *state, hada_error *err)
{
    move_state *own = check_own(state, sizeof *own);
    const int rows = check_get(state, 'r', 24), cols = check_get(state, 'c', 24), planes = check_get(state, 'd', 1);
    own->channels = check_get(state, 'k', 2);
    own->scale = check_get(state, 's', 2);
    own->images = planes * own->channels;
    const size_t area = (size_t)rows * (size_t)cols, values = (size_t)own->images * area;
    float *in = check_room(state, values * sizeof *in);
    check_fill_normal(state, 0, in, values);
    for (size_t i = 0; i < values; i++)
        in[i] = fabsf(in[i]); /* light */
    own->move = (hada_refine_move){.rows = rows, .cols = cols, .least = check_get(state, 'z', 0) ? 0.0f : -100.0f};
    own->move.row = hada_shift_weights(check_get(state, 'y', 0) / 10.0, own->move.down);
    own->move.col = hada_shift_weights(-check_get(state, 'x', 0) / 10.0, own->move.across);
    own->cells = (size_t)(planes * (rows / own->scale) * (cols / own->scale));
    HADA_TRY(hada_buffer_create(&own->in, state->slot->context, values * sizeof *in, "images", err));
    HADA_TRY(hada_buffer_create(&own->moved, state->slot->context, values * sizeof *in, "images", err));
    HADA_TRY(hada_buffer_write(&own->in, state->slot, 0, in, values * sizeof *in, err));
    HADA_TRY(check_output(state, 2 * values + own->cells + area, err));
    double *to = state->expected;
    for (int image = 0; image < own->images; image++)
        for (int row = 0; row < rows; row++)
            for (int col = 0; col < cols; col++)
                *to++ = moved(own, in + (size_t)image * area, row, col);
    for (int z = 0; z < planes; z++)
        for (int i = 0; i < rows / own->scale; i++)
            for (int j = 0; j < cols / own->scale; j++)
                *to++ = cell(own, in + (size_t)(z * own->channels) * area, i, j);
    for (size_t i = 0; i < area; i++)
        *to++ = rest(own, in, i);
    share(own, in, to);
    state->tolerance = 1e-6; /* sums of 36 and of up to 108 products in float */
    state->bytes = 2.0 * (double)(values * sizeof *in);
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    const move_state *own = state->own;
    const hada_program_refine_move program = hada_program_refine_move_of(state->slot);
    const size_t group = (size_t)hada_macros_of_refine_move(program)->move_group;
    const int rows = own->move.rows, cols = own->move.cols;
    const size_t area = (size_t)rows * (size_t)cols, values = (size_t)own->images * area;
    const hada_range lines = hada_range_groups(1, group, (size_t)rows, (size_t)own->images);
    const hada_range cells =
        hada_range_groups(1, group, (size_t)(rows / own->scale), (size_t)(own->images / own->channels));
    const hada_range numbers = hada_range_of(area, 64, 1, 1), pixels = hada_range_of((size_t)cols, 64, (size_t)rows, 1);
    HADA_TRY(hada_launch_refine_move_images(state->slot, program, &lines, err, .in = own->in.mem, .out = own->moved.mem,
                                            .move = own->move));
    HADA_TRY(hada_buffer_copy(state->slot, own->moved.mem, 0, state->out.mem, state->out_offset * sizeof(float),
                              values * sizeof(float), err));
    HADA_TRY(hada_launch_refine_move_cells(state->slot, program, &cells, err, .planes = own->in.mem,
                                           .cells = state->out.mem, .first = (cl_uint)(state->out_offset + values),
                                           .channels = own->channels, .rows = rows, .cols = cols, .scale = own->scale));
    HADA_TRY(hada_launch_refine_move_rest(
        state->slot, program, &numbers, err, .a = own->in.mem, .b = own->in.mem, .out = state->out.mem, .a_at = 0,
        .b_at = area, .out_at = state->out_offset + values + own->cells, .count = (cl_uint)area, .part = PART));
    HADA_TRY(hada_buffer_copy(state->slot, own->in.mem, 0, own->moved.mem, 0, values * sizeof(float), err));
    HADA_TRY(hada_launch_refine_move_share(state->slot, program, &pixels, err, .before = own->in.mem,
                                           .planes = own->moved.mem, .depths = own->images / own->channels,
                                           .channels = own->channels, .rows = rows, .cols = cols));
    return hada_buffer_copy(state->slot, own->moved.mem, 0, state->out.mem,
                            (state->out_offset + values + own->cells + area) * sizeof(float), values * sizeof(float),
                            err);
}

static void release(check_state *state)
{
    move_state *own = state->own;
    HADA_DESTROY_BUFFERS(&own->in, &own->moved);
}

const check_op check_refine_move = {"refine_move",
                                    "r rows, c columns, k channels (2 or more), d depths, s pixels of a cell, y and x "
                                    "tenths of a pixel down and to the left, z 1: clipped at 0",
                                    prepare, launch, release};
