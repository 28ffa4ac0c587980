/* What a transform library needs around it: rectangles into grids and back (exact), spectra times filters in a band. */
#include <stdlib.h>

#include "check.h"
#include "core/alloc.h"
#include "io/safetensors.h"
#include "runtime/kernel.h"
#include "ref/ref_spectrum.h"

typedef struct plain_state {
    hada_buffer in, filter;
    int rows, cols, row0, col0, part_rows, part_cols; /* grid and rectangle */
    int batch, channels, product, half, step, band_rows, band_cols;
} plain_state;

static hada_status begin(check_state *state, plain_state **out, hada_error *err)
{
    plain_state *own = calloc(1, sizeof *own);
    if (!own)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the check");
    state->own = *out = own;
    own->rows = check_get(state, 'r', 8);
    own->cols = check_get(state, 'c', 8);
    own->row0 = check_get(state, 'y', 0);
    own->col0 = check_get(state, 'x', 0);
    own->part_rows = check_get(state, 'h', own->rows);
    own->part_cols = check_get(state, 'w', own->cols);
    own->batch = check_get(state, 'b', 1);
    own->channels = check_get(state, 's', own->batch);
    own->product = check_get(state, 'p', 0);
    own->half = check_get(state, 'q', 0);
    own->step = check_get(state, 'e', 1);
    own->band_rows = check_get(state, 'i', own->rows);
    own->band_cols = check_get(state, 'j', own->cols);
    return HADA_OK;
}

/* Both ways: the input of one is the expected output of the other, but for the grid's zeros outside the rectangle,
 * where the way back must not look. */
static hada_status move_prepare(check_state *state, int crop, hada_error *err)
{
    plain_state *own;
    hada_status status = begin(state, &own, err);
    const size_t part = (size_t)own->part_rows * (size_t)own->part_cols, grid = (size_t)own->rows * (size_t)own->cols;
    const size_t batch = (size_t)own->batch, from = crop ? grid : part;
    float *in = NULL;
    if (!status)
        status = hada_alloc((void **)&in, from * batch, sizeof *in, "the check", err);
    if (!status)
        status = check_output(state, batch * (crop ? part : grid), err);
    if (!status)
        check_fill_integers(state, 1, in, from * batch, 99);
    for (size_t i = 0; !status && i < batch * part; i++) {
        const size_t row = i % part / (size_t)own->part_cols + (size_t)own->row0;
        const size_t col = i % (size_t)own->part_cols + (size_t)own->col0;
        const size_t at = i / part * grid + row * (size_t)own->cols + col;
        if (crop)
            state->expected[i] = in[at];
        else
            state->expected[at] = in[i];
    }
    if (!status)
        status = check_upload(state, &own->in, in, from * batch * sizeof *in, err);
    free(in);
    state->bytes = (double)batch * (double)(crop ? 2 * part : part + grid) * sizeof(float);
    return status;
}

static hada_status pad_prepare(check_state *state, hada_error *err)
{
    return move_prepare(state, 0, err);
}

static hada_status crop_prepare(check_state *state, hada_error *err)
{
    return move_prepare(state, 1, err);
}

static hada_status pad_launch(check_state *state, hada_error *err)
{
    plain_state *own = state->own;
    const cl_ulong offset = 0, pitch = (cl_ulong)own->part_cols, distance = pitch * (cl_ulong)own->part_rows;
    const cl_ulong count = state->out_count;
    hada_status status = HADA_OK;
    if (!state->regions)
        status = check_region(state, 0, state->out_count, &state->region[0], err);
    const hada_arg args[] = {HADA_ARG(own->in.mem),    HADA_ARG(offset),         HADA_ARG(distance),
                             HADA_ARG(pitch),          HADA_ARG(own->row0),      HADA_ARG(own->col0),
                             HADA_ARG(own->part_rows), HADA_ARG(own->part_cols), HADA_ARG(state->region[0]),
                             HADA_ARG(own->rows),      HADA_ARG(own->cols),      HADA_ARG(count)};
    return status ? status
                  : check_kernel(state, "fft_plain", "fft_plain_pad", "", state->out_count, 64, args, HADA_COUNT(args),
                                 err);
}

static hada_status crop_launch(check_state *state, hada_error *err)
{
    plain_state *own = state->own;
    const cl_ulong offset = state->out_offset, pitch = (cl_ulong)own->part_cols;
    const cl_ulong distance = pitch * (cl_ulong)own->part_rows, count = state->out_count;
    const hada_arg args[] = {HADA_ARG(own->in.mem),    HADA_ARG(own->rows),      HADA_ARG(own->cols),
                             HADA_ARG(state->out.mem), HADA_ARG(offset),         HADA_ARG(distance),
                             HADA_ARG(pitch),          HADA_ARG(own->row0),      HADA_ARG(own->col0),
                             HADA_ARG(own->part_rows), HADA_ARG(own->part_cols), HADA_ARG(count)};
    return check_kernel(state, "fft_plain", "fft_plain_crop", "", state->out_count, 64, args, HADA_COUNT(args), err);
}

/* Integers, but for their halves in the columns that mirror themselves: exact, also as half. */
static hada_status product_prepare(check_state *state, hada_error *err)
{
    plain_state *own;
    float *in = NULL, *filter = NULL;
    uint16_t *halves = NULL;
    hada_status status = begin(state, &own, err);
    const size_t image = (size_t)own->rows * (size_t)(own->cols / 2 + 1) * 2;
    const size_t ins = image * (size_t)own->channels, all = image * (size_t)own->batch,
                 filters = all * (size_t)own->step;
    if (!status)
        status = hada_alloc((void **)&in, ins, sizeof *in, "the check", err);
    if (!status)
        status = hada_alloc((void **)&filter, filters, sizeof *filter, "the check", err);
    if (!status)
        status = hada_alloc((void **)&halves, filters, sizeof *halves, "the check", err);
    if (!status)
        status = check_output(state, all, err);
    if (!status) {
        check_fill_integers(state, 1, in, ins, 99);
        check_fill_integers(state, 2, filter, filters, 99);
        for (size_t i = 0; i < filters; i++)
            halves[i] = hada_half_from_float(filter[i]);
        for (size_t b = 0; b < (size_t)own->batch; b++)
            hada_ref_product(in + b % (size_t)own->channels * image, filter + b * (size_t)own->step * image,
                             own->product, own->rows, own->cols, own->band_rows, own->band_cols,
                             state->expected + b * image);
        status = check_upload(state, &own->in, in, ins * sizeof *in, err);
    }
    if (!status)
        status = own->half ? check_upload(state, &own->filter, halves, filters * sizeof *halves, err)
                           : check_upload(state, &own->filter, filter, filters * sizeof *filter, err);
    free(in);
    free(filter);
    free(halves);
    state->bytes = (double)(ins + all + (own->product ? all : 0)) * sizeof(float);
    return status;
}

static hada_status product_launch(check_state *state, hada_error *err)
{
    static const char *const options[2][3] = {{"", "-DFFT_PRODUCT=1", "-DFFT_PRODUCT=2"},
                                              {"", "-DFFT_PRODUCT=1 -DFFT_HALF=1", "-DFFT_PRODUCT=2 -DFFT_HALF=1"}};
    plain_state *own = state->own;
    const cl_ulong offset = 0, count = state->out_count / 2;
    hada_status status = HADA_OK;
    if (!state->regions)
        status = check_region(state, 0, state->out_count, &state->region[0], err);
    const hada_arg args[] = {HADA_ARG(own->in.mem),     HADA_ARG(offset),           HADA_ARG(own->channels),
                             HADA_ARG(own->filter.mem), HADA_ARG(offset),           HADA_ARG(own->step),
                             HADA_ARG(own->rows),       HADA_ARG(own->cols),        HADA_ARG(own->band_rows),
                             HADA_ARG(own->band_cols),  HADA_ARG(state->region[0]), HADA_ARG(count)};
    return status ? status
                  : check_kernel(state, "fft_plain", "fft_plain_product", options[own->half != 0][own->product % 3],
                                 (size_t)count, 64, args, HADA_COUNT(args), err);
}

static void release(check_state *state)
{
    plain_state *own = state->own;
    if (!own)
        return;
    hada_buffer_destroy(&own->in);
    hada_buffer_destroy(&own->filter);
    free(own);
}

static const char help[] = "r rows, c columns, b batch, y x h w rectangle (top, left, rows, columns)";
static const char product_help[] =
    "r rows, c columns, b batch, s spectra, p 0 as it is, 1 complex, 2 split filters, q1 as half, i j rows and columns "
    "of the band, e take every e-th filter";

const check_op check_plain_pad = {"fft_plain_pad", help, pad_prepare, pad_launch, release};
const check_op check_plain_crop = {"fft_plain_crop", help, crop_prepare, crop_launch, release};
const check_op check_plain_product = {"fft_plain_product", product_help, product_prepare, product_launch, release};
