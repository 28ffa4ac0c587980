/* Forward and inverse transforms, pruned and whole, with and without the filter product, both back ends. */
#include "check.h"
#include "fft/fft.h"
#include "io/safetensors.h"
#include "ref/ref_fft.h"

typedef struct fft_state {
    hada_fft *plan;
    hada_fft_desc desc;
    hada_buffer in, filter;
    hada_fft_filter product;
    int batch, channels;
} fft_state;

static hada_status make_plan(check_state *state, hada_fft_direction direction, fft_state **out, hada_error *err)
{
    fft_state *own = check_room(state, 1 * sizeof *own);
    state->own = *out = own;
    int rows = check_get(state, 'r', 8), cols = check_get(state, 'c', 8);
    own->batch = check_get(state, 'b', 1);
    own->desc = (hada_fft_desc){.direction = direction,
                                .backend = check_get(state, 'l', 0) ? HADA_FFT_CLFFT : HADA_FFT_OWN,
                                .rows = rows,
                                .cols = cols,
                                .batch = own->batch,
                                .row0 = check_get(state, 'y', 0),
                                .col0 = check_get(state, 'x', 0),
                                .real_rows = check_get(state, 'h', rows),
                                .real_cols = check_get(state, 'w', cols),
                                .band_rows = check_get(state, 'i', 0),
                                .band_cols = check_get(state, 'j', 0)};
    const int gap = check_get(state, 'a', 0);
    own->desc.real_pitch = (size_t)(own->desc.real_cols + gap);
    own->desc.real_distance = own->desc.real_pitch * (size_t)own->desc.real_rows + 3 * (size_t)gap;
    HADA_TRY(hada_fft_create(&own->plan, state->slot, &own->desc, err));
    double n = (double)rows * cols;
    double share = (double)own->desc.real_rows / rows;
    state->flops = own->batch * 2.5 * n * log2(n > 1 ? n : 2) * (direction == HADA_FFT_FORWARD ? share : 1);
    return HADA_OK;
}

static void release(check_state *state)
{
    fft_state *own = state->own;
    hada_fft_destroy(&own->plan);
}

static int piece(const check_state *state, int left)
{
    return state->batch_limit && state->batch_limit < left ? state->batch_limit : left;
}

/* The tolerance of single transforms: rounding grows with the square root of log2 of the points. */
static double tolerance(const fft_state *own)
{
    (void)own;
    return 3e-7;
}

static hada_status forward_prepare(check_state *state, hada_error *err)
{
    fft_state *own;
    HADA_TRY(make_plan(state, HADA_FFT_FORWARD, &own, err));
    const hada_fft_desc *desc = &own->desc;
    const hada_spectrum_layout *layout = hada_fft_plan_layout(own->plan);
    size_t n = (size_t)desc->rows * (size_t)desc->cols, half = (size_t)desc->cols / 2 + 1;
    size_t real = desc->real_distance * (size_t)own->batch;
    float *input = check_room(state, real * sizeof *input);
    double *image = check_room(state, n * sizeof *image),
           *spectrum = check_room(state, (size_t)desc->rows * half * 2 * sizeof *spectrum);
    state->unspecified = check_room(state, 2 * layout->count * (size_t)own->batch);
    check_fill_normal(state, 1, input, real);
    memset(state->unspecified, 1, 2 * layout->count * (size_t)own->batch);
    HADA_TRY(check_upload(state, &own->in, input, real * sizeof *input, err));
    HADA_TRY(check_output(state, 2 * layout->count * (size_t)own->batch, err));
    for (int b = 0; !state->timing && b < own->batch; b++) {
        memset(image, 0, n * sizeof *image);
        for (int r = 0; r < desc->real_rows; r++)
            for (int c = 0; c < desc->real_cols; c++)
                image[(size_t)(desc->row0 + r) * (size_t)desc->cols + (size_t)(desc->col0 + c)] =
                    input[(size_t)b * desc->real_distance + (size_t)r * desc->real_pitch + (size_t)c];
        HADA_TRY(hada_ref_fft_forward(image, desc->rows, desc->cols, spectrum, err));
        for (int ky = 0; ky < desc->rows; ky++)
            for (size_t kx = 0; kx < half && (!desc->band_cols || (int)kx <= desc->band_cols); kx++) {
                size_t at = 2 * ((size_t)b * layout->count + hada_spectrum_index(layout, ky, (int)kx));
                memcpy(&state->expected[at], &spectrum[2 * ((size_t)ky * half + kx)], 2 * sizeof(double));
                state->unspecified[at] = state->unspecified[at + 1] = 0;
            }
    }
    state->tolerance = tolerance(own);
    state->bytes = (double)own->batch * ((double)desc->real_distance * 4 + (double)layout->count * 8);
    return HADA_OK;
}

static hada_status forward_launch(check_state *state, hada_error *err)
{
    fft_state *own = state->own;
    size_t count = hada_fft_plan_layout(own->plan)->count;
    for (int b = 0, n; b < own->batch; b += n) {
        n = piece(state, own->batch - b);
        /* the output follows its guard zone: an offset in complex numbers */
        HADA_TRY(hada_fft_forward(own->plan, n, own->in.mem, (size_t)b * own->desc.real_distance, state->out.mem,
                                  state->out_offset / 2 + (size_t)b * count, err));
    }
    return HADA_OK;
}

/* The product of a spectrum value and a filter value, as hada_fft_filter defines it. */
static void multiply(hada_fft_product product, const double s[2], const double w[2], double out[2])
{
    if (product == HADA_FFT_COMPLEX) {
        out[0] = s[0] * w[0] - s[1] * w[1];
        out[1] = s[0] * w[1] + s[1] * w[0];
    } else if (product == HADA_FFT_SPLIT) {
        out[0] = s[0] * w[0];
        out[1] = s[1] * w[1];
    } else {
        out[0] = s[0];
        out[1] = s[1];
    }
}

/* A Hermitian spectrum (of a random image) per channel and a filter of the same kind per member, in the plan's layout.
 */
static hada_status hermitian(const check_state *state, const fft_state *own, uint64_t stream, double *image,
                             double *spectrum, float *out, hada_error *err)
{
    const hada_spectrum_layout *layout = hada_fft_plan_layout(own->plan);
    size_t n = (size_t)own->desc.rows * (size_t)own->desc.cols, half = (size_t)own->desc.cols / 2 + 1;
    hada_random random;
    hada_random_seed(&random, state->seed, stream);
    for (size_t i = 0; i < n; i++)
        image[i] = hada_random_normal(&random) / sqrt((double)n);
    HADA_TRY(hada_ref_fft_forward(image, own->desc.rows, own->desc.cols, spectrum, err));
    memset(out, 0, 2 * layout->count * sizeof *out);
    for (int ky = 0; ky < own->desc.rows; ky++)
        for (size_t kx = 0; kx < half; kx++)
            for (int part = 0; part < 2; part++)
                out[2 * hada_spectrum_index(layout, ky, (int)kx) + (size_t)part] =
                    (float)spectrum[2 * ((size_t)ky * half + kx) + (size_t)part];
    return HADA_OK;
}

static hada_status inverse_expected(check_state *state, const float *spectra, const float *filters, double *image,
                                    double *spectrum, hada_error *err)
{
    fft_state *own = state->own;
    const hada_fft_desc *desc = &own->desc;
    const hada_fft_filter *call = &own->product;
    const hada_spectrum_layout *layout = hada_fft_plan_layout(own->plan);
    size_t half = (size_t)desc->cols / 2 + 1;
    memset(state->unspecified, CHECK_UNTOUCHED, state->out_count);
    for (int b = 0; b < own->batch; b++) {
        const float *source = spectra + 2 * layout->count * (size_t)(own->product.product ? b % own->channels : b);
        const float *filter = filters + 2 * layout->count * (size_t)b;
        for (int ky = 0; ky < desc->rows; ky++)
            for (size_t kx = 0; kx < half; kx++) {
                size_t at = 2 * hada_spectrum_index(layout, ky, (int)kx);
                double s[2] = {source[at], source[at + 1]}, w[2] = {filter[at], filter[at + 1]};
                double *to = &spectrum[2 * ((size_t)ky * half + kx)];
                const int far = ky < desc->rows - ky ? ky : desc->rows - ky;
                multiply(own->product.product, s, w, to);
                if (((desc->band_rows || desc->band_cols) && (far > desc->band_rows || (int)kx > desc->band_cols)) ||
                    ((call->band_rows || call->band_cols) && (far > call->band_rows || (int)kx > call->band_cols)))
                    to[0] = to[1] = 0.0;
            }
        HADA_TRY(hada_ref_fft_inverse(spectrum, desc->rows, desc->cols, image, err));
        for (int r = 0; r < desc->real_rows; r++)
            for (int c = 0; c < desc->real_cols; c++) {
                const size_t at = (size_t)b * desc->real_distance + (size_t)r * desc->real_pitch + (size_t)c;
                state->expected[at] = image[(size_t)(desc->row0 + r) * (size_t)desc->cols + (size_t)(desc->col0 + c)];
                state->unspecified[at] = 0;
            }
    }
    return HADA_OK;
}

/* The filters to the device; as half, the reference takes what is left of them. */
static hada_status upload_filters(check_state *state, fft_state *own, float *filters, size_t count, hada_error *err)
{
    own->product.half = check_get(state, 'q', 0);
    if (!own->product.half)
        return check_upload(state, &own->filter, filters, count * sizeof *filters, err);
    uint16_t *halves = check_room(state, count * sizeof *halves);
    for (size_t i = 0; i < count; i++) {
        halves[i] = hada_half_from_float(filters[i]);
        filters[i] = hada_float_from_half(halves[i]);
    }
    return check_upload(state, &own->filter, halves, count * sizeof *halves, err);
}

static hada_status inverse_prepare(check_state *state, hada_error *err)
{
    fft_state *own;
    HADA_TRY(make_plan(state, HADA_FFT_INVERSE, &own, err));
    const hada_fft_desc *desc = &own->desc;
    const hada_spectrum_layout *layout = hada_fft_plan_layout(own->plan);
    int product = check_get(state, 'p', 0); /* 0 none, 1 complex, 2 split */
    own->product.product = (hada_fft_product)product;
    own->product.band_rows = check_get(state, 'm', 0);
    own->product.band_cols = check_get(state, 'n', 0);
    own->channels = product ? check_get(state, 's', 1) : own->batch;
    size_t n = (size_t)desc->rows * (size_t)desc->cols, half = (size_t)desc->cols / 2 + 1,
           image_floats = 2 * layout->count;
    float *spectra = check_room(state, image_floats * (size_t)own->channels * sizeof *spectra);
    float *filters = check_room(state, (image_floats * (size_t)own->batch) * sizeof *filters);
    double *image = check_room(state, n * sizeof *image),
           *spectrum = check_room(state, (size_t)desc->rows * half * 2 * sizeof *spectrum);
    if (state->timing) {
        check_fill_normal(state, 1, spectra, image_floats * (size_t)own->channels);
        check_fill_normal(state, 2, filters, image_floats * (size_t)own->batch);
    }
    for (int c = 0; !state->timing && c < own->channels; c++)
        HADA_TRY(hermitian(state, own, 1 + (uint64_t)c, image, spectrum, spectra + image_floats * (size_t)c, err));
    for (int b = 0; !state->timing && product && b < own->batch; b++)
        HADA_TRY(hermitian(state, own, 100 + (uint64_t)b, image, spectrum, filters + image_floats * (size_t)b, err));
    HADA_TRY(check_upload(state, &own->in, spectra, image_floats * (size_t)own->channels * sizeof(float), err));
    HADA_TRY(upload_filters(state, own, filters, image_floats * (size_t)own->batch, err));
    HADA_TRY(check_output(state, desc->real_distance * (size_t)own->batch, err));
    state->unspecified = check_room(state, state->out_count);
    if (!state->timing)
        HADA_TRY(inverse_expected(state, spectra, filters, image, spectrum, err));
    own->product.filter = own->filter.mem;
    own->product.spectrum_count = own->channels;
    state->tolerance = tolerance(own);
    state->bytes = (double)own->batch * ((double)desc->real_distance * 4 + (double)layout->count * 8) +
                   (product ? (double)own->channels * (double)layout->count * 8 : 0);
    return HADA_OK;
}

static hada_status inverse_launch(check_state *state, hada_error *err)
{
    fft_state *own = state->own;
    size_t count = hada_fft_plan_layout(own->plan)->count;
    for (int b = 0, n; b < own->batch; b += n) {
        n = piece(state, own->batch - b);
        /* with filters a piece starts at a whole depth: the spectrum's channels repeat from there */
        if (own->product.product)
            n = (n + own->channels - 1) / own->channels * own->channels;
        if (n > own->batch - b)
            n = own->batch - b;
        own->product.filter_first = b;
        HADA_TRY(hada_fft_inverse(own->plan, n, own->in.mem, own->product.product ? 0 : (size_t)b * count,
                                  state->out.mem, state->out_offset + (size_t)b * own->desc.real_distance,
                                  own->product.product ? &own->product : NULL, err));
    }
    return HADA_OK;
}

static const char help[] =
    "r rows, c cols, b batch, y x h w rectangle (top, left, rows, cols), a gap between rows, j columns of the band, "
    "l 1: clFFT";
static const char inverse_help[] =
    "as fft_forward; p 1: times complex filters, 2: split filters; s channels that the filters share; q 1: filters as "
    "half; i j rows and columns of the plan's band, m n of the call's (with filters)";

const check_op check_fft_forward = {"fft_forward", help, forward_prepare, forward_launch, release};
const check_op check_fft_inverse = {"fft_inverse", inverse_help, inverse_prepare, inverse_launch, release};
