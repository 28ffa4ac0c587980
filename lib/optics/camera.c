#include <hadalens/camera.h>

#include "core/callers.h"
#include "optics/mask.h"

/* Whether a camera is possible. */

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

/* The two small presets are a 36 x 24 mm sensor, binned, with lenses that resolve about one binned pixel. The focus
 * is near the middle of the range in 1/z (1/f = 1/d + 1/170 mm), the widest pattern (at the nearest depth) of a
 * scene that fills the window just fits on the sensor, and the outermost spots move by more than two pixels from depth
 * to depth. */
static const hada_camera small_camera = {
    .size = sizeof(hada_camera),
    .mask = HADA_MASK_MLA,
    .boundary = HADA_BOUNDARY_CIRCULAR,
    .channels = 3,
    .distance_mm = 30.0,
    .focal_length_mm = 25.5,
    .lens_diameter_mm = 0.4,
    .refractive_index = 1.43,
    .abbe_number = 50.0, /* of silicones and plastics of low index; the paper names none */
    .open_fraction = 0.5,
    .wavelengths_nm = {610.0, 530.0, 460.0},
    .seed = 1,
    .blur_pixels = 0.4,
};

hada_status hada_camera_preset(hada_camera *camera, const char *name, hada_error *err)
{
    HADA_NEED(camera && name, err);
    HADA_TRY(HADA_REPORT_CHECK(camera, hada_camera, err));
    hada_camera c = small_camera;
    int depths = 14;
    if (!strcmp(name, "sim512")) {
        c.rows = c.cols = 512;
        c.window_rows = c.window_cols = 192;
        c.pixel_pitch_mm = 0.07;
        c.lenses = 37;
        c.aperture_mm = 18.9;
        c.minimum_spacing_mm = 1.75;
    } else if (!strcmp(name, "sim300")) {
        c.rows = 300, c.cols = 400;
        c.window_rows = c.window_cols = 120;
        c.pixel_pitch_mm = 0.08;
        c.lenses = 29;
        c.aperture_mm = 12.0;
        c.minimum_spacing_mm = 1.28;
        depths = 4;
    } else if (!strcmp(name, "crop300")) { /* lenses so far out that a part of the light leaves the sensor */
        c.rows = 300, c.cols = 400;
        c.window_rows = c.window_cols = 120;
        c.pixel_pitch_mm = 0.08;
        c.boundary = HADA_BOUNDARY_PADDED;
        c.distance_mm = 15.0;
        c.focal_length_mm = 13.78; /* 1/f = 1/d + 1/170 mm */
        c.lenses = 29;
        c.aperture_mm = 20.0;
        c.minimum_spacing_mm = 2.08;
    } else if (!strcmp(name, "paper2022")) {
        c.rows = 1376, c.cols = 2064;
        c.window_rows = c.window_cols = 383;
        c.pixel_pitch_mm = 36.0 / 2064.0;
        c.distance_mm = 15.0;
        c.focal_length_mm = 15.0; /* n = 1.43, radius of curvature 6.5 mm: R / (n - 1) */
        c.lenses = 37;
        c.lens_diameter_mm = 3.0;
        c.aperture_mm = 12.0;
        c.minimum_spacing_mm = 1.2;
    } else
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "there is no camera preset '%s'; the presets are sim512, sim300, crop300 and paper2022", name);
    HADA_TRY(hada_camera_set_depths(&c, 100.0, 600.0, depths, err));
    HADA_REPORT_GIVE(camera, &c);
    return HADA_OK;
}

hada_status hada_camera_set_depths(hada_camera *camera, double near_mm, double far_mm, int count, hada_error *err)
{
    HADA_NEED(camera, err);
    if (count < 1 || count > HADA_CAMERA_DEPTHS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%d depths are not possible; ask for 1 to %d", count,
                         HADA_CAMERA_DEPTHS);
    if (!(near_mm > 0.0) || !isfinite(far_mm) || (count > 1 && !(far_mm > near_mm)))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "distances from %g to %g mm are not possible; near must be above 0 and below far", near_mm,
                         far_mm);
    camera->depths = count;
    for (int i = 0; i < count; i++) {
        const double t = count > 1 ? (double)i / (count - 1) : 0.0;
        camera->distances_mm[i] = 1.0 / ((1.0 - t) / near_mm + t / far_mm);
    }
    camera->distances_mm[0] = near_mm;
    if (count > 1)
        camera->distances_mm[count - 1] = far_mm;
    return HADA_OK;
}

hada_status hada_camera_resize(hada_camera *camera, int rows, int cols, int window_rows, int window_cols,
                               hada_error *err)
{
    HADA_NEED(camera, err);
    if (rows < 1 || cols < 1 || window_rows < 0 || window_cols < 0 || window_rows > rows || window_cols > cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "a sensor of %d x %d with a window of %d x %d is not possible; the window must fit in the "
                         "sensor",
                         rows, cols, window_rows, window_cols);
    const int before = camera->rows < camera->cols ? camera->rows : camera->cols, now = rows < cols ? rows : cols;
    const double scale = (double)now / before;
    const int kept_rows = (int)lrint(camera->window_rows * scale), kept_cols = (int)lrint(camera->window_cols * scale);
    camera->pixel_pitch_mm /= scale;
    camera->rows = rows;
    camera->cols = cols;
    camera->window_rows = window_rows ? window_rows : kept_rows < 1 ? 1 : kept_rows > rows ? rows : kept_rows;
    camera->window_cols = window_cols ? window_cols : kept_cols < 1 ? 1 : kept_cols > cols ? cols : kept_cols;
    return HADA_OK;
}

double hada_camera_refractive_index(const hada_camera *camera, double wavelength_nm)
{
    if (!(camera->abbe_number > 0.0))
        return camera->refractive_index;
    /* the Fraunhofer lines d, F and C, in nanometres */
    const double d = 587.5618, f = 486.1327, c = 656.2725;
    const double b = (camera->refractive_index - 1.0) / camera->abbe_number / (1.0 / (f * f) - 1.0 / (c * c));
    return camera->refractive_index + b * (1.0 / (wavelength_nm * wavelength_nm) - 1.0 / (d * d));
}

double hada_camera_focal_length(const hada_camera *camera, double wavelength_nm)
{
    return camera->focal_length_mm * (camera->refractive_index - 1.0) /
           (hada_camera_refractive_index(camera, wavelength_nm) - 1.0);
}

double hada_camera_magnification(const hada_camera *camera, double distance_mm)
{
    return 1.0 + camera->distance_mm / distance_mm;
}

double hada_camera_defocus_pixels(const hada_camera *camera, double distance_mm)
{
    if (camera->mask == HADA_MASK_DIFFUSER)
        return 0.0;
    double scale = 1.0 + camera->distance_mm / distance_mm, width = camera->lens_diameter_mm;
    if (camera->mask != HADA_MASK_APERTURE)
        scale -= camera->distance_mm / camera->focal_length_mm;
    else if (camera->cell_mm > 0.0)
        width = camera->cell_mm;
    return width * fabs(scale) / camera->pixel_pitch_mm;
}

hada_status hada_camera_get_numbers(const hada_camera *camera, double distance_mm, double wavelength_nm,
                                    hada_camera_numbers *out, hada_error *err)
{
    HADA_NEED(camera && out, err);
    HADA_TRY(HADA_REPORT_CHECK(out, hada_camera_numbers, err));
    const hada_camera_numbers own = {.size = sizeof own,
                                     .magnification = hada_camera_magnification(camera, distance_mm),
                                     .defocus_pixels = hada_camera_defocus_pixels(camera, distance_mm),
                                     .refractive_index = hada_camera_refractive_index(camera, wavelength_nm),
                                     .focal_length_mm = hada_camera_focal_length(camera, wavelength_nm)};
    HADA_REPORT_GIVE(out, &own);
    return HADA_OK;
}
