/* Masks: what they do to light at a point. */

#include "optics/mask.h"
#include "core/callers.h"
#include "core/random.h"

/* The nearest of many points, found by buckets. */

#define BUCKETS_MOST 512 /* a side */

static int bucket_of(const hada_sites *sites, double position)
{
    return hada_within((int)((position + sites->half) / sites->size), sites->buckets);
}

static int bucket_at(const hada_sites *sites, int i)
{
    return bucket_of(sites, sites->y[i]) * sites->buckets + bucket_of(sites, sites->x[i]);
}

/* Sites by buckets: counting sort, from the last to the first, so that a bucket's keep their order. */
static hada_status sort(hada_sites *sites, hada_error *err)
{
    const size_t all = (size_t)sites->buckets * (size_t)sites->buckets;
    HADA_TRY(HADA_NEW(sites->first, all + 1, "places of a mask", err));
    HADA_TRY(HADA_NEW(sites->order, (size_t)sites->count, "places of a mask", err));
    for (int i = 0; i < sites->count; i++)
        sites->first[bucket_at(sites, i)]++;
    for (size_t k = 1; k <= all; k++)
        sites->first[k] += sites->first[k - 1];
    for (int i = sites->count - 1; i >= 0; i--)
        sites->order[--sites->first[bucket_at(sites, i)]] = i;
    return HADA_OK;
}

void hada_sites_free(hada_sites *sites)
{
    HADA_FREE(sites->x, sites->y, sites->first, sites->order);
    *sites = (hada_sites){0};
}

typedef struct search {
    double x, y, square;
    int best;
} search;

static void look(const hada_sites *sites, int row, int col, search *s)
{
    if (row < 0 || col < 0 || row >= sites->buckets || col >= sites->buckets)
        return;
    const int bucket = row * sites->buckets + col;
    for (int k = sites->first[bucket]; k < sites->first[bucket + 1]; k++) {
        const int i = sites->order[k];
        const double dx = s->x - sites->x[i], dy = s->y - sites->y[i], square = dx * dx + dy * dy;
        if (square < s->square || (square == s->square && i < s->best)) {
            s->square = square;
            s->best = i;
        }
    }
}

/* Rings of buckets round the point's own, until none nearer can be left. */
static double nearest_square(const hada_sites *sites, double x, double y)
{
    search s = {x, y, HUGE_VAL, -1};
    const int row = bucket_of(sites, y), col = bucket_of(sites, x);
    for (int ring = 0; ring <= sites->buckets; ring++) {
        const double free_of_sites = (ring - 1) * sites->size;
        if (ring > 1 && free_of_sites * free_of_sites > s.square)
            break;
        for (int i = -ring; i <= ring; i++) {
            const int whole = i == -ring || i == ring;
            for (int j = -ring; j <= ring; j += whole || !ring ? 1 : 2 * ring)
                look(sites, row + i, col + j, &s);
        }
    }
    return s.square;
}

/* The sites that may be nearest to a point of a bucket: none is farther from its middle than the nearest, and the
 * bucket's diagonal. Counts them, and writes them where there is room. */
static int candidates(const hada_sites *sites, int row, int col, int *to)
{
    const double x = (col + 0.5) * sites->size - sites->half, y = (row + 0.5) * sites->size - sites->half;
    const double limit = sqrt(nearest_square(sites, x, y)) + 1.4143 * sites->size;
    const int low_row = bucket_of(sites, y - limit), high_row = bucket_of(sites, y + limit),
              low_col = bucket_of(sites, x - limit), high_col = bucket_of(sites, x + limit);
    int count = 0;
    for (int r = low_row; r <= high_row; r++)
        for (int c = low_col; c <= high_col; c++)
            for (int k = sites->first[r * sites->buckets + c]; k < sites->first[r * sites->buckets + c + 1]; k++) {
                const int i = sites->order[k];
                const double dx = sites->x[i] - x, dy = sites->y[i] - y;
                if (dx * dx + dy * dy > limit * limit)
                    continue;
                if (to)
                    to[count] = i;
                count++;
            }
    return count;
}

/* From the sites in each bucket to those that matter to it, which a search then goes through. */
static hada_status replace_by_candidates(hada_sites *sites, hada_error *err)
{
    const int all = sites->buckets * sites->buckets;
    int *first = NULL, *order = NULL, *kept;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(first, (size_t)all + 1, "places of a mask", err));
    for (int b = 0; b < all; b++)
        first[b + 1] = first[b] + candidates(sites, b / sites->buckets, b % sites->buckets, NULL);
    HADA_TRY_OR_DONE(HADA_NEW(order, (size_t)first[all], "places of a mask", err));
    for (int b = 0; b < all; b++)
        candidates(sites, b / sites->buckets, b % sites->buckets, order + first[b]);
    kept = sites->first, sites->first = first, first = kept;
    kept = sites->order, sites->order = order, order = kept;
done: /* the old lists, or new ones that failed */
    HADA_FREE(first, order);
    return status;
}

hada_status hada_sites_make(hada_sites *sites, double *x, double *y, int count, double half_width, hada_error *err)
{
    /* a little wider, so that points that round to its border lie inside */
    *sites = (hada_sites){.x = x, .y = y, .count = count, .half = 1.02 * half_width};
    sites->buckets = (int)ceil(sqrt((double)count));
    sites->buckets = sites->buckets < BUCKETS_MOST ? sites->buckets : BUCKETS_MOST;
    sites->size = 2.0 * sites->half / sites->buckets;
    HADA_TRY(sort(sites, err));
    return replace_by_candidates(sites, err);
}

int hada_sites_nearest(const hada_sites *sites, double x, double y, double *square)
{
    search s = {x, y, HUGE_VAL, -1};
    if (fabs(x) <= sites->half && fabs(y) <= sites->half)
        look(sites, bucket_of(sites, y), bucket_of(sites, x), &s);
    else /* no bucket's: all of them */
        for (int b = 0; b < sites->buckets * sites->buckets; b++)
            look(sites, b / sites->buckets, b % sites->buckets, &s);
    *square = s.square;
    return s.best;
}

/* Smooth random surfaces, and their level lines. */

/* White noise on a lattice of `step`, smoothed by [1 2 1]/4 SMOOTHINGS times (variance step^2 / 2 each) and
 * interpolated by cubic B-splines (variance step^2 / 3). A kernel of variance s^2 gives the autocorrelation
 * exp(-r^2 / 4 s^2), so l = 2 s. */
#define SMOOTHINGS 7
#define MARGIN     (SMOOTHINGS + 3) /* nodes beyond the square, on either side */

/* Along one axis; `stride` from node to node. The ends are lost: they lie in the margin. */
static void smooth_line(double *line, int count, int stride)
{
    double before = line[0];
    for (int i = 1; i + 1 < count; i++) {
        double *at = line + (size_t)i * (size_t)stride;
        const double here = *at;
        *at = 0.25 * (before + 2.0 * here + at[stride]);
        before = here;
    }
}

hada_status hada_surface_make(hada_surface *surface, uint64_t seed, double correlation, double half_width,
                              hada_error *err)
{
    *surface = (hada_surface){0};
    const double step = correlation / (2.0 * sqrt(SMOOTHINGS / 2.0 + 1.0 / 3.0));
    const int inside = (int)ceil(2.0 * half_width / step) + 1, count = inside + 2 * MARGIN;
    double *node;
    HADA_TRY(HADA_NEW(node, (size_t)count * (size_t)count, "a random surface", err));
    *surface = (hada_surface){node, count, -half_width - MARGIN * step, step};
    const size_t nodes = (size_t)count * (size_t)count;
    hada_random random;
    hada_random_seed(&random, seed, HADA_SEQUENCE_SURFACE);
    for (size_t i = 0; i < nodes; i++)
        node[i] = hada_random_normal(&random);
    for (int pass = 0; pass < SMOOTHINGS; pass++)
        for (int i = 0; i < count; i++) {
            smooth_line(node + (size_t)i * (size_t)count, count, 1);
            smooth_line(node + i, count, count);
        }
    double sum = 0.0, squares = 0.0;
    for (int r = MARGIN; r < count - MARGIN; r++)
        for (int c = MARGIN; c < count - MARGIN; c++) {
            const double value = node[(size_t)r * (size_t)count + (size_t)c];
            sum += value;
            squares += value * value;
        }
    const double number = (double)inside * inside, mean = sum / number;
    const double scale = 1.0 / sqrt(squares / number - mean * mean);
    for (size_t i = 0; i < nodes; i++)
        node[i] = (node[i] - mean) * scale;
    return HADA_OK;
}

void hada_surface_free(hada_surface *surface)
{
    free(surface->node);
    *surface = (hada_surface){0};
}

/* The four cubic B-splines that reach a point at 0 <= t < 1 after its node, and their derivatives. */
static void splines(double t, double value[4], double derivative[4])
{
    const double u = 1.0 - t;
    value[0] = u * u * u / 6.0;
    value[1] = (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0;
    value[2] = (4.0 - 6.0 * u * u + 3.0 * u * u * u) / 6.0;
    value[3] = t * t * t / 6.0;
    derivative[0] = -0.5 * u * u;
    derivative[1] = 1.5 * t * t - 2.0 * t;
    derivative[2] = 2.0 * u - 1.5 * u * u;
    derivative[3] = 0.5 * t * t;
}

double hada_surface_at(const hada_surface *surface, double x, double y, double gradient[2])
{
    const double across = (x - surface->origin) / surface->step, down = (y - surface->origin) / surface->step;
    const int col = (int)floor(across), row = (int)floor(down);
    double bx[4], dx[4], by[4], dy[4], value = 0.0, gx = 0.0, gy = 0.0;
    splines(across - col, bx, dx);
    splines(down - row, by, dy);
    for (int i = 0; i < 4; i++) {
        const double *node = surface->node + (size_t)(row + i - 1) * (size_t)surface->count + (size_t)(col - 1);
        const double line = bx[0] * node[0] + bx[1] * node[1] + bx[2] * node[2] + bx[3] * node[3];
        value += by[i] * line;
        gy += dy[i] * line;
        gx += by[i] * (dx[0] * node[0] + dx[1] * node[1] + dx[2] * node[2] + dx[3] * node[3]);
    }
    if (gradient) {
        gradient[0] = gx / surface->step;
        gradient[1] = gy / surface->step;
    }
    return value;
}

static hada_status add_point(hada_contour *points, double x, double y, hada_error *err)
{
    HADA_TRY(HADA_GROW(points->x, (size_t)points->count, 1, "contour lines", err));
    HADA_TRY(HADA_GROW(points->y, (size_t)points->count, 1, "contour lines", err));
    points->x[points->count] = x;
    points->y[points->count++] = y;
    return HADA_OK;
}

/* Where the surface changes its sign between neighbours of a lattice, by the straight line between them. */
static hada_status contour_points(const hada_surface *surface, double half_width, double step,
                                  const hada_monitor *monitor, hada_contour *out, hada_error *err)
{
    const int half = (int)floor(half_width / step), across = 2 * half + 1;
    hada_contour points = {0};
    double *rows = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(rows, 2 * (size_t)across, "rows of a random surface", err));
    double *above = rows, *here = rows + across;
    *out = points;
    for (int r = 0; r < across; r++) {
        HADA_TRY_OR_DONE(hada_monitor_check(monitor, err));
        const double at_y = (r - half) * step;
        for (int c = 0; c < across; c++) {
            const double at_x = (c - half) * step;
            here[c] = hada_surface_at(surface, at_x, at_y, NULL);
            if (c && (here[c - 1] < 0.0) != (here[c] < 0.0))
                HADA_TRY_OR_DONE(add_point(&points, at_x - step * here[c] / (here[c] - here[c - 1]), at_y, err));
            if (r && (above[c] < 0.0) != (here[c] < 0.0))
                HADA_TRY_OR_DONE(add_point(&points, at_x, at_y - step * here[c] / (here[c] - above[c]), err));
        }
        double *swap = above;
        above = here;
        here = swap;
    }
    if (!points.count)
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_ARGUMENT,
                      "the random landscape has no contour line in the aperture; use a smaller correlation "
                      "length or another seed"));
    *out = points;
    points = (hada_contour){0};
done:
    HADA_FREE(rows, points.x, points.y);
    return status;
}

/* Where the lenses or holes of a mask are. */

/* Full darts thrown again from the start, and darts for one lens, before the lenses are said not to fit. */
#define PLACEMENTS 64
#define DARTS      4000
/* Spacings looked at in all placements, a second or two: where lenses fit, far fewer are. */
#define LOOKS 1e9

/* A point spread evenly over a disc, drawn from the square round it. */
static void dart(hada_random *random, double radius, double *x, double *y)
{
    do {
        *x = hada_random_range(random, -radius, radius);
        *y = hada_random_range(random, -radius, radius);
    } while (*x * *x + *y * *y > radius * radius);
}

/* Whether the i-th centre keeps the bounds of spacing to those before it. */
static int keeps(const hada_camera *camera, const double *x, const double *y, int i)
{
    const double least = camera->minimum_spacing_mm, most = camera->maximum_spacing_mm;
    int near = !i || !(most > 0.0);
    for (int j = 0; j < i; j++) {
        const double dx = x[i] - x[j], dy = y[i] - y[j], square = dx * dx + dy * dy;
        if (square < least * least)
            return 0;
        near |= square <= most * most;
    }
    return near;
}

static int place(const hada_camera *camera, hada_random *random, double *x, double *y, double *looks)
{
    const double radius = (camera->aperture_mm - camera->minimum_spacing_mm) / 2.0;
    for (int i = 0; i < camera->lenses; i++) {
        int darts = 0, fits = 0;
        while (!fits && darts++ < DARTS && *looks < LOOKS) {
            *looks += i;
            dart(random, radius, &x[i], &y[i]);
            fits = keeps(camera, x, y, i);
        }
        if (!fits)
            return 0;
    }
    return 1;
}

typedef struct node {
    int row, col;
} node;

/* By distance from the axis, then row by row. */
static int nearer(const void *a, const void *b)
{
    const node *m = a, *n = b;
    const int one = m->row * m->row + m->col * m->col, other = n->row * n->row + n->col * n->col;
    return one != other ? (one > other) - (one < other) : m->row != n->row ? m->row - n->row : m->col - n->col;
}

/* The nodes of a square lattice nearest to the axis. */
static hada_status place_on_lattice(const hada_camera *camera, double *x_mm, double *y_mm, hada_error *err)
{
    enum { REACH = 40, ACROSS = 2 * REACH + 1 }; /* a disc of radius 40 has more than 4096 nodes */
    node *nodes;
    HADA_TRY(HADA_NEW(nodes, (size_t)ACROSS * ACROSS, "the lens positions", err));
    for (int i = 0; i < ACROSS * ACROSS; i++)
        nodes[i] = (node){i / ACROSS - REACH, i % ACROSS - REACH};
    qsort(nodes, ACROSS * ACROSS, sizeof *nodes, nearer);
    const double period = camera->minimum_spacing_mm, radius = (camera->aperture_mm - period) / 2.0;
    const node *last = &nodes[camera->lenses - 1];
    const double reach = period * sqrt((double)(last->row * last->row + last->col * last->col));
    for (int i = 0; i < camera->lenses; i++) {
        x_mm[i] = nodes[i].col * period;
        y_mm[i] = nodes[i].row * period;
    }
    free(nodes);
    if (!(reach <= radius * (1.0 + 1e-12)))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "%d lenses on a grid of %g mm do not fit into an aperture of %g mm; use fewer lenses, a "
                         "smaller period or a larger aperture",
                         camera->lenses, period, camera->aperture_mm);
    return HADA_OK;
}

/* How far from the axis the outermost of a square lattice's nodes nearest to it is, in periods. */
static double lattice_radius(int nodes)
{
    for (int square = 0;; square++) {
        const int reach = (int)sqrt((double)square);
        int inside = 0;
        for (int i = -reach; i <= reach; i++)
            for (int j = -reach; j <= reach; j++)
                inside += i * i + j * j <= square;
        if (inside >= nodes)
            return sqrt((double)square);
    }
}

static hada_status place_at_random(const hada_camera *camera, double *x_mm, double *y_mm, hada_error *err)
{
    hada_random random;
    hada_random_seed(&random, camera->seed, HADA_SEQUENCE_LENSES);
    double looks = 0.0;
    for (int attempt = 0; attempt < PLACEMENTS && looks < LOOKS; attempt++)
        if (place(camera, &random, x_mm, y_mm, &looks))
            return HADA_OK;
    return hada_fail(err, HADA_ERROR_ARGUMENT,
                     "%d lenses at least %g mm apart do not fit at random into an aperture of %g mm%s; use fewer "
                     "lenses, a smaller spacing (about %.3g mm) or a larger aperture",
                     camera->lenses, camera->minimum_spacing_mm, camera->aperture_mm,
                     camera->maximum_spacing_mm > 0.0 ? " with the greatest spacing asked for" : "",
                     0.6 * camera->aperture_mm / sqrt(camera->lenses));
}

hada_status hada_camera_lenses(const hada_camera *callers, double *x_mm, double *y_mm, hada_error *err)
{
    HADA_NEED(callers && x_mm && y_mm, err);
    hada_camera own, *camera = &own;
    HADA_TRY(hada_camera_take(camera, callers, err));
    if (!hada_mask_has_lenses(camera))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a mask of kind '%s' has no lenses",
                         hada_enum_name(HADA_ENUM_MASK, (int)camera->mask));
    return camera->mask == HADA_MASK_GRID ? place_on_lattice(camera, x_mm, y_mm, err)
                                          : place_at_random(camera, x_mm, y_mm, err);
}

#define SCAN        512  /* points across the aperture, for bounds and pictures of the whole */
#define PATH_ERROR  1e-5 /* millimetres: a fiftieth of a wavelength, by points instead of lines */
#define LINE_POINTS 64   /* in a correlation length, at least */

static hada_status make_lenses(hada_mask_design *design, hada_error *err)
{
    const hada_camera *camera = &design->camera;
    double *x = NULL, *y = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(x, (size_t)camera->lenses, "the lens positions", err));
    HADA_TRY_OR_DONE(HADA_NEW(y, (size_t)camera->lenses, "the lens positions", err));
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
    HADA_TRY_OR_DONE(contour_points(&landscape, half, step, design->monitor, &points, err));
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
    const size_t count = (size_t)design->cells * (size_t)design->cells;
    HADA_TRY(HADA_NEW(design->open, count, "the cells of a mask", err));
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
        camera->minimum_spacing_mm = camera->aperture_mm / (2.0 * lattice_radius(camera->lenses) + 1.0);
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
