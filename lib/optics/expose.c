/* Sensors: checked, and applied to frames. */
#include "optics/simulator.h"

#include "core/callers.h"
#include "launch/optics_sensor.h"

#define LOCAL 64 /* items in a work-group, of eight values each */

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
