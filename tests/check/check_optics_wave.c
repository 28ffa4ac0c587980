/* The kernels of wave optics. Sums of small integers compare exactly; where angles, square roots or divisions come in,
 * to a few units of the last place. */
#include "check.h"
#include "optics/wave.h"
#include "ref/ref_optics.h"

typedef struct wave_state {
    hada_buffer in[4];
    cl_mem out[2]; /* parts of the output */
    hada_wave_spot spot;
    int count, rows, cols, pixels, samples;
} wave_state;

static hada_status begin(check_state *state, wave_state **own, float **first, size_t first_count, float **second,
                         size_t second_count, hada_error *err)
{
    *own = state->own = check_room(state, 1 * sizeof **own);
    *first = check_room(state, (first_count + 1) * sizeof(float));
    *second = check_room(state, (second_count + 1) * sizeof(float));
    return *own && *first && *second ? HADA_OK : hada_fail(err, HADA_ERROR_MEMORY, "no memory for the check");
}

/* Pupils. Distances near the edge are differences of nearly equal numbers, some of which round otherwise. */
static hada_status prepare_pupil(check_state *state, hada_error *err)
{
    enum { PLANES = 3 };
    const int n = check_get(state, 'n', 8), count = check_get(state, 'k', 2), pitch = (n + 7) / 8 * 8;
    const size_t phases = 4 * (size_t)pitch, values = 2 * (size_t)n * (size_t)pitch;
    const double step = 3.0 / n, radius = 1.4, aperture = 2.5;
    wave_state *own;
    float *phase, *random;
    HADA_TRY(begin(state, &own, &phase, phases * (size_t)count, &random, 2 * (size_t)count, err));
    hada_wave_lens *lenses = check_room(state, ((size_t)count + 1) * sizeof *lenses); /* one more, to begin behind it */
    const float planes[4 * PLANES * 2] = {0.6f, 0.8f, 0.9f, 0, -0.8f, 0.6f, 1.1f, 0, 0,  -1, 1.2f, 0,
                                          1,    0,    0.5f, 0, 0,     1,    2,    0, -1, 0,  1,    0};
    HADA_TRY(check_output(state, values * (size_t)count, err));
    own->spot = (hada_wave_spot){.points = n, .pitch = pitch, .step = step};
    own->count = count;
    check_fill_normal(state, 1, phase, phases * (size_t)count);
    check_fill_normal(state, 2, random, 2 * (size_t)count);
    for (int l = 0; l < count; l++) {
        lenses[l + 1] = (hada_wave_lens){random[2 * l], random[2 * l + 1], l % 2 * PLANES, l % 3 ? PLANES : 0};
        hada_ref_wave_pupil(phase + phases * (size_t)l, lenses[l + 1].x, lenses[l + 1].y,
                            planes + 4 * lenses[l + 1].first, lenses[l + 1].planes, n, pitch, (float)step,
                            (float)radius, (float)aperture, state->expected + values * (size_t)l);
    }
    HADA_TRY(check_upload(state, &own->in[0], phase, phases * (size_t)count * sizeof(float), err));
    HADA_TRY(check_upload(state, &own->in[1], lenses, ((size_t)count + 1) * sizeof *lenses, err));
    HADA_TRY(check_upload(state, &own->in[2], planes, sizeof planes, err));
    HADA_TRY(check_region(state, 0, state->out_count, &own->out[0], err));
    state->tolerance = 1e-5 * (1.0 + n / 64.0);
    state->bytes = 4.0 * (double)(values * (size_t)count);
    return HADA_OK;
}

static hada_status launch_pupil(check_state *state, hada_error *err)
{
    const wave_state *own = state->own;
    return hada_wave_launch_pupil(state->slot, own->out[0], own->in[0].mem, (hada_wave_lens_array)own->in[1].mem,
                                  own->in[2].mem, 1, own->count, &own->spot, 1.4, 2.5, err);
}

const check_op check_wave_pupil = {"optics_wave_pupil", "n samples across a lens, k lenses", prepare_pupil,
                                   launch_pupil, NULL};

/* Spots: small integers, so every sum is exact. */
static hada_status prepare_spots(check_state *state, hada_error *err)
{
    const int pixels = check_get(state, 'p', 4), samples = check_get(state, 's', 2), count = check_get(state, 'k', 1);
    const int n = pixels * samples, blocks = (n / 2 + 8) / 8;
    const size_t half = 16 * (size_t)blocks * (size_t)n, image = (size_t)pixels * (size_t)pixels;
    wave_state *own;
    float *spectra, *none;
    HADA_TRY(begin(state, &own, &spectra, 2 * half * (size_t)count, &none, 0, err));
    HADA_TRY(check_output(state, image * (size_t)count, err));
    own->pixels = pixels;
    own->samples = samples;
    own->count = count;
    check_fill_integers(state, 1, spectra, 2 * half * (size_t)count, 9);
    for (size_t l = 0; l < (size_t)count && !state->timing; l++)
        hada_ref_wave_spot(spectra + 2 * half * l, spectra + half * (2 * l + 1), pixels, samples,
                           state->expected + image * l);
    HADA_TRY(check_upload(state, &own->in[0], spectra, 2 * half * (size_t)count * sizeof(float), err));
    HADA_TRY(
        check_scratch(state, &own->in[1], (size_t)count * (size_t)pixels * 16 * (size_t)blocks * sizeof(float), err));
    HADA_TRY(check_region(state, 0, state->out_count, &own->out[0], err));
    state->bytes = 8.0 * (double)half * count;
    return HADA_OK;
}

static hada_status launch_spots(check_state *state, hada_error *err)
{
    const wave_state *own = state->own;
    return hada_wave_launch_spots(state->slot, own->out[0], own->in[1].mem, own->in[0].mem, own->count, own->pixels,
                                  own->samples, err);
}

const check_op check_wave_spots = {"optics_wave_spots", "p pixels (even) of s samples, k spots", prepare_spots,
                                   launch_spots, NULL};

/* Masks. The path is rounded to 24 bits before it becomes an angle of at most 2 pi times `waves` turns: 10 of them. */
static hada_status prepare_mask(check_state *state, hada_error *err)
{
    const int n = check_get(state, 'n', 8);
    const size_t count = (size_t)n * (size_t)n;
    wave_state *own;
    float *path, *open;
    HADA_TRY(begin(state, &own, &path, count, &open, count, err));
    HADA_TRY(check_output(state, 2 * count, err));
    own->rows = n;
    check_fill_normal(state, 1, path, count);
    check_fill_normal(state, 2, open, count);
    hada_ref_wave_mask(path, open, count, 3.25, state->expected);
    HADA_TRY(check_upload(state, &own->in[0], path, count * sizeof(float), err));
    HADA_TRY(check_upload(state, &own->in[1], open, count * sizeof(float), err));
    HADA_TRY(check_region(state, 0, state->out_count, &own->out[0], err));
    state->tolerance = 2.0 * 3.1416 * 10.0 * 6e-8;
    state->bytes = 16.0 * (double)count;
    return HADA_OK;
}

static hada_status launch_mask(check_state *state, hada_error *err)
{
    const wave_state *own = state->own;
    return hada_wave_launch_mask(state->slot, own->out[0], own->in[0].mem, own->in[1].mem, own->rows, 3.25, err);
}

const check_op check_wave_mask = {"optics_wave_mask", "n samples a side", prepare_mask, launch_mask, NULL};

/* Free space, in place. */
static hada_status prepare_travel(check_state *state, hada_error *err)
{
    const int rows = check_get(state, 'r', 8), blocks = check_get(state, 'b', 1);
    const size_t count = 16 * (size_t)rows * (size_t)blocks;
    wave_state *own;
    float *spectra, *phase;
    const size_t across = 16 * (size_t)blocks, down = 2 * (size_t)rows;
    HADA_TRY(begin(state, &own, &spectra, 2 * count, &phase, across + down, err));
    HADA_TRY(check_output(state, 2 * count, err));
    own->rows = rows;
    own->cols = blocks;
    check_fill_integers(state, 1, spectra, 2 * count, 9);
    check_fill_integers(state, 2, phase, across + down, 9);
    hada_ref_wave_travel(spectra, spectra + count, phase, phase + across, rows, blocks, state->expected);
    HADA_TRY(check_upload(state, &own->in[0], spectra, 2 * count * sizeof(float), err));
    HADA_TRY(check_upload(state, &own->in[1], phase, across * sizeof(float), err));
    HADA_TRY(check_upload(state, &own->in[2], phase + across, down * sizeof(float), err));
    HADA_TRY(check_region(state, 0, state->out_count, &own->out[0], err));
    state->bytes = 16.0 * (double)count;
    return HADA_OK;
}

static hada_status launch_travel(check_state *state, hada_error *err)
{
    const wave_state *own = state->own;
    const cl_int code = clEnqueueCopyBuffer(state->slot->queue, own->in[0].mem, state->out.mem, 0,
                                            state->out_offset * sizeof(float), own->in[0].bytes, 0, NULL, NULL);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    return hada_wave_launch_travel(state->slot, own->out[0], own->in[1].mem, own->in[2].mem, own->rows, own->cols, err);
}

const check_op check_wave_travel = {"optics_wave_travel", "r rows, b blocks of 8 columns", prepare_travel,
                                    launch_travel, NULL};

/* Sensors: pixels of w/8 samples, which begin o/8 samples before the field. */
static hada_status prepare_sensor(check_state *state, hada_error *err)
{
    const int rows = check_get(state, 'r', 8), cols = check_get(state, 'c', 8), pixels = check_get(state, 'p', 4);
    const double width = check_get(state, 'w', 20) / 8.0, offset = check_get(state, 'o', 0) / 8.0;
    const size_t count = (size_t)rows * (size_t)cols, image = (size_t)pixels * (size_t)pixels;
    hada_wave_pixel *table = check_room(state, ((size_t)pixels) * sizeof *table);
    wave_state *own;
    float *field, *none;
    HADA_TRY(begin(state, &own, &field, 2 * count, &none, 0, err));
    HADA_TRY(check_output(state, image, err));
    own->rows = rows;
    own->cols = cols;
    own->pixels = pixels;
    check_fill_integers(state, 1, field, 2 * count, 9);
    hada_ref_wave_sensor(field, field + count, rows, cols, -offset, -offset, width, pixels, pixels, state->expected);
    HADA_TRY(check_upload(state, &own->in[0], field, 2 * count * sizeof(float), err));
    hada_wave_share(table, pixels, -offset * 0.5, width * 0.5, cols, 0.0, 0.5); /* any unit will do */
    HADA_TRY(check_upload(state, &own->in[1], table, (size_t)pixels * sizeof *table, err));
    hada_wave_share(table, pixels, 7.0 - offset, width, rows, 7.0, 1.0);
    HADA_TRY(check_upload(state, &own->in[2], table, (size_t)pixels * sizeof *table, err));
    HADA_TRY(check_scratch(state, &own->in[3], (size_t)rows * (size_t)pixels * sizeof(float), err));
    HADA_TRY(check_region(state, 0, state->out_count, &own->out[0], err));
    state->bytes = 8.0 * (double)count;
    return HADA_OK;
}

static hada_status launch_sensor(check_state *state, hada_error *err)
{
    const wave_state *own = state->own;
    return hada_wave_launch_sensor(state->slot, own->out[0], own->in[3].mem, own->in[0].mem,
                                   (hada_wave_pixel_array)own->in[1].mem, (hada_wave_pixel_array)own->in[2].mem,
                                   own->rows, own->cols, own->pixels, own->pixels, err);
}

const check_op check_wave_sensor = {"optics_wave_sensor",
                                    "r rows, c columns of samples, p x p pixels of w/8 samples that begin o/8 before",
                                    prepare_sensor, launch_sensor, NULL};
