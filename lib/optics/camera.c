#include <hadalens/camera.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/random.h"

#define SEQUENCE_LENSES 1 /* of the generator: see core/random.h */

/* Full darts thrown again from the start, and darts for one lens, before the lenses are said not to fit. */
#define PLACEMENTS 64
#define DARTS      4000

void hada_camera_init(hada_camera *camera)
{
    *camera = (hada_camera){.size = sizeof *camera};
    hada_camera_preset(camera, "sim512", NULL);
}

/* The two small presets are a 36 x 24 mm sensor, binned, with lenses that resolve about one binned pixel. The focus
 * stands near the middle of the range in 1/z (1/f = 1/d + 1/170 mm), the widest pattern (at the nearest depth) of a
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
    .seed = 1,
    .blur_pixels = 0.4,
};

hada_status hada_camera_preset(hada_camera *camera, const char *name, hada_error *err)
{
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
                         "there is no camera preset '%s'; the presets are sim512, sim300 and paper2022", name);
    *camera = c;
    return hada_camera_set_depths(camera, 100.0, 600.0, depths, err);
}

hada_status hada_camera_set_depths(hada_camera *camera, double near_mm, double far_mm, int count, hada_error *err)
{
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

static int positive(double x)
{
    return isfinite(x) && x > 0.0;
}

hada_status hada_camera_check(const hada_camera *camera, hada_error *err)
{
    if (camera->size != sizeof *camera)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a camera description was not started with hada_camera_init()");
    if (camera->mask != HADA_MASK_MLA)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "mask kind %d is not known; use HADA_MASK_MLA",
                         (int)camera->mask);
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
    const struct {
        const char *name;
        double value;
    } lengths[] = {{"pixel pitch", camera->pixel_pitch_mm},
                   {"distance to the sensor", camera->distance_mm},
                   {"lens diameter", camera->lens_diameter_mm},
                   {"focal length", camera->focal_length_mm},
                   {"aperture", camera->aperture_mm}};
    for (size_t i = 0; i < sizeof lengths / sizeof *lengths; i++)
        if (!positive(lengths[i].value))
            return hada_fail(err, HADA_ERROR_ARGUMENT, "a %s of %g mm is not possible; it must be above 0",
                             lengths[i].name, lengths[i].value);
    if (camera->lenses < 1 || camera->lenses > 4096)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%d lenses are not possible; use 1 to 4096", camera->lenses);
    if (!(camera->minimum_spacing_mm >= 0.0) || !(camera->minimum_spacing_mm < camera->aperture_mm))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a lens spacing of %g mm does not fit in an aperture of %g mm",
                         camera->minimum_spacing_mm, camera->aperture_mm);
    if (!(camera->blur_pixels >= 0.25) || !(camera->blur_pixels <= 64.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a blur of %g pixels is not possible; use 0.25 to 64",
                         camera->blur_pixels);
    if (camera->depths < 1 || camera->depths > HADA_CAMERA_DEPTHS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%d depths are not possible; use 1 to %d", camera->depths,
                         HADA_CAMERA_DEPTHS);
    for (int i = 0; i < camera->depths; i++)
        if (!positive(camera->distances_mm[i]) || (i && !(camera->distances_mm[i] > camera->distances_mm[i - 1])))
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "distance %d of %d (%g mm) is not possible; distances must be above 0 and rise", i + 1,
                             camera->depths, camera->distances_mm[i]);
    return HADA_OK;
}

/* A point spread evenly over a disc, drawn from the square round it. */
static void dart(hada_random *random, double radius, double *x, double *y)
{
    do {
        *x = hada_random_range(random, -radius, radius);
        *y = hada_random_range(random, -radius, radius);
    } while (*x * *x + *y * *y > radius * radius);
}

static int place(hada_random *random, double radius, double spacing, int lenses, double *x, double *y)
{
    for (int i = 0; i < lenses; i++) {
        int darts = 0, fits = 0;
        while (!fits && darts++ < DARTS) {
            dart(random, radius, &x[i], &y[i]);
            fits = 1;
            for (int j = 0; j < i && fits; j++) {
                const double dx = x[i] - x[j], dy = y[i] - y[j];
                fits = dx * dx + dy * dy >= spacing * spacing;
            }
        }
        if (!fits)
            return 0;
    }
    return 1;
}

hada_status hada_camera_lenses(const hada_camera *camera, double *x_mm, double *y_mm, hada_error *err)
{
    hada_status status = hada_camera_check(camera, err);
    if (status)
        return status;
    hada_random random;
    hada_random_seed(&random, camera->seed, SEQUENCE_LENSES);
    const double radius = (camera->aperture_mm - camera->minimum_spacing_mm) / 2.0;
    for (int attempt = 0; attempt < PLACEMENTS; attempt++)
        if (place(&random, radius, camera->minimum_spacing_mm, camera->lenses, x_mm, y_mm))
            return HADA_OK;
    return hada_fail(err, HADA_ERROR_ARGUMENT,
                     "%d lenses at least %g mm apart do not fit at random into an aperture of %g mm; use fewer lenses, "
                     "a smaller spacing (about %.3g mm) or a larger aperture",
                     camera->lenses, camera->minimum_spacing_mm, camera->aperture_mm,
                     0.6 * camera->aperture_mm / sqrt(camera->lenses));
}

double hada_camera_magnification(const hada_camera *camera, double distance_mm)
{
    return 1.0 + camera->distance_mm / distance_mm;
}

double hada_camera_defocus_pixels(const hada_camera *camera, double distance_mm)
{
    const double scale = 1.0 + camera->distance_mm / distance_mm - camera->distance_mm / camera->focal_length_mm;
    return camera->lens_diameter_mm * fabs(scale) / camera->pixel_pitch_mm;
}

int hada_window_origin(int full, int window)
{
    return (full - window) / 2;
}
