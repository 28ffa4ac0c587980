/* Where the lenses or holes of a mask are. */
#include <hadalens/camera.h>

#include "core/random.h"
#include "optics/mask.h"

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

/* The nodes of a square lattice nearest to the axis; 0 where they do not fit. */
static int lattice(const hada_camera *camera, double *x, double *y)
{
    enum { REACH = 40, ACROSS = 2 * REACH + 1 }; /* a disc of radius 40 has more than 4096 nodes */
    node *nodes = malloc(sizeof *nodes * ACROSS * ACROSS);
    if (!nodes)
        return -1;
    for (int i = 0; i < ACROSS * ACROSS; i++)
        nodes[i] = (node){i / ACROSS - REACH, i % ACROSS - REACH};
    qsort(nodes, ACROSS * ACROSS, sizeof *nodes, nearer);
    const double period = camera->minimum_spacing_mm, radius = (camera->aperture_mm - period) / 2.0;
    const node *last = &nodes[camera->lenses - 1];
    const double reach = period * sqrt((double)(last->row * last->row + last->col * last->col));
    for (int i = 0; i < camera->lenses; i++) {
        x[i] = nodes[i].col * period;
        y[i] = nodes[i].row * period;
    }
    free(nodes);
    return reach <= radius * (1.0 + 1e-12);
}

double hada_lattice_radius(int nodes)
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

static hada_status place_on_lattice(const hada_camera *camera, double *x_mm, double *y_mm, hada_error *err)
{
    const int fits = lattice(camera, x_mm, y_mm);
    if (fits < 0)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the lens positions");
    if (!fits)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "%d lenses on a grid of %g mm do not fit into an aperture of %g mm; use fewer lenses, a "
                         "smaller period or a larger aperture",
                         camera->lenses, camera->minimum_spacing_mm, camera->aperture_mm);
    return HADA_OK;
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
