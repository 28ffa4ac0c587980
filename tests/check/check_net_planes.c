/* Planar images resized, with values below a floor raised to it first. */
#include "check.h"
#include "net/layers.h"
#include "ref/ref_layers.h"

typedef struct planes_state {
    hada_buffer in;
    hada_ref_shape from;
    int rows, cols;
    float floor;
} planes_state;

/* Images are 7 floats apart. */
enum { GAP = 7 };

static hada_status prepare(check_state *state, hada_error *err)
{
    planes_state *own = check_own(state, sizeof *own);
    own->from = (hada_ref_shape){check_get(state, 'n', 1), check_get(state, 'k', 1), check_get(state, 'r', 8),
                                 check_get(state, 'c', 8)};
    own->rows = check_get(state, 'h', 16);
    own->cols = check_get(state, 'w', 16);
    own->floor = check_get(state, 'f', 0) ? 0.0f : -INFINITY;
    const size_t image = (size_t)own->from.channels * (size_t)own->from.rows * (size_t)own->from.cols;
    const size_t images = (size_t)own->from.images, count = images * (image + GAP);
    const size_t out = images * (size_t)own->from.channels * (size_t)own->rows * (size_t)own->cols;
    float *values = check_room(state, count * sizeof *values);
    double *plain = check_room(state, images * image * sizeof *plain);
    check_fill_normal(state, 1, values, count);
    for (size_t i = 0; i < images * image; i++)
        plain[i] = fmax(values[i / image * (image + GAP) + i % image], own->floor);
    HADA_TRY(check_output(state, out, err));
    hada_ref_resize(&own->from, own->rows, own->cols, 2, 0, plain, state->expected);
    HADA_TRY(check_upload(state, &own->in, values, count * sizeof *values, err));
    state->tolerance = 1e-6; /* as net_resize */
    state->bytes = (double)(images * image + out) * sizeof(float);
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    const planes_state *own = state->own;
    const hada_ref_shape *s = &own->from;
    const size_t in = (size_t)s->rows * (size_t)s->cols, out = (size_t)own->rows * (size_t)own->cols;
    const hada_planes from = {{own->in.mem, 0, in * (size_t)s->channels + GAP, in, (size_t)s->cols}, s->rows, s->cols};
    const hada_planes to = {
        {state->out.mem, state->out_offset, out * (size_t)s->channels, out, (size_t)own->cols}, own->rows, own->cols};
    return hada_resize_planes(state->slot, &from, &to, s->images, s->channels, own->floor, err);
}

const check_op check_net_planes = {
    "net_planes", "n images, k channels, r and c size before, h and w after, f1 values below zero count as zero",
    prepare, launch, NULL};
