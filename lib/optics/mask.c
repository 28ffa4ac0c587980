/* Masks: what they do to light at a point. */
#include "optics/mask.h"

#include "core/random.h"

#define SCAN        512  /* points across the aperture, for bounds and pictures of the whole */
#define PATH_ERROR  1e-5 /* millimetres: a fiftieth of a wavelength, by points instead of lines */
#define LINE_POINTS 64   /* in a correlation length, at least */

static hada_status make_lenses(hada_mask_design *design, hada_error *err)
{
    const hada_camera *camera = &design->camera;
    void *x = NULL, *y = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(x = hada_alloc((size_t)camera->lenses, sizeof(double), "the lens positions", err)));
    HADA_TRY_OR_DONE(hada_allocated(y = hada_alloc((size_t)camera->lenses, sizeof(double), "the lens positions", err)));
    HADA_TRY_OR_DONE(hada_camera_lenses(camera, x, y, err));
    return hada_sites_make(&design->sites, x, y, camera->lenses, camera->aperture_mm / 2.0, err); /* takes x and y */
done:
    HADA_FREE(x, y);
    return status;
}

static hada_status make_diffuser(hada_mask_design *design, hada_error *err)
{
    const hada_camera *camera = &design->camera;
    const double half = camera->aperture_mm / 2.0;
    HADA_TRY(hada_surface_make(&design->surface, camera->seed, camera->correlation_mm, half, err));
    double squares = 0.0, gradient[2];
    for (int r = 0; r < SCAN; r++)
        for (int c = 0; c < SCAN; c++) {
            const double y = ((r + 0.5) / SCAN - 0.5) * 2.0 * half, x = ((c + 0.5) / SCAN - 0.5) * 2.0 * half;
            hada_surface_at(&design->surface, x, y, gradient);
            squares += gradient[0] * gradient[0] + gradient[1] * gradient[1];
        }
    design->height = camera->deflection_mrad * 1e-3 / sqrt(squares / (2.0 * SCAN * SCAN));
    /* second derivatives of a surface with autocorrelation exp(-r^2 / l^2): sqrt(6) / l times the slope; two of them */
    design->bend = 2.0 * sqrt(6.0) * camera->deflection_mrad * 1e-3 / camera->correlation_mm;
    return HADA_OK;
}

static hada_status make_contour(hada_mask_design *design, hada_error *err)
{
    const hada_camera *camera = &design->camera;
    const double half = camera->aperture_mm / 2.0;
    hada_surface landscape = {0};
    hada_contour points;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_surface_make(&landscape, camera->seed, camera->correlation_mm, half, err));
    /* points s apart instead of a line change a path of r^2 / 2f by s^2 / 8f */
    double step = fmin(camera->correlation_mm / LINE_POINTS, sqrt(8.0 * camera->focal_length_mm * PATH_ERROR));
    step = fmin(step, camera->pixel_pitch_mm / 4.0);
    step = fmax(step, camera->aperture_mm / 8192.0);
    HADA_TRY_OR_DONE(hada_contour_points(&landscape, half, step, design->monitor, &points, err));
    design->bend = 1.0 / camera->focal_length_mm;
    design->feature = fmin(camera->lens_diameter_mm, camera->aperture_mm);
    HADA_TRY_OR_DONE(hada_sites_make(&design->sites, points.x, points.y, points.count, half, err));
done:
    hada_surface_free(&landscape);
    return status;
}

static hada_status make_cells(hada_mask_design *design, hada_error *err)
{
    const hada_camera *camera = &design->camera;
    design->cells = (int)ceil(camera->aperture_mm / camera->cell_mm);
    design->feature = camera->cell_mm;
    void *memory;
    const size_t count = (size_t)design->cells * (size_t)design->cells;
    HADA_TRY(hada_allocated(memory = hada_alloc(count, 1, "the cells of a mask", err)));
    design->open = memory;
    hada_random random;
    hada_random_seed(&random, camera->seed, HADA_SEQUENCE_CELLS);
    for (size_t i = 0; i < count; i++)
        design->open[i] = hada_random_uniform(&random) < camera->open_fraction;
    return HADA_OK;
}

void hada_mask_find_bounds(hada_mask_design *design)
{
    const double half = design->camera.aperture_mm / 2.0;
    double most = 0.0, far = 0.0;
    for (int r = 0; r < SCAN; r++)
        for (int c = 0; c < SCAN; c++) {
            hada_mask_point point;
            hada_mask_at(design, ((c + 0.5) / SCAN - 0.5) * 2.0 * half, ((r + 0.5) / SCAN - 0.5) * 2.0 * half, &point);
            if (!(point.edge > 0.0))
                continue;
            most = fmax(most, point.slope[0] * point.slope[0] + point.slope[1] * point.slope[1]);
            far = fmax(far, point.square);
        }
    design->slope = sqrt(most);
    if (!design->sites.count)
        return;
    /* a point may lie between those of the scan */
    const double radius = design->camera.lens_diameter_mm / 2.0, gap = 2.0 * half / SCAN;
    design->reach = fmin(radius, sqrt(far) + gap);
    design->slope = hada_mask_power(&design->camera) * design->reach;
}

hada_status hada_mask_make(hada_mask_design *design, const hada_camera *callers, hada_error *err)
{
    return hada_mask_make_watched(design, callers, NULL, err);
}

hada_status hada_mask_make_watched(hada_mask_design *design, const hada_camera *callers, const hada_monitor *monitor,
                                   hada_error *err)
{
    *design = (hada_mask_design){.monitor = monitor};
    const hada_camera *camera = &design->camera;
    HADA_TRY(hada_camera_take(&design->camera, callers, err));
    if (hada_mask_has_lenses(camera)) {
        design->bend = hada_mask_power(camera);
        design->feature = fmin(camera->lens_diameter_mm, camera->aperture_mm);
        HADA_TRY(make_lenses(design, err));
    } else if (camera->mask == HADA_MASK_DIFFUSER)
        HADA_TRY(make_diffuser(design, err));
    else if (camera->mask == HADA_MASK_CONTOUR)
        HADA_TRY(make_contour(design, err));
    else
        HADA_TRY(make_cells(design, err));
    return HADA_OK;
}

void hada_mask_free(hada_mask_design *design)
{
    hada_surface_free(&design->surface);
    hada_sites_free(&design->sites);
    free(design->open);
    design->open = NULL;
}

static int cell_open(const hada_mask_design *design, int row, int col)
{
    return row >= 0 && col >= 0 && row < design->cells && col < design->cells &&
           design->open[(size_t)row * (size_t)design->cells + (size_t)col];
}

/* Distance to the nearest side of the cell behind which it is different. */
static double cell_edge(const hada_mask_design *design, double x, double y)
{
    const double size = design->camera.cell_mm, middle = design->cells / 2.0;
    const double across = x / size + middle, down = y / size + middle;
    const int col = (int)floor(across), row = (int)floor(down), open = cell_open(design, row, col);
    const double to[4] = {across - col, col + 1 - across, down - row, row + 1 - down};
    const int next[4] = {cell_open(design, row, col - 1), cell_open(design, row, col + 1),
                         cell_open(design, row - 1, col), cell_open(design, row + 1, col)};
    double nearest = 1.0;
    for (int i = 0; i < 4; i++)
        if (next[i] != open)
            nearest = fmin(nearest, to[i]);
    return (open ? nearest : -nearest) * size;
}

void hada_mask_at(const hada_mask_design *design, double x, double y, hada_mask_point *point)
{
    const hada_camera *camera = &design->camera;
    *point = (hada_mask_point){.edge = camera->aperture_mm / 2.0 - sqrt(x * x + y * y)};
    if (design->sites.count) {
        double square;
        const int i = hada_sites_nearest(&design->sites, x, y, &square);
        const double power = hada_mask_power(camera);
        point->edge = fmin(point->edge, camera->lens_diameter_mm / 2.0 - sqrt(square));
        point->square = square;
        point->path = -0.5 * power * square;
        point->slope[0] = -power * (x - design->sites.x[i]);
        point->slope[1] = -power * (y - design->sites.y[i]);
    } else if (design->open)
        point->edge = fmin(point->edge, cell_edge(design, x, y));
    else if (fabs(x) <= camera->aperture_mm / 2.0 && fabs(y) <= camera->aperture_mm / 2.0) {
        point->path = design->height * hada_surface_at(&design->surface, x, y, point->slope);
        point->slope[0] *= design->height;
        point->slope[1] *= design->height;
    }
}

hada_status hada_camera_set_mask(hada_camera *camera, hada_mask mask, hada_error *err)
{
    HADA_NEED(camera, err);
    if (!hada_enum_name(HADA_ENUM_MASK, (int)mask))
        return hada_fail(err, HADA_ERROR_UNSUPPORTED, "mask kind %d is not known; see hada_mask", (int)mask);
    if (mask == camera->mask)
        return HADA_OK;
    camera->mask = mask;
    if (mask == HADA_MASK_GRID) {
        camera->minimum_spacing_mm = camera->aperture_mm / (2.0 * hada_lattice_radius(camera->lenses) + 1.0);
        camera->maximum_spacing_mm = 0.0;
    } else if (mask == HADA_MASK_DIFFUSER) {
        camera->correlation_mm = camera->aperture_mm / 40.0;
        camera->deflection_mrad = 600.0 * camera->correlation_mm / camera->distance_mm;
    } else if (mask == HADA_MASK_CONTOUR)
        camera->correlation_mm = camera->aperture_mm / 12.0;
    else if (mask == HADA_MASK_APERTURE)
        camera->lens_diameter_mm = sqrt(2.44e-6 * camera->wavelengths_nm[1] * camera->distance_mm);
    return HADA_OK;
}

static double fill_of(const hada_mask_design *design)
{
    const double width = design->camera.aperture_mm, step = width / SCAN;
    double open = 0.0, all = 0.0;
    for (int r = 0; r < SCAN; r++)
        for (int c = 0; c < SCAN; c++) {
            const double y = (r + 0.5) * step - width / 2.0, x = (c + 0.5) * step - width / 2.0;
            const double inside = hada_mask_open(width / 2.0 - sqrt(x * x + y * y), step);
            hada_mask_point point;
            if (!(inside > 0.0))
                continue;
            hada_mask_at(design, x, y, &point);
            open += hada_mask_open(point.edge, step);
            all += inside;
        }
    return open / all;
}

hada_status hada_camera_fill_factor(const hada_camera *camera, double *fill, hada_error *err)
{
    HADA_NEED(camera && fill, err);
    hada_mask_design design;
    hada_status status = HADA_OK;
    *fill = 0.0;
    HADA_TRY_OR_DONE(hada_mask_make(&design, camera, err));
    *fill = fill_of(&design);
done:
    hada_mask_free(&design);
    return status;
}

/* By halving: a larger diameter lets more light through. */
hada_status hada_camera_set_fill_factor(hada_camera *camera, double fill, hada_error *err)
{
    HADA_NEED(camera, err);
    hada_mask_design design;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_mask_make(&design, camera, err));
    if (!design.sites.count)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT,
                                   "a mask of kind '%s' has no diameter that sets how much is open",
                                   hada_enum_name(HADA_ENUM_MASK, (int)camera->mask)));
    double low = 0.0, high = 2.0 * camera->aperture_mm, reached = 0.0;
    for (int i = 0; i < 24; i++) {
        design.camera.lens_diameter_mm = 0.5 * (low + high);
        reached = fill_of(&design);
        if (reached < fill)
            low = design.camera.lens_diameter_mm;
        else
            high = design.camera.lens_diameter_mm;
    }
    if (fabs(reached - fill) <= 1e-3 && fill > 0.0)
        camera->lens_diameter_mm = design.camera.lens_diameter_mm;
    else
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT,
                                   "no diameter lets a share of %g through; %g is as near as it gets", fill, reached));
done:
    hada_mask_free(&design);
    return status;
}

hada_status hada_camera_mask_map(const hada_camera *camera, int rows, int cols, hada_image *thickness_mm,
                                 hada_image *transmission, hada_error *err)
{
    HADA_NEED(camera, err);
    hada_mask_design design;
    hada_status status = HADA_OK;
    if (thickness_mm)
        *thickness_mm = (hada_image){0};
    if (transmission)
        *transmission = (hada_image){0};
    HADA_TRY_OR_DONE(hada_mask_make(&design, camera, err));
    HADA_TRY_OR_DONE(hada_mask_map(&design, rows, cols, thickness_mm, transmission, err));
done:
    hada_mask_free(&design);
    return status;
}

hada_status hada_mask_map(const hada_mask_design *design, int rows, int cols, hada_image *thickness_mm,
                          hada_image *transmission, hada_error *err)
{
    const hada_camera *camera = &design->camera;
    hada_image none = {0}, *thickness = thickness_mm ? thickness_mm : &none,
               *open = transmission ? transmission : &none;
    hada_status status = HADA_OK;
    *thickness = *open = (hada_image){0};
    if (thickness_mm)
        HADA_TRY_OR_DONE(hada_image_create(thickness, 1, rows, cols, err));
    if (transmission)
        HADA_TRY_OR_DONE(hada_image_create(open, 1, rows, cols, err));
    const double width = camera->aperture_mm, step = width / (rows > cols ? rows : cols);
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < cols; c++) {
            const size_t at = (size_t)r * (size_t)cols + (size_t)c;
            hada_mask_point point;
            hada_mask_at(design, ((c + 0.5) / cols - 0.5) * width, ((r + 0.5) / rows - 0.5) * width, &point);
            if (thickness_mm)
                thickness->data[at] = (float)(point.path / (camera->refractive_index - 1.0));
            if (transmission)
                open->data[at] = (float)hada_mask_open(point.edge, step);
        }
done:
    if (status) {
        hada_image_destroy(thickness);
        hada_image_destroy(open);
    }
    return status;
}
