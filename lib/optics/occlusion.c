/* What each lens makes of a PSF, and what it sees past nearer planes. */

#include "optics/occlusion.h"
#include "launch/optics_hide.h"

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
    HADA_TRY(HADA_NEW(lenses->x, 2 * room, "the lens positions", err));
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

/* Points of a lens's outline relative to its centre (mm), on a square grid of 2 half + 1 across its diameter: those
 * that are in the aperture and nearer to no other centre. Of a patch: those where the mask is open. `x` and `y` hold (2
 * half + 1)^2; returns how many. */
static int lens_outline(const hada_camera *camera, const hada_lenses *lenses, int lens, int half, double *x, double *y)
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

#define LOCAL         64 /* columns in a work-group */
#define OUTLINE_LEAST 4  /* points of the outline on either side of the middle, at least and at most */
#define OUTLINE_MOST  48

void hada_camera_parallax(const hada_camera *camera, double near_mm, double far_mm, double x_mm, double y_mm,
                          double *cols, double *rows)
{
    const double scale = camera->distance_mm * (1.0 / near_mm - 1.0 / far_mm) / camera->pixel_pitch_mm;
    *cols = x_mm * scale;
    *rows = y_mm * scale;
}

/* Two points for each pixel that the outline is wide on the nearer plane. */
static int outline_half(const hada_camera *camera, const hada_lenses *lenses, double near_mm, double far_mm)
{
    double wide, high;
    hada_camera_parallax(camera, near_mm, far_mm, lenses->side > 0.0 ? lenses->side : camera->lens_diameter_mm, 0.0,
                         &wide, &high);
    const double half = ceil(fabs(wide));
    return half < OUTLINE_LEAST ? OUTLINE_LEAST : half < OUTLINE_MOST ? (int)half : OUTLINE_MOST;
}

static void range(const double *value, int count, int *first, int *length)
{
    double least = value[0], most = value[0];
    for (int i = 1; i < count; i++) {
        least = fmin(least, value[i]);
        most = fmax(most, value[i]);
    }
    *first = (int)floor(least);
    *length = (int)floor(most) + 2 - *first;
}

/* Where the rays through the points of the outline meet the nearer plane: pixels from where they started. */
static void move_outline(const hada_camera *camera, const hada_lenses *lenses, int lens, double near_mm, double far_mm,
                         int count, double *x, double *y)
{
    for (int i = 0; i < count; i++) {
        double cols, rows;
        hada_camera_parallax(camera, near_mm, far_mm, lenses->x[lens] + x[i], lenses->y[lens] + y[i], &cols, &rows);
        x[i] = -cols;
        y[i] = -rows;
    }
}

/* Shares every ray out to four pixels. */
static hada_status share_out(hada_taps *taps, int count, const double *x, const double *y, hada_error *err)
{
    double *sums = NULL;
    const size_t size = hada_size_product((size_t)taps->rows, (size_t)taps->cols);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(sums, size, "the view of a lens", err));
    HADA_TRY_OR_DONE(HADA_NEW(taps->weight, size, "the view of a lens", err));
    for (int i = 0; i < count; i++) {
        const int r = (int)floor(y[i]), c = (int)floor(x[i]);
        const double fy = y[i] - r, fx = x[i] - c;
        double *at = sums + (size_t)(r - taps->row0) * (size_t)taps->cols + (c - taps->col0);
        at[0] += (1.0 - fy) * (1.0 - fx);
        at[1] += (1.0 - fy) * fx;
        at[taps->cols] += fy * (1.0 - fx);
        at[taps->cols + 1] += fy * fx;
    }
    for (size_t i = 0; i < size; i++)
        taps->weight[i] = (float)(sums[i] / count);
done:
    free(sums);
    return status;
}

hada_status hada_taps_create(hada_taps *taps, const hada_camera *camera, const hada_lenses *lenses, int lens,
                             double near_mm, double far_mm, hada_error *err)
{
    *taps = (hada_taps){0};
    const int half = outline_half(camera, lenses, near_mm, far_mm), room = (2 * half + 1) * (2 * half + 1);
    double *x = NULL, *y;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(x, 2 * (size_t)room, "the outline of a lens", err));
    y = x + room;
    const int count = lens_outline(camera, lenses, lens, half, x, y);
    move_outline(camera, lenses, lens, near_mm, far_mm, count, x, y);
    range(x, count, &taps->col0, &taps->cols);
    range(y, count, &taps->row0, &taps->rows);
    HADA_TRY_OR_DONE(share_out(taps, count, x, y, err));
done:
    free(x);
    return status;
}

void hada_taps_destroy(hada_taps *taps)
{
    free(taps->weight);
    *taps = (hada_taps){0};
}

hada_status hada_optics_hide(hada_slot *slot, cl_mem light, cl_mem seen, size_t seen_offset, cl_mem opacity,
                             size_t opacity_offset, cl_mem weights, const hada_taps *taps, int channels, int rows,
                             int cols, hada_error *err)
{
    const hada_optics_taps where = {taps->row0, taps->col0, taps->rows, taps->cols};
    const hada_optics_image image = {channels, rows, cols};
    const hada_range range = hada_range_of(hada_divide_up((size_t)cols, 8), LOCAL, (size_t)rows, 1);
    const double pixels = (double)rows * cols;
    hada_slot_cost(slot, pixels * (8.0 * channels + 4.0), pixels * (2.0 * taps->rows * taps->cols + channels));
    return hada_launch_optics_hide(slot, HADA_PROGRAM_OPTICS_HIDE_DEFAULT, &range, err, .light = light, .seen = seen,
                                   .seen_offset = seen_offset, .opacity = opacity, .opacity_offset = opacity_offset,
                                   .weights = weights, .taps = where, .image = image);
}
