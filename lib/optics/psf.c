/* Point spread functions by geometric optics: the mask is sampled by rays, each of which lands as a small Gaussian
 * integrated over the pixels. */
#include <hadalens/camera.h>

#include "core/callers.h"
#include "image/pixels.h"
#include "optics/mask.h"

/* Point spread functions by rays of masks without lenses: each ray's light is shared among the four pixels round it,
 * and the whole is blurred afterwards. */

#define PATCH_STEP_PIXELS 0.35 /* between neighbours on the sensor, about, at most */
#define HALF_RAYS_MAX     4000 /* from the axis to the edge of the aperture */

/* Sharing a ray among pixels is a triangle of variance 1/6, where rays that land as Gaussians give s^2 + 1/12. The blur
 * that is left to do has variance s^2 - 1/12: a Gaussian integrated over pixels, or three values where it is small. */
static int blur_kernel(double sigma, double *kernel, int room)
{
    const double left = sigma * sigma - 1.0 / 12.0, narrow = left - 1.0 / 12.0;
    if (narrow < 0.04) {
        const double side = left > 0.0 ? left / 2.0 : 0.0;
        kernel[0] = 1.0 - 2.0 * side;
        kernel[1] = side;
        return 1;
    }
    const double scale = 1.0 / sqrt(2.0 * narrow);
    int reach = (int)ceil(6.0 * sqrt(narrow)) + 1;
    reach = reach < room ? reach : room - 1;
    for (int i = 0; i <= reach; i++)
        kernel[i] = 0.5 * (erf((i + 0.5) * scale) - erf((i - 0.5) * scale));
    return reach;
}

/* Along lines of `count` values, `stride` apart; what is beyond the ends is dark. */
static void blur_line(double *line, double *copy, int count, size_t stride, const double *kernel, int reach)
{
    for (int i = 0; i < count; i++)
        copy[i] = line[(size_t)i * stride];
    for (int i = 0; i < count; i++) {
        double sum = kernel[0] * copy[i];
        for (int k = 1; k <= reach; k++)
            sum += kernel[k] * ((i >= k ? copy[i - k] : 0.0) + (i + k < count ? copy[i + k] : 0.0));
        line[(size_t)i * stride] = sum;
    }
}

static void add_light(hada_rays *rays, double row, double col, double light)
{
    if (!(row >= 0.0 && col >= 0.0 && row < rays->rows - 1 && col < rays->cols - 1))
        return;
    const int r = (int)row, c = (int)col;
    const double down = row - r, across = col - c;
    double *at = rays->sum + (size_t)r * (size_t)rays->cols + (size_t)c;
    at[0] += light * (1.0 - down) * (1.0 - across);
    at[1] += light * (1.0 - down) * across;
    at += rays->cols;
    at[0] += light * down * (1.0 - across);
    at[1] += light * down * across;
    rays->top = r < rays->top ? r : rays->top;
    rays->left = c < rays->left ? c : rays->left;
    rays->bottom = r + 2 > rays->bottom ? r + 2 : rays->bottom;
    rays->right = c + 2 > rays->right ? c + 2 : rays->right;
}

hada_status hada_rays_make(hada_rays *rays, const hada_mask_design *design, double distance_mm, int rows, int cols,
                           double axis_row, double axis_col, hada_error *err)
{
    const hada_camera *camera = &design->camera;
    const double radius = camera->aperture_mm / 2.0;
    const double wanted = PATCH_STEP_PIXELS * camera->pixel_pitch_mm /
                          (hada_camera_magnification(camera, distance_mm) + camera->distance_mm * design->bend);
    *rays = (hada_rays){.design = design, .distance = distance_mm};
    rays->reach = blur_kernel(camera->blur_pixels, rays->kernel, HADA_RAYS_REACH);
    rays->margin = rays->reach + 1;
    rays->rows = rows + 2 * rays->margin;
    rays->cols = cols + 2 * rays->margin;
    rays->row0 = axis_row + rays->margin;
    rays->col0 = axis_col + rays->margin;
    rays->half = (int)fmin(ceil(radius / wanted), HALF_RAYS_MAX);
    rays->step = radius / rays->half;
    rays->top = rays->rows;
    rays->left = rays->cols;
    HADA_TRY(HADA_NEW(rays->sum, (size_t)rays->rows * (size_t)rays->cols, "a point spread function", err));
    return HADA_NEW(rays->line, (size_t)(rays->rows > rays->cols ? rays->rows : rays->cols), "a point spread function",
                    err);
}

void hada_rays_free(hada_rays *rays)
{
    HADA_FREE(rays->sum, rays->line);
    *rays = (hada_rays){0};
}

/* The first and the last ray that may lie in a stretch. */
static void ray_range(const hada_rays *rays, double low, double high, int *first, int *last)
{
    const double half = rays->half;
    *first = (int)fmax(-half, floor(fmax(low / rays->step, -half)) - 1.0);
    *last = (int)fmin(half, ceil(fmin(high / rays->step, half)) + 1.0);
}

hada_status hada_rays_trace(hada_rays *rays, const double low[2], const double high[2], double *all, hada_error *err)
{
    const hada_camera *camera = &rays->design->camera;
    const double d = camera->distance_mm, magnification = 1.0 + d / rays->distance, pitch = camera->pixel_pitch_mm;
    const double step = rays->step, radius = camera->aperture_mm / 2.0 + step;
    int first[2], last[2];
    *all = 0.0;
    for (int k = 0; k < 2; k++)
        ray_range(rays, low[k], high[k], &first[k], &last[k]);
    for (int i = first[1]; i <= last[1]; i++) {
        HADA_TRY(hada_monitor_check(rays->design->monitor, err));
        for (int j = first[0]; j <= last[0]; j++) {
            const double y = i * step, x = j * step;
            hada_mask_point point;
            if (x * x + y * y > radius * radius || !(x >= low[0] && x < high[0] && y >= low[1] && y < high[1]))
                continue;
            hada_mask_at(rays->design, x, y, &point);
            const double light = hada_mask_open(point.edge, step);
            if (!(light > 0.0))
                continue;
            *all += light;
            add_light(rays, rays->row0 + (y * magnification + d * point.slope[1]) / pitch,
                      rays->col0 + (x * magnification + d * point.slope[0]) / pitch, light);
        }
    }
    return HADA_OK;
}

/* A row or a column outwards, as far as it goes. */
static void widen(int *first, int *end, int by, int room)
{
    *first = *first > by ? *first - by : 0;
    *end = *end + by < room ? *end + by : room;
}

void hada_rays_blur(hada_rays *rays)
{
    const size_t pitch = (size_t)rays->cols;
    if (rays->top >= rays->bottom)
        return;
    widen(&rays->left, &rays->right, rays->reach, rays->cols);
    for (int r = rays->top; r < rays->bottom; r++)
        blur_line(rays->sum + (size_t)r * pitch + rays->left, rays->line, rays->right - rays->left, 1, rays->kernel,
                  rays->reach);
    widen(&rays->top, &rays->bottom, rays->reach, rays->rows);
    for (int c = rays->left; c < rays->right; c++)
        blur_line(rays->sum + (size_t)rays->top * pitch + c, rays->line, rays->bottom - rays->top, pitch, rays->kernel,
                  rays->reach);
}

void hada_rays_clear(hada_rays *rays)
{
    for (int r = rays->top; r < rays->bottom; r++)
        for (int c = rays->left; c < rays->right; c++)
            rays->sum[(size_t)r * (size_t)rays->cols + (size_t)c] = 0.0;
    rays->top = rays->rows;
    rays->left = rays->cols;
    rays->bottom = rays->right = 0;
}

/* PSF of a mask without lenses by rays: adds to `sum`, rows x cols, all rays making 1. */
static hada_status psf_rays(const hada_mask_design *design, double distance_mm, int rows, int cols, double *sum,
                            hada_error *err)
{
    static const double low[2] = {-HUGE_VAL, -HUGE_VAL}, high[2] = {HUGE_VAL, HUGE_VAL};
    hada_rays rays = {0};
    double all;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_rays_make(&rays, design, distance_mm, rows, cols, rows / 2, cols / 2, err));
    HADA_TRY_OR_DONE(hada_rays_trace(&rays, low, high, &all, err));
    hada_rays_blur(&rays);
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < cols; c++)
            sum[(size_t)r * (size_t)cols + (size_t)c] += hada_rays_at(&rays, r, c) / all;
done:
    hada_rays_free(&rays);
    return status;
}

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
                                                          : psf_rays(&design, distance_mm, rows, cols, sum, err));
    for (size_t i = 0; i < count; i++)
        psf->data[i] = (float)sum[i];
    if (!(hada_image_brightest(psf) > 0.0f))
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
