/* The Hadamard stage as a whole: a frame, dark level off, to the windows of all depths. */
#include "check.h"
#include "filter/hadamard.h"
#include "ref/ref_fft.h"
#include "ref/ref_filter.h"

enum { MAX_DEPTHS = 64, MAX_CHANNELS = 16 };

typedef struct hadamard_state {
    hada_model *model;
    hada_bank *bank;
    hada_hadamard *stage;
    hada_geometry at;
    float *raw;
    double levels[MAX_CHANNELS];
} hadamard_state;

/* Filters of random real kernels on the whole grid, |W| about 1. */
static hada_status fill_model(check_state *state, hadamard_state *own, hada_error *err)
{
    const hada_model_info *info = &own->model->info;
    const size_t plane = hada_model_plane(own->model), area = (size_t)info->grid_rows * (size_t)info->grid_cols;
    float *noise = check_room(state, area * sizeof *noise);
    double *image = check_room(state, area * sizeof *image),
           *spectrum = check_room(state, 2 * plane * sizeof *spectrum);
    for (size_t z = 0; z < (size_t)(info->depths * info->channels); z++) {
        check_fill_normal(state, 10 + z, noise, area);
        for (size_t i = 0; i < area; i++)
            image[i] = noise[i] / info->grid_rows;
        HADA_TRY(hada_ref_fft_forward(image, info->grid_rows, info->grid_cols, spectrum, err));
        for (size_t i = 0; i < 2 * plane; i++)
            own->model->filter[2 * z * plane + i] = (float)spectrum[i];
    }
    return HADA_OK;
}

static hada_status expect(check_state *state, hadamard_state *own, const hada_model *model, hada_error *err)
{
    const hada_model_info *info = &own->model->info;
    const hada_ref_grid grid = {info->grid_rows,   info->grid_cols,  own->at.raw_row,    own->at.raw_col,
                                info->raw_rows,    info->raw_cols,   own->at.window_row, own->at.window_col,
                                info->window_rows, info->window_cols};
    const size_t plane = hada_model_plane(own->model), area = (size_t)info->raw_rows * (size_t)info->raw_cols;
    const size_t window = (size_t)info->window_rows * (size_t)info->window_cols;
    double *spectrum = check_room(state, 2 * plane * sizeof *spectrum);
    float *light = check_room(state, area * sizeof *light);
    for (size_t c = 0; c < (size_t)info->channels; c++) {
        for (size_t i = 0; i < area; i++)
            light[i] = own->raw[c * area + i] - (float)own->levels[c];
        HADA_TRY(hada_ref_grid_forward(&grid, light, own->at.raw_row, own->at.raw_col, info->raw_rows, info->raw_cols,
                                       spectrum, err));
        for (size_t z = 0; z < (size_t)info->depths; z++) {
            const size_t image = z * (size_t)info->channels + c;
            HADA_TRY(hada_ref_hadamard(&grid, spectrum, model->filter + 2 * plane * image,
                                       info->form == HADA_FORM_SPLIT, state->expected + image * window, err));
        }
    }
    return HADA_OK;
}

static hada_status make(check_state *state, hadamard_state *own, hada_error *err)
{
    double distances[MAX_DEPTHS];
    const int rows = check_get(state, 'r', 16), cols = check_get(state, 'c', 16);
    hada_model_info info = {.depths = check_get(state, 'd', 2),
                            .channels = check_get(state, 'k', 1),
                            .form = check_get(state, 's', 0) ? HADA_FORM_SPLIT : HADA_FORM_COMPLEX,
                            .boundary = check_get(state, 'p', 0) ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR,
                            .distances_mm = distances};
    if (info.depths > MAX_DEPTHS || info.channels > MAX_CHANNELS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "at most %d depths, %d channels", MAX_DEPTHS, MAX_CHANNELS);
    for (int z = 0; z < MAX_DEPTHS; z++)
        distances[z] = 100.0 + 10.0 * z;
    for (int c = 0; c < info.channels; c++)
        own->levels[c] = 0.25 * (c + 1);
    hada_status status =
        hada_model_set_sizes(&info, rows, cols, check_get(state, 'h', rows), check_get(state, 'w', cols), err);
    if (!status)
        status = hada_model_create(&own->model, &info, 0, err);
    if (!status)
        status = fill_model(state, own, err);
    if (!status)
        status = hada_geometry_of(&own->model->info, &own->at, err);
    const hada_spectrum_layout layout = hada_hadamard_layout(state->slot->context, &info);
    if (!status)
        status = hada_bank_create(&own->bank, state->slot, own->model, &layout, NULL, 0, HADA_BANK_FILTERS,
                                  check_get(state, 'q', 0), err);
    return status ? status
                  : hada_hadamard_create(&own->stage, state->slot, &own->model->info, check_get(state, 'b', 2), err);
}

static hada_status prepare(check_state *state, hada_error *err)
{
    hadamard_state *own = check_own(state, sizeof *own);
    HADA_TRY(make(state, own, err));
    const hada_model_info *info = &own->model->info;
    const size_t raw = (size_t)info->channels * (size_t)info->raw_rows * (size_t)info->raw_cols;
    const size_t images = (size_t)(info->depths * info->channels);
    own->raw = check_room(state, raw * sizeof *own->raw);
    check_fill_normal(state, 1, own->raw, raw);
    HADA_TRY(check_output(state, images * (size_t)info->window_rows * (size_t)info->window_cols, err));
    HADA_TRY(expect(state, own, own->model, err));
    /* half keeps 11 bits of each filter value */
    state->tolerance = check_get(state, 'q', 0) ? 4e-4 : 1e-6;
    state->bytes =
        (double)images * (double)own->stage->layout.count * 8.0 + (double)raw * 4.0 + (double)state->out_count * 4.0;
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    hadamard_state *own = state->own;
    const int depths = own->bank->depths;
    const size_t plane = state->out_count / (size_t)depths;
    const hada_hadamard *stage = own->stage;
    hada_pixels raw;
    hada_pixels_planar(&raw, own->raw, HADA_PIXEL_F32, stage->channels, stage->raw_rows, stage->raw_cols);
    HADA_TRY(hada_hadamard_frame(own->stage, &raw, own->levels, err));
    for (int z = 0, n; z < depths; z += n) {
        n = state->batch_limit && state->batch_limit < depths - z ? state->batch_limit : depths - z;
        HADA_TRY(
            hada_hadamard_run(own->stage, own->bank, z, n, state->out.mem, state->out_offset + (size_t)z * plane, err));
    }
    return HADA_OK;
}

static void release(check_state *state)
{
    hadamard_state *own = state->own;
    hada_hadamard_destroy(&own->stage);
    hada_bank_destroy(&own->bank);
    hada_model_destroy(&own->model);
}

const check_op check_hadamard = {
    "hadamard",
    "r rows, c columns, h and w of the window, k channels, d depths, b depths at once, p1 cropped by the sensor, s1 "
    "split filters, q1 filters as half",
    prepare, launch, release};
