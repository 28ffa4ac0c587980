#include "optics/occlusion.h"

#include "optics/mask.h"

#define PATCHES_MOST 64 /* across */

/* Square patches that meet the aperture. */
static void place_patches(hada_lenses *lenses, double aperture_mm)
{
    for (int i = 0; i < lenses->across; i++)
        for (int j = 0; j < lenses->across; j++) {
            const double y = (i + 0.5) * lenses->side - aperture_mm / 2.0,
                         x = (j + 0.5) * lenses->side - aperture_mm / 2.0, dx = fmax(fabs(x) - lenses->side / 2.0, 0.0),
                         dy = fmax(fabs(y) - lenses->side / 2.0, 0.0);
            if (dx * dx + dy * dy >= aperture_mm * aperture_mm / 4.0)
                continue;
            lenses->x[lenses->count] = x;
            lenses->y[lenses->count++] = y;
        }
}

hada_status hada_lenses_create(hada_lenses *lenses, const hada_camera *camera, double patch_mm,
                               const hada_monitor *monitor, hada_error *err)
{
    *lenses = (hada_lenses){0};
    const int whole = !hada_mask_has_lenses(camera);
    if (whole) {
        const double across = ceil(camera->aperture_mm / patch_mm);
        lenses->across = across < 1.0 ? 1 : across < PATCHES_MOST ? (int)across : PATCHES_MOST;
        lenses->side = camera->aperture_mm / lenses->across;
    }
    const size_t room = whole ? (size_t)lenses->across * (size_t)lenses->across : (size_t)camera->lenses;
    void *memory;
    HADA_TRY(hada_allocated(memory = hada_alloc(room, 2 * sizeof(double), "the lens positions", err)));
    lenses->x = memory;
    lenses->y = lenses->x + room;
    if (whole) {
        place_patches(lenses, camera->aperture_mm);
        HADA_TRY(hada_mask_make_watched(&lenses->design, camera, monitor, err));
    } else {
        lenses->count = camera->lenses;
        HADA_TRY(hada_camera_lenses(camera, lenses->x, lenses->y, err));
    }
    return HADA_OK;
}

void hada_lenses_destroy(hada_lenses *lenses)
{
    free(lenses->x);
    hada_mask_free(&lenses->design);
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

static int patch_outline(const hada_lenses *lenses, int patch, int half, double *x, double *y)
{
    const double step = lenses->side / (2 * half + 1);
    int count = 0;
    for (int i = -half; i <= half; i++)
        for (int j = -half; j <= half; j++) {
            hada_mask_point point;
            hada_mask_at(&lenses->design, lenses->x[patch] + j * step, lenses->y[patch] + i * step, &point);
            if (!(point.edge > 0.0))
                continue;
            x[count] = j * step;
            y[count++] = i * step;
        }
    if (!count) /* closed, but for less than a step */
        x[count] = y[count] = 0.0, count++;
    return count;
}

int hada_lens_outline(const hada_camera *camera, const hada_lenses *lenses, int lens, int half, double *x, double *y)
{
    if (lenses->side > 0.0)
        return patch_outline(lenses, lens, half, x, y);
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
