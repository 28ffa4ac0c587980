/* Surfaces that scenes lie on: depth as a share of the camera's range. */
#include <hadalens/scene.h>

#include "core/base.h"
#include "core/random.h"

#define SEQUENCE_RELIEF 5    /* of the generator: see core/random.h */
#define HILL_WIDTH      0.15 /* standard deviation of what smooths a hilly ground, of the shorter side */

/* What a seed changes; seed 0: the plain shape. */
typedef struct shape {
    double cosine, sine; /* of the direction in which depth changes */
    double row, col;     /* middle of the ball, from that of the window, in shorter sides */
    double square;       /* of its radius */
    double stairs, bars; /* in the window */
} shape;

static shape shape_of(uint64_t seed, hada_random *random)
{
    shape s = {.cosine = 1.0, .square = 0.2, .stairs = 5.0, .bars = 12.0};
    hada_random_seed(random, seed, SEQUENCE_RELIEF);
    if (!seed)
        return s;
    const double angle = hada_random_range(random, 0.0, 6.28318530717958648);
    s.cosine = cos(angle);
    s.sine = sin(angle);
    s.row = hada_random_range(random, -0.12, 0.12);
    s.col = hada_random_range(random, -0.12, 0.12);
    s.square = hada_random_range(random, 0.12, 0.2);
    s.stairs = 3.0 + hada_random_below(random, 4);
    s.bars = 9.0 + hada_random_below(random, 6);
    return s;
}

/* Depth at a place of the window, (y, x) in shorter sides from its middle; `along` goes from 0 to 1 in the shape's
 * direction. */
static double depth_at(hada_relief_kind kind, const shape *s, double along, double y, double x)
{
    const double r2 = (y - s->row) * (y - s->row) + (x - s->col) * (x - s->col);
    switch (kind) {
    case HADA_RELIEF_HALF: return 0.25 + 0.5 * along;
    case HADA_RELIEF_BALL: return r2 < s->square ? 0.75 - 0.6 * sqrt(1.0 - r2 / s->square) : 0.75;
    case HADA_RELIEF_STEPS: return fmin(floor(along * s->stairs), s->stairs - 1.0) / (s->stairs - 1.0) * 0.9 + 0.03;
    case HADA_RELIEF_BARS: return (int)floor(along * s->bars) % 3 == 0 ? 0.15 : 0.85;
    default: return along;
    }
}

static int mirrored(int at, int count)
{
    const int period = 2 * count, left = ((at % period) + period) % period;
    return left < count ? left : period - 1 - left;
}

/* Along rows (stride 1) or columns, mirrored at the edges. */
static void smooth(const double *in, double *out, int lines, int line_stride, int count, int stride,
                   const double *weight, int half)
{
    for (int l = 0; l < lines; l++)
        for (int i = 0; i < count; i++) {
            double sum = 0.0;
            for (int k = -half; k <= half; k++)
                sum += weight[k + half] *
                       in[(size_t)l * (size_t)line_stride + (size_t)mirrored(i + k, count) * (size_t)stride];
            out[(size_t)l * (size_t)line_stride + (size_t)i * (size_t)stride] = sum;
        }
}

/* Smoothed noise, from 0.1 to 0.9. */
static hada_status draw_hill(hada_image *out, hada_random *random, hada_error *err)
{
    const int rows = out->rows, cols = out->cols;
    const size_t count = hada_image_count(out);
    const double width = HILL_WIDTH * (rows < cols ? rows : cols);
    const int half = (int)ceil(4.0 * width);
    double *one = NULL, *two = NULL, *weight = NULL, sum = 0.0, least = INFINITY, most = -INFINITY;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(one, count, "a surface", err));
    HADA_TRY_OR_DONE(HADA_NEW(two, count, "a surface", err));
    HADA_TRY_OR_DONE(HADA_NEW(weight, 2 * (size_t)half + 1, "a surface", err));
    for (int k = -half; k <= half; k++)
        sum += weight[k + half] = exp(-0.5 * k * k / (width * width));
    for (int k = 0; k <= 2 * half; k++)
        weight[k] /= sum;
    for (size_t i = 0; i < count; i++)
        one[i] = hada_random_normal(random);
    smooth(one, two, rows, cols, cols, 1, weight, half);
    smooth(two, one, cols, 1, rows, cols, weight, half);
    for (size_t i = 0; i < count; i++) {
        least = fmin(least, one[i]);
        most = fmax(most, one[i]);
    }
    for (size_t i = 0; i < count; i++)
        out->data[i] = (float)(0.1 + 0.8 * (most > least ? (one[i] - least) / (most - least) : 0.5));
done:
    HADA_FREE(one, two, weight);
    return status;
}

hada_status hada_scene_relief(hada_image *out, hada_relief_kind kind, uint64_t seed, int rows, int cols,
                              hada_error *err)
{
    HADA_NEED(out, err);
    *out = (hada_image){0};
    if (!hada_enum_name(HADA_ENUM_RELIEF, (int)kind))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a surface of kind %d is not known; see hada_relief_kind",
                         (int)kind);
    hada_random random;
    const shape s = shape_of(seed, &random);
    const double side = rows < cols ? rows : cols;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_image_create(out, 1, rows, cols, err));
    if (kind == HADA_RELIEF_HILL)
        HADA_TRY_OR_DONE(draw_hill(out, &random, err));
    /* the plain half sinks downwards, all others to the right */
    const double down = kind == HADA_RELIEF_HALF ? s.cosine : s.sine,
                 right = kind == HADA_RELIEF_HALF ? -s.sine : s.cosine, extent = fabs(down) + fabs(right);
    for (int r = 0; r < rows && kind != HADA_RELIEF_HILL; r++)
        for (int c = 0; c < cols; c++) {
            const double v = rows > 1 ? r / (rows - 1.0) - 0.5 : 0.0, u = cols > 1 ? c / (cols - 1.0) - 0.5 : 0.0;
            const double along = fmin(fmax(0.5 + (down * v + right * u) / extent, 0.0), 1.0);
            out->data[(size_t)r * (size_t)cols + (size_t)c] =
                (float)depth_at(kind, &s, along, v * rows / side, u * cols / side);
        }
done:
    if (status)
        hada_image_destroy(out);
    return status;
}
