/* Point spread functions by geometric optics: the mask is sampled by rays, each of which lands as a small Gaussian
 * integrated over the pixels. */
#include <hadalens/camera.h>
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "optics/psf_rays.h"

#define RAYS_ACROSS_LENS 24  /* at least */
#define RAY_STEP_PIXELS  0.4 /* on the sensor, at most: far below the width of a pixel with its blur */
#define REACH_MAX        400 /* pixels: six standard deviations of the widest blur, and one */

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
static int belongs(const hada_camera *camera, const double *x, const double *y, int l, double qx, double qy)
{
    const double half = camera->aperture_mm / 2.0;
    if (qx * qx + qy * qy > half * half)
        return 0;
    const double own = (qx - x[l]) * (qx - x[l]) + (qy - y[l]) * (qy - y[l]);
    for (int i = 0; i < camera->lenses; i++)
        if (i != l && (qx - x[i]) * (qx - x[i]) + (qy - y[i]) * (qy - y[i]) < own)
            return 0;
    return 1;
}

/* All rays of the mask; returns their number. */
static double trace(const hada_camera *camera, const double *x, const double *y, double distance, const splat *s)
{
    const double magnification = 1.0 + camera->distance_mm / distance,
                 defocus = camera->mask == HADA_MASK_APERTURE
                               ? magnification
                               : magnification - camera->distance_mm / camera->focal_length_mm,
                 radius = camera->lens_diameter_mm / 2.0, pitch = camera->pixel_pitch_mm;
    int half = RAYS_ACROSS_LENS / 2;
    const double wanted = radius * fabs(defocus) / (RAY_STEP_PIXELS * pitch);
    if (wanted > half)
        half = wanted < 2000.0 ? (int)ceil(wanted) : 2000;
    const double step = radius / (half + 0.5);
    double rays = 0.0;
    for (int l = 0; l < camera->lenses; l++)
        for (int i = -half; i <= half; i++)
            for (int j = -half; j <= half; j++) {
                const double dy = i * step, dx = j * step;
                if (dx * dx + dy * dy > radius * radius || !belongs(camera, x, y, l, x[l] + dx, y[l] + dy))
                    continue;
                rays += 1.0;
                add_ray(s, s->rows / 2 + (y[l] * magnification + dy * defocus) / pitch,
                        s->cols / 2 + (x[l] * magnification + dx * defocus) / pitch);
            }
    return rays;
}

static hada_status trace_lenses(const hada_camera *camera, double distance_mm, int rows, int cols, double *sum,
                                hada_error *err)
{
    void *centres = NULL;
    hada_status status = HADA_OK;
    HADA_TRY(hada_alloc(&centres, (size_t)camera->lenses, 2 * sizeof(double), "the lens positions", err));
    double *x = centres, *y = x + camera->lenses;
    HADA_TRY(hada_camera_lenses(camera, x, y, err));
    const splat s = {sum, rows, cols, camera->blur_pixels, (int)ceil(6.0 * camera->blur_pixels) + 1};
    const double rays = trace(camera, x, y, distance_mm, &s);
    for (size_t i = 0; i < (size_t)rows * (size_t)cols; i++)
        sum[i] /= rays;
done:
    free(centres);
    return status;
}

hada_status hada_camera_psf_sized(const hada_camera *callers, double distance_mm, int rows, int cols, hada_image *psf,
                                  hada_error *err)
{
    hada_camera own, *camera = &own;
    double *sum = NULL;
    const size_t count = hada_size_product((size_t)rows, (size_t)cols);
    hada_status status = HADA_OK;
    *psf = (hada_image){0};
    HADA_TRY(hada_camera_take(camera, callers, err));
    if (!(distance_mm > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a distance of %g mm is not possible; it must be above 0",
                         distance_mm);
    HADA_TRY(hada_alloc((void **)&sum, count, sizeof *sum, "a point spread function", err));
    HADA_TRY(hada_image_create(psf, 1, rows, cols, err));
    HADA_TRY(hada_mask_has_lenses(camera) ? trace_lenses(camera, distance_mm, rows, cols, sum, err)
                                          : hada_psf_rays(camera, distance_mm, rows, cols, sum, err));
    float most = 0.0f;
    for (size_t i = 0; i < count; i++) {
        psf->data[i] = (float)sum[i];
        most = psf->data[i] > most ? psf->data[i] : most;
    }
    if (!(most > 0.0f))
        HADA_TRY(
            hada_fail(err, HADA_ERROR_ARGUMENT,
                      "no light of a point at %g mm reaches a sensor of %d x %d pixels; check the camera's lengths",
                      distance_mm, rows, cols));
done:
    free(sum);
    if (status)
        hada_image_destroy(psf);
    return status;
}

hada_status hada_camera_psf(const hada_camera *camera, double distance_mm, hada_image *psf, hada_error *err)
{
    return hada_camera_psf_sized(camera, distance_mm, camera->rows, camera->cols, psf, err);
}
