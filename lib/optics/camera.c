#include <hadalens/camera.h>

#include "core/callers.h"
#include "optics/mask.h"

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
