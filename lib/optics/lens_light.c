#include "optics/lens_light.h"

#include <stdlib.h>

#include "core/alloc.h"
#include "optics/mask.h"

hada_status hada_lenses_create(hada_lenses *lenses, const hada_camera *camera, hada_error *err)
{
    *lenses = (hada_lenses){0};
    if (!hada_mask_has_lenses(camera))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "what stands behind opaque objects is rendered lens by lens, and a mask of kind '%s' has no "
                         "lenses; use lenses or round holes",
                         hada_mask_word(camera->mask));
    void *memory;
    hada_status status = hada_alloc(&memory, (size_t)camera->lenses, 2 * sizeof(double), "the lens positions", err);
    if (status)
        return status;
    *lenses = (hada_lenses){camera->lenses, memory, (double *)memory + camera->lenses};
    if ((status = hada_camera_lenses(camera, lenses->x, lenses->y, err)))
        hada_lenses_destroy(lenses);
    return status;
}

void hada_lenses_destroy(hada_lenses *lenses)
{
    free(lenses->x);
    *lenses = (hada_lenses){0};
}

/* The lens whose centre, scaled, is nearest to a point; the first of equally near ones. */
static int nearest(const hada_lenses *lenses, double scale, double x, double y)
{
    int best = 0;
    double least = 0.0;
    for (int i = 0; i < lenses->count; i++) {
        const double dx = lenses->x[i] * scale - x, dy = lenses->y[i] * scale - y, square = dx * dx + dy * dy;
        if (!i || square < least)
            least = square, best = i;
    }
    return best;
}

void hada_lens_labels(const hada_camera *camera, const hada_lenses *lenses, double distance_mm, int rows, int cols,
                      double axis_row, double axis_col, int *labels)
{
    const double scale = hada_camera_magnification(camera, distance_mm) / camera->pixel_pitch_mm;
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < cols; c++)
            *labels++ = nearest(lenses, scale, c - axis_col, r - axis_row);
}

int hada_lens_outline(const hada_camera *camera, const hada_lenses *lenses, int lens, int half, double *x, double *y)
{
    const double radius = camera->lens_diameter_mm / 2.0, step = radius / (half + 0.5),
                 aperture = camera->aperture_mm / 2.0;
    int count = 0;
    for (int i = -half; i <= half; i++)
        for (int j = -half; j <= half; j++) {
            const double dx = j * step, dy = i * step, qx = lenses->x[lens] + dx, qy = lenses->y[lens] + dy;
            if (dx * dx + dy * dy > radius * radius || qx * qx + qy * qy > aperture * aperture ||
                ((i || j) && nearest(lenses, 1.0, qx, qy) != lens))
                continue;
            x[count] = dx;
            y[count++] = dy;
        }
    return count;
}
