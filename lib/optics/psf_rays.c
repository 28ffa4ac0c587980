/* Point spread functions by rays of masks without lenses: each ray's light is shared among the four pixels round it,
 * and the whole is blurred afterwards. */
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "optics/mask.h"

#define RAY_STEP_PIXELS 0.35 /* between neighbours on the sensor, about, at most */
#define HALF_RAYS_MAX   4000 /* from the axis to the edge of the aperture */

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

typedef struct screen {
    double *sum;
    int rows, cols; /* with the margin from which light is blurred into the image */
} screen;

static void add_ray(const screen *s, double row, double col, double light)
{
    if (!(row >= 0.0 && col >= 0.0 && row < s->rows - 1 && col < s->cols - 1))
        return;
    const int r = (int)row, c = (int)col;
    const double down = row - r, across = col - c;
    double *at = s->sum + (size_t)r * (size_t)s->cols + (size_t)c;
    at[0] += light * (1.0 - down) * (1.0 - across);
    at[1] += light * (1.0 - down) * across;
    at += s->cols;
    at[0] += light * down * (1.0 - across);
    at[1] += light * down * across;
}

static double trace(const hada_mask_design *design, double distance, const screen *s, double row0, double col0)
{
    const hada_camera *camera = &design->camera;
    const double d = camera->distance_mm, magnification = 1.0 + d / distance, pitch = camera->pixel_pitch_mm;
    const double radius = camera->aperture_mm / 2.0;
    const double wanted = RAY_STEP_PIXELS * pitch / (magnification + d * design->bend);
    const int half = (int)fmin(ceil(radius / wanted), HALF_RAYS_MAX);
    const double step = radius / half;
    double all = 0.0;
    for (int i = -half; i <= half; i++)
        for (int j = -half; j <= half; j++) {
            const double y = i * step, x = j * step;
            hada_mask_point point;
            if (x * x + y * y > (radius + step) * (radius + step))
                continue;
            hada_mask_at(design, x, y, &point);
            const double light = hada_mask_open(point.edge, step);
            if (!(light > 0.0))
                continue;
            all += light;
            add_ray(s, row0 + (y * magnification + d * point.slope[1]) / pitch,
                    col0 + (x * magnification + d * point.slope[0]) / pitch, light);
        }
    return all;
}

hada_status hada_psf_rays(const hada_camera *camera, double distance_mm, int rows, int cols, double *sum,
                          hada_error *err)
{
    enum { ROOM = 400 };
    double kernel[ROOM];
    const int reach = blur_kernel(camera->blur_pixels, kernel, ROOM);
    const screen s = {NULL, rows + 2 * reach + 2, cols + 2 * reach + 2};
    const int longer = s.rows > s.cols ? s.rows : s.cols;
    hada_mask_design design;
    void *memory = NULL, *line = NULL;
    hada_status status = hada_mask_make(&design, camera, err);
    if (!status)
        status = hada_alloc(&memory, (size_t)s.rows * (size_t)s.cols, sizeof(double), "a point spread function", err);
    if (!status)
        status = hada_alloc(&line, (size_t)longer, sizeof(double), "a point spread function", err);
    if (!status) {
        const screen wide = {memory, s.rows, s.cols};
        const double all = trace(&design, distance_mm, &wide, rows / 2 + reach + 1, cols / 2 + reach + 1);
        for (int r = 0; r < s.rows; r++)
            blur_line(wide.sum + (size_t)r * (size_t)s.cols, line, s.cols, 1, kernel, reach);
        for (int c = 0; c < s.cols; c++)
            blur_line(wide.sum + c, line, s.rows, (size_t)s.cols, kernel, reach);
        for (int r = 0; r < rows; r++)
            for (int c = 0; c < cols; c++)
                sum[(size_t)r * (size_t)cols + (size_t)c] +=
                    wide.sum[(size_t)(r + reach + 1) * (size_t)s.cols + (size_t)(c + reach + 1)] / all;
    }
    free(memory);
    free(line);
    hada_mask_free(&design);
    return status;
}
