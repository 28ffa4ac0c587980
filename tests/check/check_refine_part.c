/* The part of refined planes that results have (hada_refiner_crop()): a copy. */
#include "check.h"
#include "refine/admm_steps.h"

typedef struct part_state {
    hada_refiner *refiner;
    int depths;
    size_t bytes; /* of the part */
} part_state;

static hada_status prepare(check_state *state, hada_error *err)
{
    part_state *own = check_own(state, sizeof *own);
    const int rows = check_get(state, 'r', 24), cols = check_get(state, 'c', 24), channels = check_get(state, 'k', 1);
    const hada_rectangle shown = {check_get(state, 'y', 0), check_get(state, 'x', 0), check_get(state, 'h', rows / 2),
                                  check_get(state, 'w', cols / 2)};
    own->depths = check_get(state, 'd', 1);
    const hada_refine_shape shape = {.grid_rows = rows,
                                     .grid_cols = cols,
                                     .window = {0, 0, rows, cols},
                                     .shown = shown,
                                     .frame = {0, 0, rows, cols},
                                     .boundary = HADA_BOUNDARY_CIRCULAR,
                                     .channels = channels,
                                     .max_sets = 1,
                                     .max_planes = own->depths,
                                     .max_steps = 1};
    const size_t images = (size_t)own->depths * (size_t)channels, area = (size_t)rows * (size_t)cols;
    float *planes = check_room(state, images * area * sizeof *planes);
    check_fill_normal(state, 0, planes, images * area);
    HADA_TRY(hada_refiner_create(&own->refiner, state->slot, &shape, err));
    HADA_TRY(hada_buffer_write(&own->refiner->planes, state->slot, 0, planes, images * area * sizeof *planes, err));
    own->bytes = images * hada_rect_area(&shown) * sizeof(float);
    HADA_TRY(check_output(state, own->bytes / sizeof(float), err));
    double *to = state->expected;
    for (size_t image = 0; image < images; image++)
        for (int row = shown.row0; row < shown.row0 + shown.rows; row++)
            for (int col = shown.col0; col < shown.col0 + shown.cols; col++)
                *to++ = planes[image * area + (size_t)row * (size_t)cols + (size_t)col];
    state->bytes = 2.0 * (double)own->bytes;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    part_state *own = state->own;
    HADA_TRY(hada_refiner_crop(own->refiner, own->depths, err));
    return hada_buffer_copy(state->slot, hada_refiner_planes(own->refiner), 0, state->out.mem,
                            state->out_offset * sizeof(float), own->bytes, err);
}

static void release(check_state *state)
{
    part_state *own = state->own;
    hada_refiner_destroy(&own->refiner);
}

const check_op check_refine_part = {
    "refine_part", "r rows, c columns, h and w of the part, y and x where it begins, k channels, d depths", prepare,
    launch, release};
