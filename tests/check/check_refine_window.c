/* How badly planes of the window explain what the channels have in common, from the planes on (hada_refiner_score()):
 * as check_refine_score.c, with the planes' transforms. */
#include "check.h"
#include "filter/bank.h"
#include "ref/ref_fft.h"
#include "ref/ref_spectrum.h"
#include "refine/admm.h"

enum { MAX_DEPTHS = 8, MAX_CHANNELS = 4, MAX_LIST = 64 };

typedef struct window_state {
    hada_buffer otf, data, prior, variance;
    hada_refiner *refiner;
    hada_refine_shape shape;
    hada_refine_data refined;
    int sets, depths, channels, band_rows, band_cols, list[MAX_LIST];
    float *h, *b, *p, *v, *planes; /* on the host: arrays of half spectra row by row, planes as the refiner has them */
} window_state;

/* `images` random half spectra, of complex or of real and positive values, row by row and in the refiner's layout. */
static hada_status make(check_state *state, const window_state *own, uint64_t stream, size_t images, int parts,
                        float **rows, hada_buffer *buffer, hada_error *err)
{
    const hada_refine_shape *s = &own->shape;
    const hada_spectrum_layout layout =
        hada_fft_layout(state->slot->context, s->grid_rows, s->grid_cols, HADA_FFT_AUTO);
    const size_t values = (size_t)s->grid_rows * (size_t)(s->grid_cols / 2 + 1) * (size_t)parts;
    float *packed = check_room(state, images * layout.count * (size_t)parts * sizeof *packed);
    *rows = check_room(state, images * values * sizeof **rows);
    check_fill_normal(state, stream, *rows, images * values);
    for (size_t i = 0; parts == 1 && i < images * values; i++)
        (*rows)[i] *= 0.3f * (*rows)[i];
    for (size_t k = 0; k < images; k++)
        (parts == 2 ? hada_layout_pack : hada_layout_pack_real)(&layout, *rows + k * values,
                                                                packed + k * layout.count * (size_t)parts);
    return check_upload(state, buffer, packed, images * layout.count * (size_t)parts * sizeof *packed, err);
}

/* Spectra of the planes of a set, [channel][depth][values] complex, in double precision. */
static hada_status transform(check_state *state, const window_state *own, int set, double *spectra, hada_error *err)
{
    const hada_refine_shape *s = &own->shape;
    const hada_rectangle *window = &s->window;
    const size_t pixels = (size_t)s->grid_rows * (size_t)s->grid_cols, area = hada_rect_area(window);
    const size_t values = (size_t)s->grid_rows * (size_t)(s->grid_cols / 2 + 1);
    double *image = check_room(state, pixels * sizeof *image);
    for (int c = 0; c < own->channels; c++)
        for (int z = 0; z < own->depths; z++) {
            const float *plane = own->planes + (size_t)((set * own->depths + z) * own->channels + c) * area;
            for (int i = 0; i < window->rows; i++)
                for (int j = 0; j < window->cols; j++)
                    image[(size_t)(window->row0 + i) * (size_t)s->grid_cols + (size_t)(window->col0 + j)] =
                        plane[i * window->cols + j];
            HADA_TRY(hada_ref_fft_forward(image, s->grid_rows, s->grid_cols,
                                          spectra + 2 * values * (size_t)(c * own->depths + z), err));
        }
    return HADA_OK;
}

/* The energy of frequency number `at` of the half spectrum. */
static double energy_at(const window_state *own, int set, size_t at, size_t values, const double *spectra)
{
    const size_t channels = (size_t)own->channels, depths = (size_t)own->depths;
    double h[2 * MAX_CHANNELS * MAX_DEPTHS], u[2 * MAX_CHANNELS * MAX_DEPTHS], b[2 * MAX_CHANNELS];
    double prior[MAX_CHANNELS], variance[MAX_CHANNELS * MAX_DEPTHS];
    for (size_t c = 0; c < channels; c++) {
        prior[c] = own->p[c * values + at];
        memcpy(b + 2 * c, (double[]){own->b[2 * (c * values + at)], own->b[2 * (c * values + at) + 1]}, 2 * sizeof *b);
        for (size_t s = 0; s < depths; s++) {
            const size_t z = ((size_t)own->list[(size_t)set * depths + s] * channels + c) * values + at;
            variance[c * depths + s] = own->v[z];
            for (size_t part = 0; part < 2; part++) {
                h[2 * (c * depths + s) + part] = own->h[2 * z + part];
                u[2 * (c * depths + s) + part] = spectra[2 * ((c * depths + s) * values + at) + part];
            }
        }
    }
    return hada_ref_score(own->channels, own->depths, h, u, b, own->refined.prior ? prior : NULL,
                          own->refined.variance ? variance : NULL);
}

static hada_status expect(check_state *state, const window_state *own, hada_error *err)
{
    const int rows = own->shape.grid_rows, cols = own->shape.grid_cols, across = cols / 2 + 1;
    const size_t values = (size_t)rows * (size_t)across;
    double *spectra = check_room(state, 2 * values * (size_t)(own->channels * own->depths) * sizeof *spectra);
    for (int set = 0; set < own->sets; set++) {
        double sum = 0.0;
        HADA_TRY(transform(state, own, set, spectra, err));
        for (int ky = 0; ky < rows; ky++)
            for (int kx = 0; kx < across; kx++)
                if (2 * (ky < rows - ky ? ky : rows - ky) < own->band_rows && 2 * kx < own->band_cols)
                    sum += (kx == 0 || 2 * kx == cols ? 1.0 : 2.0) *
                           energy_at(own, set, (size_t)ky * (size_t)across + (size_t)kx, values, spectra);
        state->expected[set] = sum / ((double)rows * cols);
    }
    return HADA_OK;
}

static hada_status prepare(check_state *state, hada_error *err)
{
    window_state *own = check_own(state, sizeof *own);
    const int rows = check_get(state, 'r', 24), cols = check_get(state, 'c', 24);
    const int window_rows = check_get(state, 'h', rows / 2), window_cols = check_get(state, 'w', cols / 2);
    own->sets = check_get(state, 's', 1);
    own->depths = check_get(state, 'd', 2);
    own->channels = check_get(state, 'k', 1);
    own->band_rows = check_get(state, 'y', rows + 1);
    own->band_cols = check_get(state, 'x', cols + 1);
    const size_t all = (size_t)(own->depths + 1) * (size_t)own->channels, channels = (size_t)own->channels;
    own->shape =
        (hada_refine_shape){.grid_rows = rows,
                            .grid_cols = cols,
                            .window = {(rows - window_rows) / 2, (cols - window_cols) / 2, window_rows, window_cols},
                            .frame = {0, 0, rows, cols},
                            .boundary = HADA_BOUNDARY_CIRCULAR,
                            .channels = own->channels,
                            .max_sets = own->sets,
                            .max_planes = own->sets * own->depths,
                            .max_steps = 1};
    const size_t floats = (size_t)(own->sets * own->depths) * channels * hada_rect_area(&own->shape.window);
    if (own->depths > MAX_DEPTHS || own->channels > MAX_CHANNELS || own->sets * own->depths > MAX_LIST)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "at most %d depths and %d channels", MAX_DEPTHS, MAX_CHANNELS));
    /* one more depth has an OTF than a set has depths, so that the list matters */
    for (int i = 0; i < own->sets * own->depths; i++)
        own->list[i] = (i % own->depths + i / own->depths) % (own->depths + 1);
    HADA_TRY(make(state, own, 1, all, 2, &own->h, &own->otf, err));
    HADA_TRY(make(state, own, 2, channels, 2, &own->b, &own->data, err));
    HADA_TRY(make(state, own, 3, channels, 1, &own->p, &own->prior, err));
    HADA_TRY(make(state, own, 4, all, 1, &own->v, &own->variance, err));
    own->planes = check_room(state, floats * sizeof *own->planes);
    check_fill_normal(state, 5, own->planes, floats);
    own->refined = (hada_refine_data){.spectrum = own->data.mem,
                                      .otf = own->otf.mem,
                                      .otf_depths = own->depths + 1,
                                      .prior = check_get(state, 'p', 0) ? own->prior.mem : NULL,
                                      .variance = check_get(state, 'q', 0) ? own->variance.mem : NULL};
    HADA_TRY(hada_refiner_create(&own->refiner, state->slot, &own->shape, err));
    HADA_TRY(check_output(state, (size_t)own->sets, err));
    HADA_TRY(expect(state, own, err));
    state->tolerance = 2e-6; /* transforms, and sums as in refine_score */
    state->bytes = (double)own->sets * own->depths * own->channels * rows * (cols / 2 + 1.0) * 24.0;
    state->flops = (double)own->sets * own->depths * own->channels * rows * (cols / 2 + 1.0) * 60.0;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    window_state *own = state->own;
    const size_t each = (size_t)(own->depths * own->channels) * hada_rect_area(&own->shape.window);
    const int most = state->batch_limit && state->batch_limit < own->sets ? state->batch_limit : own->sets;
    double energy[MAX_LIST];
    float left[MAX_LIST];
    for (int set = 0, n; set < own->sets; set += n) {
        n = own->sets - set < most ? own->sets - set : most;
        cl_int code =
            clEnqueueWriteBuffer(state->slot->queue, hada_refiner_planes(own->refiner), CL_TRUE, 0,
                                 (size_t)n * each * sizeof(float), own->planes + (size_t)set * each, 0, NULL, NULL);
        if (code != CL_SUCCESS)
            HADA_TRY(hada_fail_cl(err, code, "clEnqueueWriteBuffer"));
        HADA_TRY(hada_refiner_score(own->refiner, &own->refined, n, own->depths, own->list + set * own->depths,
                                    own->band_rows, own->band_cols, energy, NULL, err));
        for (int i = 0; i < n; i++)
            left[i] = (float)energy[i];
        code = clEnqueueWriteBuffer(state->slot->queue, state->out.mem, CL_TRUE,
                                    (state->out_offset + (size_t)set) * sizeof(float), (size_t)n * sizeof(float), left,
                                    0, NULL, NULL);
        if (code != CL_SUCCESS)
            HADA_TRY(hada_fail_cl(err, code, "clEnqueueWriteBuffer"));
    }
    return HADA_OK;
}

static void release(check_state *state)
{
    window_state *own = state->own;
    hada_refiner_destroy(&own->refiner);
}

const check_op check_refine_window = {
    "refine_window",
    "r rows, c columns, h and w of the window, k channels, d depths in a set, s sets, p1 with a prior, q1 with a variance, "
    "y and x rows and columns of the band",
    prepare, launch, release};
