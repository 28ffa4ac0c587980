/* Whether a camera is possible. */
#include <hadalens/camera.h>

#include "core/callers.h"
#include "optics/mask.h"

typedef struct range {
    const char *name, *unit;
    double value, low, high; /* low itself is not possible where it is 0 and `open` is set */
    int open;
} range;

static hada_status check_ranges(const range *ranges, size_t count, hada_error *err)
{
    for (size_t i = 0; i < count; i++) {
        const range *r = &ranges[i];
        if (r->value >= r->low && r->value <= r->high && !(r->open && r->value == r->low))
            continue;
        if (r->open)
            return hada_fail(err, HADA_ERROR_ARGUMENT, "a %s of %g %s is not possible; it must be above %g", r->name,
                             r->value, r->unit, r->low);
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a %s of %g %s is not possible; use %g to %g", r->name, r->value,
                         r->unit, r->low, r->high);
    }
    return HADA_OK;
}

static hada_status check_sensor(const hada_camera *camera, hada_error *err)
{
    if (camera->boundary != HADA_BOUNDARY_CIRCULAR && camera->boundary != HADA_BOUNDARY_PADDED)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "boundary kind %d is not known", (int)camera->boundary);
    if (camera->rows < 1 || camera->cols < 1 || camera->rows > 65536 || camera->cols > 65536)
        return hada_fail(err, HADA_ERROR_SIZE, "a sensor of %d x %d pixels is not possible; use 1 to 65536 a side",
                         camera->rows, camera->cols);
    if (camera->channels != 1 && camera->channels != 3)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a camera of %d channels is not possible; use 1 or 3",
                         camera->channels);
    if (camera->window_rows < 1 || camera->window_cols < 1 || camera->window_rows > camera->rows ||
        camera->window_cols > camera->cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "a window of %d x %d does not fit in a sensor of %d x %d; choose a smaller window",
                         camera->window_rows, camera->window_cols, camera->rows, camera->cols);
    return HADA_OK;
}

static hada_status check_mask(const hada_camera *camera, hada_error *err)
{
    const hada_mask mask = camera->mask;
    const double infinite = HUGE_VAL, width = camera->aperture_mm;
    if (mask == HADA_MASK_DIFFUSER || mask == HADA_MASK_CONTOUR) {
        /* finer surfaces would take too long to make; coarser ones are no random surfaces */
        const range surface[] = {
            {"correlation length", "mm", camera->correlation_mm, width / 400.0, width, 0},
            {"deflection", "mrad", mask == HADA_MASK_DIFFUSER ? camera->deflection_mrad : 1.0, 0.0, 250.0, 0}};
        return check_ranges(surface, sizeof surface / sizeof *surface, err);
    }
    if (mask == HADA_MASK_APERTURE && camera->cell_mm > 0.0) {
        const range cells[] = {{"cell", "mm", camera->cell_mm, width / 1024.0, width, 0},
                               {"share of open cells", "", camera->open_fraction, 0.0, 1.0, 0},
                               {"share of open cells", "", camera->open_fraction, 0.0, infinite, 1}};
        return check_ranges(cells, sizeof cells / sizeof *cells, err);
    }
    if (camera->lenses < 1 || camera->lenses > 4096)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%d lenses are not possible; use 1 to 4096", camera->lenses);
    if (!(camera->minimum_spacing_mm >= 0.0) || !(camera->minimum_spacing_mm < width))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a lens spacing of %g mm does not fit in an aperture of %g mm",
                         camera->minimum_spacing_mm, width);
    if (camera->maximum_spacing_mm != 0.0 && !(camera->maximum_spacing_mm > camera->minimum_spacing_mm))
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "a greatest lens spacing of %g mm is not possible; it must be above the smallest (%g mm), or 0",
            camera->maximum_spacing_mm, camera->minimum_spacing_mm);
    return HADA_OK;
}

static hada_status check_distances(const hada_camera *camera, hada_error *err)
{
    if (camera->depths < 1 || camera->depths > HADA_CAMERA_DEPTHS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%d depths are not possible; use 1 to %d", camera->depths,
                         HADA_CAMERA_DEPTHS);
    for (int i = 0; i < camera->depths; i++)
        if (!(camera->distances_mm[i] > 0.0) || !isfinite(camera->distances_mm[i]) ||
            (i && !(camera->distances_mm[i] > camera->distances_mm[i - 1])))
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "distance %d of %d (%g mm) is not possible; distances must be above 0 and rise", i + 1,
                             camera->depths, camera->distances_mm[i]);
    return HADA_OK;
}

static hada_status check_values(const hada_camera *camera, hada_error *err)
{
    if (!hada_enum_name(HADA_ENUM_MASK, (int)camera->mask))
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "mask kind %d is not known; see hada_mask", (int)camera->mask);
    if (camera->optics != HADA_OPTICS_GEOMETRY && camera->optics != HADA_OPTICS_WAVE)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "optics of kind %d are not known; see hada_optics",
                         (int)camera->optics);
    const double most = 1e6;
    const range ranges[] = {
        {"pixel pitch", "mm", camera->pixel_pitch_mm, 0.0, most, 1},
        {"distance to the sensor", "mm", camera->distance_mm, 0.0, most, 1},
        {"lens diameter", "mm", camera->lens_diameter_mm, 0.0, most, 1},
        {"focal length", "mm", camera->focal_length_mm, 0.0, most, 1},
        {"aperture", "mm", camera->aperture_mm, 0.0, most, 1},
        {"blur", "pixels", camera->blur_pixels, 0.25, 64.0, 0},
        {"refractive index", "", camera->refractive_index, 1.01, 5.0, 0},
        {"Abbe number", "", camera->abbe_number != 0.0 ? camera->abbe_number : 10.0, 5.0, 1000.0, 0},
        {"wavelength of red", "nm", camera->wavelengths_nm[0], 100.0, 20000.0, 0},
        {"wavelength of green", "nm", camera->wavelengths_nm[1], 100.0, 20000.0, 0},
        {"wavelength of blue", "nm", camera->wavelengths_nm[2], 100.0, 20000.0, 0}};
    HADA_TRY(check_sensor(camera, err));
    HADA_TRY(check_ranges(ranges, sizeof ranges / sizeof *ranges, err));
    HADA_TRY(check_mask(camera, err));
    return check_distances(camera, err);
}

hada_status hada_camera_take(hada_camera *own, const hada_camera *callers, hada_error *err)
{
    if (!callers)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a camera is needed: start from hada_camera_init()");
    HADA_TRY(HADA_OPTIONS_TAKE(own, callers, hada_camera, err));
    return check_values(own, err);
}

hada_status hada_camera_check(const hada_camera *camera, hada_error *err)
{
    hada_camera own;
    return hada_camera_take(&own, camera, err);
}
