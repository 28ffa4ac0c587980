/* Point spread functions by geometric optics: the mask is sampled by rays, each of which lands as a small Gaussian
 * integrated over the pixels. */
#include <hadalens/camera.h>

#include "core/callers.h"
#include "optics/mask.h"

#define RAYS_ACROSS_LENS 24   /* at least */
#define RAY_STEP_PIXELS  0.4  /* on the sensor, at most: far below the width of a pixel with its blur */
#define HALF_MOST        2000 /* rays on either side of a lens's centre */
#define REACH_MAX        400  /* pixels: six standard deviations of the widest blur, and one */
/* What the rays of a PSF may cost, in additions: some twenty seconds. Cameras that can be built need a thousandth. */
#define STEPS_MOST 2e10
#define RAY_STEPS  64 /* of a ray that lands nowhere */
#define PI_QUARTER 0.78539816339744831

typedef struct splat {
    double *sum; /* rows x cols */
    int rows, cols;
    double sigma;
    int reach; /* pixels on either side */
} splat;

/* The share of a Gaussian at `centre` that falls on each pixel first .. first + 2 reach. */
static void pixel_shares(const splat *s, double centre, int first, double *share)
{
    const double scale = 1.0 / (s->sigma * sqrt(2.0));
    double below = erf((first - 0.5 - centre) * scale);
    for (int i = 0; i <= 2 * s->reach; i++) {
        const double above = erf((first + i + 0.5 - centre) * scale);
        share[i] = 0.5 * (above - below);
        below = above;
    }
}

static void add_ray(const splat *s, double row, double col)
{
    double down[2 * REACH_MAX + 1], across[2 * REACH_MAX + 1];
    if (!(fabs(row) < 1e6 && fabs(col) < 1e6))
        return;
    const int row0 = (int)lrint(row) - s->reach, col0 = (int)lrint(col) - s->reach;
    if (row0 >= s->rows || col0 >= s->cols || row0 + 2 * s->reach < 0 || col0 + 2 * s->reach < 0)
        return;
    pixel_shares(s, row, row0, down);
    pixel_shares(s, col, col0, across);
    for (int i = 0; i <= 2 * s->reach; i++) {
        const int r = row0 + i;
        if (r < 0 || r >= s->rows)
            continue;
        for (int j = 0; j <= 2 * s->reach; j++) {
            const int c = col0 + j;
            if (c >= 0 && c < s->cols)
                s->sum[(size_t)r * (size_t)s->cols + (size_t)c] += down[i] * across[j];
        }
    }
}

/* Whether a point of the mask belongs to lens l: inside the aperture, and no other centre is nearer. */
static int belongs(const hada_mask_design *design, int l, double qx, double qy)
{
    const double half = design->camera.aperture_mm / 2.0, *x = design->sites.x, *y = design->sites.y;
    double square;
    if (qx * qx + qy * qy > half * half)
        return 0;
    const int i = hada_sites_nearest(&design->sites, qx, qy, &square);
    return i == l || !((qx - x[i]) * (qx - x[i]) + (qy - y[i]) * (qy - y[i]) <
                       (qx - x[l]) * (qx - x[l]) + (qy - y[l]) * (qy - y[l])); /* as near: it belongs to both */
}

/* Rays on either side of a lens's centre. */
static int half_of(const hada_camera *camera, double defocus)
{
    const int least = RAYS_ACROSS_LENS / 2;
    const double wanted = camera->lens_diameter_mm / 2.0 * fabs(defocus) / (RAY_STEP_PIXELS * camera->pixel_pitch_mm);
    return wanted > least ? wanted < HALF_MOST ? (int)ceil(wanted) : HALF_MOST : least;
}

/* All rays of the mask; *rays: their number. */
static hada_status trace(const hada_mask_design *design, double distance, const splat *s, double *rays, hada_error *err)
{
    const hada_camera *camera = &design->camera;
    const double *x = design->sites.x, *y = design->sites.y;
    const double magnification = 1.0 + camera->distance_mm / distance,
                 defocus = camera->mask == HADA_MASK_APERTURE
                               ? magnification
                               : magnification - camera->distance_mm / camera->focal_length_mm,
                 radius = camera->lens_diameter_mm / 2.0, pitch = camera->pixel_pitch_mm;
    const int half = half_of(camera, defocus);
    const double step = radius / (half + 0.5), across = 2.0 * s->reach + 1.0;
    const double steps = PI_QUARTER * camera->lenses * pow(2.0 * half + 1.0, 2.0) * (RAY_STEPS + across * across);
    if (steps > STEPS_MOST)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                         "%d lenses of %g mm before pixels of %g mm, blurred by %g, take too many rays at %g mm (%.1g "
                         "steps, at most %.0g are made); use fewer or smaller lenses, larger pixels or less blur",
                         camera->lenses, camera->lens_diameter_mm, pitch, s->sigma, distance, steps, STEPS_MOST);
    for (int l = 0; l < camera->lenses; l++)
        for (int i = -half; i <= half; i++) {
            HADA_TRY(hada_monitor_check(design->monitor, err));
            for (int j = -half; j <= half; j++) {
                const double dy = i * step, dx = j * step;
                if (dx * dx + dy * dy > radius * radius || !belongs(design, l, x[l] + dx, y[l] + dy))
                    continue;
                *rays += 1.0;
                add_ray(s, s->rows / 2 + (y[l] * magnification + dy * defocus) / pitch,
                        s->cols / 2 + (x[l] * magnification + dx * defocus) / pitch);
            }
        }
    return HADA_OK;
}

static hada_status trace_lenses(const hada_mask_design *design, double distance_mm, int rows, int cols, double *sum,
                                hada_error *err)
{
    const double sigma = design->camera.blur_pixels;
    const splat s = {sum, rows, cols, sigma, (int)ceil(6.0 * sigma) + 1};
    double rays = 0.0;
    HADA_TRY(trace(design, distance_mm, &s, &rays, err));
    for (size_t i = 0; i < (size_t)rows * (size_t)cols; i++)
        sum[i] /= rays;
    return HADA_OK;
}

hada_status hada_camera_psf_watched(const hada_camera *camera, double distance_mm, int rows, int cols,
                                    const hada_monitor *monitor, hada_image *psf, hada_error *err)
{
    hada_mask_design design = {.monitor = monitor};
    double *sum = NULL;
    const size_t count = hada_size_product((size_t)rows, (size_t)cols);
    hada_status status = HADA_OK;
    *psf = (hada_image){0};
    if (!(distance_mm > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a distance of %g mm is not possible; it must be above 0",
                         distance_mm);
    HADA_TRY_OR_DONE(hada_mask_make_watched(&design, camera, monitor, err));
    HADA_TRY_OR_DONE(HADA_NEW(sum, count, "a point spread function", err));
    HADA_TRY_OR_DONE(hada_image_create(psf, 1, rows, cols, err));
    HADA_TRY_OR_DONE(hada_mask_has_lenses(&design.camera) ? trace_lenses(&design, distance_mm, rows, cols, sum, err)
                                                          : hada_psf_rays(&design, distance_mm, rows, cols, sum, err));
    float most = 0.0f;
    for (size_t i = 0; i < count; i++) {
        psf->data[i] = (float)sum[i];
        most = psf->data[i] > most ? psf->data[i] : most;
    }
    if (!(most > 0.0f))
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_ARGUMENT,
                      "no light of a point at %g mm reaches a sensor of %d x %d pixels; check the camera's lengths",
                      distance_mm, rows, cols));
done:
    free(sum);
    hada_mask_free(&design);
    if (status)
        hada_image_destroy(psf);
    return status;
}

hada_status hada_camera_psf(const hada_camera *camera, double distance_mm, int rows, int cols, hada_image *psf,
                            hada_error *err)
{
    HADA_NEED(camera && psf, err);
    return hada_camera_psf_watched(camera, distance_mm, rows ? rows : camera->rows, cols ? cols : camera->cols, NULL,
                                   psf, err);
}
