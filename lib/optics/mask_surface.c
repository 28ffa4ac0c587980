/* Smooth random surfaces, and their level lines. */

#include "core/callers.h"
#include "core/random.h"
#include "optics/mask.h"

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
    void *memory;
    HADA_TRY(
        hada_allocated(memory = hada_alloc((size_t)count * (size_t)count, sizeof(double), "a random surface", err)));
    *surface = (hada_surface){memory, count, -half_width - MARGIN * step, step};
    double *node = memory;
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

static int add_point(hada_contour *points, double x, double y)
{
    if (points->count == points->room) {
        const int room = points->room ? 2 * points->room : 4096;
        double *more_x = realloc(points->x, (size_t)room * sizeof(double));
        if (more_x)
            points->x = more_x;
        double *more_y = realloc(points->y, (size_t)room * sizeof(double));
        if (more_y)
            points->y = more_y;
        if (!more_x || !more_y)
            return 0;
        points->room = room;
    }
    points->x[points->count] = x;
    points->y[points->count++] = y;
    return 1;
}

/* Where the surface changes its sign between neighbours of a lattice, by the straight line between them. */
hada_status hada_contour_points(const hada_surface *surface, double half_width, double step,
                                const hada_monitor *monitor, hada_contour *out, hada_error *err)
{
    const int half = (int)floor(half_width / step), across = 2 * half + 1;
    hada_contour points = {0};
    void *memory = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(
        hada_allocated(memory = hada_alloc(2 * (size_t)across, sizeof(double), "rows of a random surface", err)));
    double *above = memory, *here = above + across;
    int room = 1;
    *out = points;
    for (int r = 0; r < across && room; r++) {
        HADA_TRY_OR_DONE(hada_monitor_check(monitor, err));
        const double at_y = (r - half) * step;
        for (int c = 0; c < across && room; c++) {
            const double at_x = (c - half) * step;
            here[c] = hada_surface_at(surface, at_x, at_y, NULL);
            if (c && (here[c - 1] < 0.0) != (here[c] < 0.0))
                room = add_point(&points, at_x - step * here[c] / (here[c] - here[c - 1]), at_y);
            if (r && room && (above[c] < 0.0) != (here[c] < 0.0))
                room = add_point(&points, at_x, at_y - step * here[c] / (here[c] - above[c]));
        }
        double *swap = above;
        above = here;
        here = swap;
    }
    if (!room)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory for contour lines"));
    if (!points.count)
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_ARGUMENT,
                      "the random landscape has no contour line in the aperture; use a smaller correlation "
                      "length or another seed"));
    *out = points;
    points = (hada_contour){0};
done:
    HADA_FREE(memory, points.x, points.y);
    return status;
}
