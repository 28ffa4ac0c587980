/* Simulators: made, asked, taken apart. */
#include "optics/simulator.h"

#include "core/callers.h"
#include "optics/mask.h"

#define PATCH_PIXELS 2.0 /* docs/explanation/simulation.md says what that leaves */

/* Where the first row (or column) of the field lies on the sensor; negative: before it. */
static int field_origin(int sensor, int window, int field)
{
    return hada_window_origin(sensor, window) - hada_window_origin(field, window);
}

static hada_status make_plans(hada_simulator *s, hada_error *err)
{
    const hada_camera *c = &s->camera;
    const int images = c->channels > s->psf_images ? c->channels : s->psf_images;
    const hada_fft_desc psf = hada_fft_whole(HADA_FFT_FORWARD, s->rows, s->cols, 1);
    /* the sensor's first pixel is the transform's first pixel, or as far behind it as the field goes beyond */
    const int row0 = field_origin(c->rows, c->window_rows, s->field.rows),
              col0 = field_origin(c->cols, c->window_cols, s->field.cols);
    const hada_rectangle field = {row0 > 0 ? row0 : 0, col0 > 0 ? col0 : 0, s->field.rows, s->field.cols};
    const hada_rectangle sensor = {row0 < 0 ? -row0 : 0, col0 < 0 ? -col0 : 0, c->rows, c->cols};
    const hada_fft_desc scene = hada_fft_of(HADA_FFT_FORWARD, s->rows, s->cols, c->channels, field);
    const hada_fft_desc frame = hada_fft_of(HADA_FFT_INVERSE, s->rows, s->cols, c->channels, sensor);
    HADA_TRY(hada_fft_create(&s->forward_psf, s->slot, &psf, err));
    HADA_TRY(hada_fft_create(&s->forward_scene, s->slot, &scene, err));
    HADA_TRY(hada_fft_create(&s->inverse, s->slot, &frame, err));
    s->layout = *hada_fft_plan_layout(s->forward_psf);
    const size_t spectrum = s->layout.count * 2 * sizeof(float) * (size_t)images,
                 frames = frame.real_distance * (size_t)c->channels,
                 real = (psf.real_distance > frames ? psf.real_distance : frames) * sizeof(float);
    hada_context *context = s->slot->context;
    HADA_TRY(hada_buffer_create(&s->real, context, real, "a simulated frame", err));
    HADA_TRY(hada_buffer_create(&s->scene, context, scene.real_distance * (size_t)c->channels * sizeof(float),
                                "a scene", err));
    HADA_TRY(hada_buffer_create(&s->spectrum, context, spectrum, "the spectrum of a scene", err));
    return hada_buffer_create(&s->sum, context, spectrum, "the spectrum of a simulated frame", err);
}

static hada_status check_psf(const hada_camera *camera, const hada_image *psf, hada_error *err)
{
    for (int i = 0; i < camera->depths; i++) {
        if (psf[i].rows != camera->rows || psf[i].cols != camera->cols || psf[i].channels != psf[0].channels ||
            (psf[i].channels != 1 && psf[i].channels != camera->channels))
            return hada_fail(err, HADA_ERROR_SIZE,
                             "PSF %d of %d channels, %d x %d does not fit a camera "
                             "of %d channels, %d x %d",
                             i + 1, psf[i].channels, psf[i].rows, psf[i].cols, camera->channels, camera->rows,
                             camera->cols);
        if (hada_image_count_not_finite(&psf[i]))
            return hada_fail(err, HADA_ERROR_NOT_FINITE, "PSF %d holds NaN or infinite values", i + 1);
    }
    return HADA_OK;
}

static hada_status keep_psf(hada_simulator *s, const hada_image *psf, hada_error *err)
{
    HADA_TRY(HADA_NEW(s->psf, (size_t)s->camera.depths, "the PSFs", err));
    for (int i = 0; i < s->camera.depths; i++) {
        HADA_TRY(hada_image_create(&s->psf[i], psf[i].channels, psf[i].rows, psf[i].cols, err));
        memcpy(s->psf[i].data, psf[i].data, hada_image_count(&psf[i]) * sizeof(float));
    }
    s->psf_images = psf[0].channels;
    return HADA_OK;
}

static hada_status check_options(const hada_camera *c, const hada_simulator_options *options, hada_error *err)
{
    if (abs(options->shift_rows) > 65536 || abs(options->shift_cols) > 65536)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a shift of %d, %d pixels is not possible; use up to 65536",
                         options->shift_rows, options->shift_cols);
    const int circular = c->boundary == HADA_BOUNDARY_CIRCULAR, rows = options->field_rows, cols = options->field_cols;
    if ((rows || cols) && (rows < c->window_rows || cols < c->window_cols || rows > 65536 || cols > 65536 ||
                           (circular && (rows > c->rows || cols > c->cols))))
        return hada_fail(err, HADA_ERROR_SIZE,
                         "a field of %d x %d is not possible; it must hold the window of %d x %d%s", rows, cols,
                         c->window_rows, c->window_cols,
                         circular ? ", and fit on the sensor where the boundary is circular (padded takes more)" : "");
    return options->psf ? check_psf(c, options->psf, err) : HADA_OK;
}

/* Of the field, and of the transforms. */
static void set_sizes(hada_simulator *s, const hada_simulator_options *options)
{
    const hada_camera *camera = &s->camera;
    s->shift = (hada_extent){options->shift_rows, options->shift_cols};
    s->field = (hada_extent){camera->window_rows, camera->window_cols};
    if (options->field_rows)
        s->field = (hada_extent){options->field_rows, options->field_cols};
    s->rows = camera->rows;
    s->cols = camera->cols;
    if (camera->boundary == HADA_BOUNDARY_PADDED) {
        s->rows = hada_fft_good_size(camera->rows + s->field.rows);
        s->cols = hada_fft_good_size(camera->cols + s->field.cols);
    }
}

hada_status hada_simulator_create(hada_simulator **out, hada_context *context, const hada_camera *callers,
                                  const hada_simulator_options *callers_options, hada_error *err)
{
    HADA_NEED(out && context, err);
    *out = NULL;
    hada_camera own, *camera = &own;
    hada_simulator_options own_options, *options = &own_options;
    hada_simulator *s = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_camera_take(camera, callers, err));
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(options, callers_options, hada_simulator_options, err));
    HADA_TRY_OR_DONE(check_options(camera, options, err));
    const hada_image *psf = options->psf;
    const int waves = !psf && camera->optics == HADA_OPTICS_WAVE;
    HADA_TRY_OR_DONE(HADA_NEW(s, 1, "a simulator", err));
    s->camera = *camera;
    s->psf_images = waves ? camera->channels : 1;
    s->patch_pixels = PATCH_PIXELS;
    s->monitor = options->monitor;
    set_sizes(s, options);
    if (psf)
        HADA_TRY_OR_DONE(keep_psf(s, psf, err));
    if (waves) {
        hada_wave_options watched;
        hada_wave_options_init(&watched);
        watched.monitor = s->monitor;
        HADA_TRY_OR_DONE(hada_wave_create(&s->wave, context, camera, &watched, err));
    }
    HADA_TRY_OR_DONE(HADA_NEW(s->otf, (size_t)camera->depths, "the transfer functions", err));
    HADA_TRY_OR_DONE(hada_slot_create(&s->slot, context, err));
    hada_slot_watch(s->slot, s->monitor);
    HADA_TRY_OR_DONE(make_plans(s, err));
    if (options->field_varying != 0.0)
        HADA_TRY_OR_DONE(hada_varying_create(s, options->field_varying, err));
done:
    if (status)
        hada_simulator_destroy(&s);
    *out = s;
    return status;
}

void hada_simulator_destroy(hada_simulator **simulator)
{
    hada_simulator *s = hada_taken(simulator);
    if (!s)
        return;
    if (s->slot)
        hada_slot_finish(s->slot, NULL);
    hada_varying_destroy(s);
    hada_wave_destroy(&s->wave);
    hada_fft_destroy(&s->forward_psf);
    hada_fft_destroy(&s->forward_scene);
    hada_fft_destroy(&s->inverse);
    HADA_DESTROY_BUFFERS(&s->real, &s->scene, &s->spectrum, &s->sum);
    for (int i = 0; i < s->camera.depths; i++) {
        if (s->otf)
            hada_buffer_destroy(&s->otf[i]);
        if (s->psf)
            hada_image_destroy(&s->psf[i]);
    }
    for (int i = 0; i < s->between.count; i++)
        hada_buffer_destroy(&s->between.otf[i]);
    HADA_FREE(s->between.otf, s->between.distance_mm, s->otf, s->psf);
    hada_slot_destroy(&s->slot);
    free(s);
}

const hada_camera *hada_simulator_camera(const hada_simulator *simulator)
{
    return simulator ? &simulator->camera : NULL;
}
