/* Raw frames on a device: b = sum_z PSF_z * x_z + noise. */
#include <limits.h>

#include "core/callers.h"
#include "image/pixels.h"
#include "launch/optics_accumulate.h"
#include "launch/optics_sensor.h"
#include "optics/simulator.h"

/* Sensors: checked, and applied to frames. */

#define LOCAL 64 /* items in a work-group: of eight values each, or four complex numbers */

static hada_status take_sensor(hada_sensor *s, const hada_sensor *callers, hada_error *err)
{
    if (!callers)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a sensor is needed: start from hada_sensor_init()");
    HADA_TRY(HADA_OPTIONS_TAKE(s, callers, hada_sensor, err));
    if (!(s->exposure > 0.0) || !isfinite(s->exposure))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "an exposure of %g is not possible; it must be above 0",
                         s->exposure);
    if (!(s->full_well >= 0.0) || s->full_well > 1e6)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a full well of %g electrons is not possible; use 0 to 1e6",
                         s->full_well);
    if (!(s->read_noise >= 0.0) || !isfinite(s->read_noise))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a read noise of %g is not possible; it must not be negative",
                         s->read_noise);
    if (!(s->dark_level >= 0.0) || !(s->dark_level < 1.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a dark level of %g is not possible; use 0 to less than 1",
                         s->dark_level);
    if (s->bits < 0 || s->bits > 16 || (s->bits && !s->saturate))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "a converter of %d bits%s is not possible; use 1 to 16, which saturate, or 0", s->bits,
                         s->saturate ? "" : " without saturation");
    if (s->vignetting < HADA_VIGNETTING_NONE || s->vignetting > HADA_VIGNETTING_IMAGE)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "vignetting kind %d is not known", (int)s->vignetting);
    if (s->vignetting == HADA_VIGNETTING_IMAGE && !s->gain)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "vignetting by an image needs one: set `gain`");
    return HADA_OK;
}

hada_status hada_sensor_check(const hada_sensor *sensor, hada_error *err)
{
    hada_sensor own;
    return take_sensor(&own, sensor, err);
}

hada_status hada_optics_expose(hada_slot *slot, cl_mem values, size_t offset, cl_mem gain, size_t pixels, size_t count,
                               const hada_sensor *sensor, uint64_t seed, hada_error *err)
{
    const hada_optics_sensor how = {.exposure = (float)sensor->exposure,
                                    .full_well = (float)sensor->full_well,
                                    .read_noise = (float)sensor->read_noise,
                                    .dark_level = (float)sensor->dark_level,
                                    .levels = (float)((1 << sensor->bits) - 1),
                                    .saturate = sensor->saturate,
                                    .vignetted = gain != NULL,
                                    .key0 = (unsigned)seed,
                                    .key1 = (unsigned)(seed >> 32)};
    const hada_range range = hada_range_of(hada_divide_up(count, 8), LOCAL, 1, 1);
    hada_slot_cost(slot, 8.0 * (double)count, 150.0 * (double)count);
    return hada_launch_optics_sensor(slot, HADA_PROGRAM_OPTICS_SENSOR_DEFAULT, &range, err, .values = values,
                                     .offset = offset, .gain = gain ? gain : values, .pixels = pixels, .count = count,
                                     .sensor = how);
}

/* cos^4 of the angle between the axis and the line from the middle of the mask to a pixel: as of a small aperture
 * there. The sensor's shift counts. */
static double cos4(const hada_simulator *s, int row, int col)
{
    const hada_camera *c = &s->camera;
    const double y = (row - c->rows / 2 + s->shift.rows) * c->pixel_pitch_mm,
                 x = (col - c->cols / 2 + s->shift.cols) * c->pixel_pitch_mm, d = c->distance_mm,
                 square = d * d / (d * d + x * x + y * y);
    return square * square;
}

static hada_status check_gain(const hada_camera *camera, const hada_image *gain, hada_error *err)
{
    HADA_TRY(hada_image_check(gain, NULL, "a sensor", "gain", err));
    if (gain->channels != 1 || gain->rows != camera->rows || gain->cols != camera->cols)
        return hada_fail(
            err, HADA_ERROR_SIZE,
            "a vignetting of %d channels, %d x %d does not fit a sensor of %d x %d; it must have 1 channel",
            gain->channels, gain->rows, gain->cols, camera->rows, camera->cols);
    for (size_t i = 0; i < hada_image_count(gain); i++)
        if (!(gain->data[i] >= 0.0f) || !isfinite(gain->data[i]))
            return hada_fail(err, HADA_ERROR_ARGUMENT, "a vignetting of %g is not possible; it must be 0 or more",
                             (double)gain->data[i]);
    return HADA_OK;
}

/* The vignetting on the device; left empty where there is none. */
static hada_status upload_gain(const hada_simulator *s, const hada_sensor *sensor, hada_buffer *to, hada_error *err)
{
    const int rows = s->camera.rows, cols = s->camera.cols;
    const size_t bytes = (size_t)rows * (size_t)cols * sizeof(float);
    float *gain = NULL;
    hada_status status = HADA_OK;
    if (sensor->vignetting == HADA_VIGNETTING_NONE)
        goto done;
    if (sensor->vignetting == HADA_VIGNETTING_IMAGE) {
        HADA_TRY_OR_DONE(check_gain(&s->camera, sensor->gain, err));
        HADA_TRY_OR_DONE(hada_buffer_create_from(to, s->slot, sensor->gain->data, bytes, "the vignetting", err));
        goto done;
    }
    HADA_TRY_OR_DONE(HADA_NEW(gain, (size_t)rows * (size_t)cols, "the vignetting", err));
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < cols; c++)
            gain[(size_t)r * (size_t)cols + (size_t)c] = (float)cos4(s, r, c);
    HADA_TRY_OR_DONE(hada_buffer_create_from(to, s->slot, gain, bytes, "the vignetting", err));
done:
    free(gain);
    return status;
}

hada_status hada_simulator_expose(hada_simulator *s, const hada_sensor *callers, uint64_t seed, hada_image *frame,
                                  hada_error *err)
{
    HADA_NEED(s && frame, err);
    const hada_camera *c = &s->camera;
    hada_sensor own, *sensor = &own;
    hada_buffer gain = {0}, values = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(take_sensor(sensor, callers, err));
    if (frame->rows != c->rows || frame->cols != c->cols || frame->channels < 1)
        return hada_fail(err, HADA_ERROR_SIZE, "a frame of %d x %d does not fit a sensor of %d x %d", frame->rows,
                         frame->cols, c->rows, c->cols);
    if (hada_image_count_not_finite(frame))
        return hada_fail(err, HADA_ERROR_NOT_FINITE, "a frame of light holds NaN or infinite values");
    const size_t count = hada_image_count(frame), pixels = (size_t)frame->rows * (size_t)frame->cols;
    HADA_TRY_OR_DONE(upload_gain(s, sensor, &gain, err));
    HADA_TRY_OR_DONE(hada_buffer_create_from(&values, s->slot, frame->data, count * sizeof(float), "a frame", err));
    HADA_TRY_OR_DONE(hada_optics_expose(s->slot, values.mem, 0, gain.mem, pixels, count, sensor, seed, err));
    HADA_TRY_OR_DONE(hada_buffer_read(&values, s->slot, 0, frame->data, count * sizeof(float), err));
done:
    HADA_DESTROY_BUFFERS(&gain, &values);
    return status;
}

hada_status hada_optics_accumulate(hada_slot *slot, cl_mem sum, size_t sum_offset, cl_mem otf, int otf_images,
                                   cl_mem scene, int images, size_t count, int add, hada_error *err)
{
    if (count > INT_MAX)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "spectra of %zu values are too large for one image", count);
    const hada_range range = hada_range_of(hada_divide_up(count, 4), LOCAL, (size_t)images, 1);
    hada_slot_cost(slot, 8.0 * (double)count * (otf_images + (add ? 3.0 : 2.0) * images), 8.0 * (double)count * images);
    return hada_launch_optics_accumulate(slot, HADA_PROGRAM_OPTICS_ACCUMULATE_DEFAULT, &range, err, .sum = sum,
                                         .offset = sum_offset, .otf = otf, .scene = scene, .count = (int)count,
                                         .otf_images = otf_images, .add = add);
}

hada_status hada_simulator_check_image(const hada_simulator *s, const hada_image *image, hada_error *err)
{
    const hada_camera *c = &s->camera;
    const int window = image->rows == c->window_rows && image->cols == c->window_cols,
              field = image->rows == s->field.rows && image->cols == s->field.cols;
    if ((!window && !field) || (image->channels != 1 && image->channels != c->channels))
        return hada_fail(err, HADA_ERROR_SIZE,
                         "a scene of %d channels, %d x %d does not fit the camera's window of %d channels, %d x %d "
                         "(field: %d x %d); crop or resize it",
                         image->channels, image->rows, image->cols, c->channels, c->window_rows, c->window_cols,
                         s->field.rows, s->field.cols);
    if (hada_image_count_not_finite(image))
        return hada_fail(err, HADA_ERROR_NOT_FINITE, "a scene holds NaN or infinite values");
    return HADA_OK;
}

hada_status hada_simulator_check_plane(const hada_simulator *s, const hada_plane *plane, hada_error *err)
{
    HADA_TRY(hada_image_check(plane->image, NULL, "a scene", "the image of a plane", err));
    HADA_TRY(hada_simulator_check_depth(s, plane->depth, err));
    return hada_simulator_check_image(s, plane->image, err);
}

hada_status hada_simulator_upload(hada_simulator *s, const hada_image *image, int channels, hada_buffer *to,
                                  size_t offset, hada_error *err)
{
    const hada_extent field = s->field;
    const size_t pixels = (size_t)field.rows * (size_t)field.cols, bytes = pixels * sizeof(float);
    const int whole = image->rows == field.rows && image->cols == field.cols;
    float *wide = NULL;
    hada_status status = HADA_OK;
    if (!whole)
        HADA_TRY_OR_DONE(HADA_NEW(wide, pixels, "a scene", err));
    const int row0 = hada_window_origin(field.rows, image->rows), col0 = hada_window_origin(field.cols, image->cols);
    for (int c = 0; c < channels; c++) {
        const float *from =
            image->data + (image->channels == 1 ? 0 : (size_t)c * (size_t)image->rows * (size_t)image->cols);
        for (int r = 0; r < image->rows && !whole; r++)
            memcpy(wide + (size_t)(row0 + r) * (size_t)field.cols + col0, from + (size_t)r * (size_t)image->cols,
                   (size_t)image->cols * sizeof(float));
        HADA_TRY_OR_DONE(hada_buffer_write(to, s->slot, (offset + (size_t)c * pixels) * sizeof(float),
                                           whole ? from : wide, bytes, err));
    }
done:
    free(wide);
    return status;
}

hada_status hada_simulator_add_image(hada_simulator *s, const hada_image *image, const hada_buffer *otf, int add,
                                     hada_error *err)
{
    const int channels = s->camera.channels;
    HADA_TRY(hada_simulator_upload(s, image, channels, &s->scene, 0, err));
    HADA_TRY(hada_fft_forward(s->forward_scene, channels, s->scene.mem, 0, s->spectrum.mem, 0, err));
    return hada_optics_accumulate(s->slot, s->sum.mem, 0, otf->mem, s->psf_images, s->spectrum.mem, channels,
                                  s->layout.count, add, err);
}

hada_status hada_simulator_finish(hada_simulator *s, double noise, uint64_t seed, hada_image *raw, hada_error *err)
{
    const hada_camera *c = &s->camera;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_fft_inverse(s->inverse, c->channels, s->sum.mem, 0, s->real.mem, 0, NULL, err));
    HADA_TRY_OR_DONE(hada_image_create(raw, c->channels, c->rows, c->cols, err));
    HADA_TRY_OR_DONE(hada_buffer_read(&s->real, s->slot, 0, raw->data, hada_image_count(raw) * sizeof(float), err));
    if (noise > 0.0)
        hada_image_add_noise(raw, noise * hada_image_brightest(raw), seed);
done:
    if (status)
        hada_image_destroy(raw);
    return status;
}

static hada_status add_planes(hada_simulator *s, const hada_plane *planes, int count, hada_error *err)
{
    const hada_buffer *otf;
    for (int i = 0; i < count; i++) {
        HADA_TRY(hada_simulator_otf(s, hada_simulator_place(s, planes[i].depth), NULL, &otf, err));
        HADA_TRY(hada_simulator_add_image(s, planes[i].image, otf, i > 0, err));
    }
    return HADA_OK;
}

hada_status hada_simulator_render(hada_simulator *s, const hada_plane *planes, int count, double noise,
                                  uint64_t noise_seed, hada_image *raw, hada_error *err)
{
    HADA_NEED(s && planes && raw, err);
    *raw = (hada_image){0};
    if (count < 1 || !(noise >= 0.0 && isfinite(noise)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a scene of %d planes with noise %g is not possible", count, noise);
    for (int i = 0; i < count; i++)
        HADA_TRY(hada_simulator_check_plane(s, &planes[i], err));
    if (s->varying) {
        HADA_TRY(hada_varying_render(s, planes, count, raw, err));
        if (noise > 0.0)
            hada_image_add_noise(raw, noise * hada_image_brightest(raw), noise_seed);
        return HADA_OK;
    }
    HADA_TRY(add_planes(s, planes, count, err));
    return hada_simulator_finish(s, noise, noise_seed, raw, err);
}

hada_status hada_simulator_white(hada_simulator *s, int depth, hada_image *raw, hada_error *err)
{
    hada_image white = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_image_create(&white, 1, s->camera.window_rows, s->camera.window_cols, err));
    for (size_t i = 0; i < hada_image_count(&white); i++)
        white.data[i] = 1.0f;
    HADA_TRY_OR_DONE(hada_simulator_render(s, &(hada_plane){depth, &white}, 1, 0.0, 0, raw, err));
done:
    hada_image_destroy(&white);
    return status;
}

hada_status hada_simulator_white_exposure(hada_simulator *s, double share, double *exposure, hada_error *err)
{
    HADA_NEED(s && exposure, err);
    float most = 0.0f;
    for (int z = 0; z < s->camera.depths; z++) {
        hada_image raw = {0};
        HADA_TRY(hada_simulator_white(s, z, &raw, err));
        most = fmaxf(most, hada_image_brightest(&raw));
        hada_image_destroy(&raw);
    }
    if (!(most > 0.0f))
        return hada_fail(err, HADA_ERROR_NUMERIC, "no light of the window reaches the sensor: is its shift too large?");
    *exposure = share / most;
    return HADA_OK;
}
