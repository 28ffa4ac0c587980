/* What a transform library needs around it: rectangles into grids and back (exact), spectra times filters in a band. */
#include "check.h"
#include "io/safetensors.h"
#include "launch/fft_plain.h"
#include "ref/ref_spectrum.h"

typedef struct plain_state {
    hada_buffer in, filter;
    int rows, cols, row0, col0, part_rows, part_cols; /* grid and rectangle */
    int batch, channels, product, half, step, band_rows, band_cols;
} plain_state;

static plain_state *begin(check_state *state)
{
    plain_state *own = check_own(state, sizeof *own);
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
    return own;
}

/* Both ways: the input of one is the expected output of the other, but for the grid's zeros outside the rectangle,
 * where the way back must not look. */
static hada_status move_prepare(check_state *state, int crop, hada_error *err)
{
    plain_state *own = begin(state);
    const size_t part = (size_t)own->part_rows * (size_t)own->part_cols, grid = (size_t)own->rows * (size_t)own->cols;
    const size_t batch = (size_t)own->batch, from = crop ? grid : part;
    float *in = check_room(state, from * batch * sizeof *in);
    HADA_TRY(check_output(state, batch * (crop ? part : grid), err));
    check_fill_integers(state, 1, in, from * batch, 99);
    for (size_t i = 0; i < batch * part; i++) {
        const size_t row = i % part / (size_t)own->part_cols + (size_t)own->row0;
        const size_t col = i % (size_t)own->part_cols + (size_t)own->col0;
        const size_t at = i / part * grid + row * (size_t)own->cols + col;
        if (crop)
            state->expected[i] = in[at];
        else
            state->expected[at] = in[i];
    }
    HADA_TRY(check_upload(state, &own->in, in, from * batch * sizeof *in, err));
    state->bytes = (double)batch * (double)(crop ? 2 * part : part + grid) * sizeof(float);
    return HADA_OK;
}

static hada_status pad_prepare(check_state *state, hada_error *err)
{
    return move_prepare(state, 0, err);
}

static hada_status crop_prepare(check_state *state, hada_error *err)
{
    return move_prepare(state, 1, err);
}

static hada_fft_real rectangle(const plain_state *own, size_t offset)
{
    const size_t pitch = (size_t)own->part_cols;
    return (hada_fft_real){.offset = offset,
                           .distance = pitch * (size_t)own->part_rows,
                           .pitch = pitch,
                           .row0 = own->row0,
                           .col0 = own->col0,
                           .rows = own->part_rows,
                           .cols = own->part_cols};
}

static hada_status pad_launch(check_state *state, hada_error *err)
{
    plain_state *own = state->own;
    const hada_range range = hada_range_of(state->out_count, 64, 1, 1);
    if (!state->regions)
        HADA_TRY(check_region(state, 0, state->out_count, &state->region[0], err));
    return hada_launch_fft_plain_pad(state->slot, HADA_PROGRAM_FFT_PLAIN_DEFAULT, &range, err, .in = own->in.mem,
                                     .real = rectangle(own, 0), .out = state->region[0], .rows = own->rows,
                                     .cols = own->cols, .count = state->out_count);
}

static hada_status crop_launch(check_state *state, hada_error *err)
{
    plain_state *own = state->own;
    const hada_range range = hada_range_of(state->out_count, 64, 1, 1);
    return hada_launch_fft_plain_crop(state->slot, HADA_PROGRAM_FFT_PLAIN_DEFAULT, &range, err, .in = own->in.mem,
                                      .rows = own->rows, .cols = own->cols, .out = state->out.mem,
                                      .real = rectangle(own, state->out_offset), .count = state->out_count);
}

/* Integers, but for their halves in the columns that mirror themselves: exact, also as half. */
static hada_status product_prepare(check_state *state, hada_error *err)
{
    plain_state *own = begin(state);
    const size_t image = (size_t)own->rows * (size_t)(own->cols / 2 + 1) * 2;
    const size_t ins = image * (size_t)own->channels, all = image * (size_t)own->batch,
                 filters = all * (size_t)own->step;
    float *in = check_room(state, ins * sizeof *in);
    float *filter = check_room(state, filters * sizeof *filter);
    uint16_t *halves = check_room(state, filters * sizeof *halves);
    HADA_TRY(check_output(state, all, err));
    check_fill_integers(state, 1, in, ins, 99);
    check_fill_integers(state, 2, filter, filters, 99);
    for (size_t i = 0; i < filters; i++)
        halves[i] = hada_half_from_float(filter[i]);
    for (size_t b = 0; b < (size_t)own->batch; b++)
        hada_ref_product(in + b % (size_t)own->channels * image, filter + b * (size_t)own->step * image, own->product,
                         own->rows, own->cols, own->band_rows, own->band_cols, state->expected + b * image);
    HADA_TRY(check_upload(state, &own->in, in, ins * sizeof *in, err));
    HADA_TRY(own->half ? check_upload(state, &own->filter, halves, filters * sizeof *halves, err)
                       : check_upload(state, &own->filter, filter, filters * sizeof *filter, err));
    state->bytes = (double)(ins + all + (own->product ? all : 0)) * sizeof(float);
    return HADA_OK;
}

static hada_status product_launch(check_state *state, hada_error *err)
{
    plain_state *own = state->own;
    const size_t count = state->out_count / 2;
    const hada_range range = hada_range_of(count, 64, 1, 1);
    const int product = own->product % 3, half = product && own->half;
    const hada_fft_band band = {own->rows, own->cols, own->band_rows, own->band_cols};
    if (!state->regions)
        HADA_TRY(check_region(state, 0, state->out_count, &state->region[0], err));
    return hada_launch_fft_plain_product(state->slot, hada_find_fft_plain(.fft_product = product, .fft_half = half),
                                         &range, err, .in = own->in.mem, .in_offset = 0, .in_count = own->channels,
                                         .filter = own->filter.mem, .filter_offset = 0, .filter_step = own->step,
                                         .out = state->region[0], .band = band, .count = count);
}

static const char help[] = "r rows, c columns, b batch, y x h w rectangle (top, left, rows, columns)";
static const char product_help[] =
    "r rows, c columns, b batch, s spectra, p 0 as it is, 1 complex, 2 split filters, q1 as half, i j rows and columns "
    "of the band, e take every e-th filter";

const check_op check_plain_pad = {"fft_plain_pad", help, pad_prepare, pad_launch, NULL};
const check_op check_plain_crop = {"fft_plain_crop", help, crop_prepare, crop_launch, NULL};
const check_op check_plain_product = {"fft_plain_product", product_help, product_prepare, product_launch, NULL};
