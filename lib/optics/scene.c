/* Procedural scenes and regions: what to look at when there are no photographs. */
#include <hadalens/scene.h>
#include <hadalens/simulate.h>

#include "core/callers.h"
#include "core/random.h"

/* Surfaces that scenes lie on: depth as a share of the camera's range. */

#define SEQUENCE_RELIEF 5    /* of the generator: see core/random.h */
#define HILL_WIDTH      0.15 /* standard deviation of what smooths a hilly ground, of the shorter side */

/* What a seed changes; seed 0: the plain shape. */
typedef struct variation {
    double cosine, sine; /* of the direction in which depth changes */
    double row, col;     /* middle of the ball, from that of the window, in shorter sides */
    double square;       /* of its radius */
    double stairs, bars; /* in the window */
} variation;

static variation shape_of(uint64_t seed, hada_random *random)
{
    variation s = {.cosine = 1.0, .square = 0.2, .stairs = 5.0, .bars = 12.0};
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
static double depth_at(hada_relief_kind kind, const variation *s, double along, double y, double x)
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
    const variation s = shape_of(seed, &random);
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

#define SEQUENCE_SCENE   2 /* of the generator: see core/random.h */
#define SEQUENCE_REGIONS 3
#define SEQUENCE_NOISE   4

/* A value 0 to 1 for a lattice point: an integer hash (the finaliser of SplitMix64), so that noise has no period. */
static double lattice(uint64_t key, int row, int col)
{
    uint64_t z = key + (uint64_t)(uint32_t)row * 0x9e3779b97f4a7c15u + (uint64_t)(uint32_t)col * 0xc2b2ae3d27d4eb4fu;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return (double)((z ^ (z >> 31)) >> 11) * (1.0 / 9007199254740992.0);
}

/* Smooth noise with one lattice point every `cell` pixels, -1 to 1; row and column are not negative. */
static double smooth_noise(uint64_t key, double row, double col, double cell)
{
    const double y = row / cell, x = col / cell;
    const int i = (int)y, j = (int)x;
    const double fy = y - i, fx = x - j;
    const double v = fy * fy * (3.0 - 2.0 * fy), u = fx * fx * (3.0 - 2.0 * fx);
    const double top = lattice(key, i, j) * (1.0 - u) + lattice(key, i, j + 1) * u,
                 bottom = lattice(key, i + 1, j) * (1.0 - u) + lattice(key, i + 1, j + 1) * u;
    return 2.0 * (top * (1.0 - v) + bottom * v) - 1.0;
}

/* Noise with nearly the same power in every octave (an amplitude spectrum of about 1/f), as photographs have. */
static double natural_noise(uint64_t key, double row, double col, double largest)
{
    double sum = 0.0, amplitude = 1.0, total = 0.0;
    for (double cell = largest; cell >= 2.0; cell /= 2.0, amplitude *= 0.85, key += 0x632be59bd9b4e019u) {
        sum += amplitude * smooth_noise(key, row, col, cell);
        total += amplitude;
    }
    return total > 0.0 ? sum / total : 0.0;
}

typedef enum outline { ELLIPSE, RECTANGLE, RING, OUTLINES } outline;
typedef enum texture { PLAIN, STRIPES, CHECKS, DOTS, NOISY, TEXTURES } texture;

typedef struct shape {
    outline outline;
    texture texture;
    double row, col, half_rows, half_cols, cosine, sine;
    double period, contrast;
    double colour[3];
    uint64_t key;
} shape;

static shape random_shape(hada_random *random, int rows, int cols)
{
    const double extent = rows < cols ? rows : cols, angle = hada_random_range(random, 0.0, 3.14159265358979324);
    /* sizes spread evenly over octaves: a few large, many small */
    const double size = extent * 0.35 * pow(2.0, -hada_random_range(random, 0.0, 3.5));
    shape s = {.outline = (outline)hada_random_below(random, OUTLINES),
               .texture = (texture)hada_random_below(random, TEXTURES),
               .row = hada_random_range(random, 0.0, rows),
               .col = hada_random_range(random, 0.0, cols),
               .cosine = cos(angle),
               .sine = sin(angle)};
    s.half_rows = size * hada_random_range(random, 0.4, 1.0);
    s.half_cols = size;
    s.period = hada_random_range(random, 3.0, 16.0);
    s.contrast = hada_random_range(random, 0.3, 1.0);
    const double light = hada_random_range(random, 0.15, 1.0);
    for (int c = 0; c < 3; c++)
        s.colour[c] = light * hada_random_range(random, 0.35, 1.0);
    s.key = (uint64_t)hada_random_bits(random) << 32 | hada_random_bits(random);
    return s;
}

/* Whether the shape covers a point, and how bright its texture is there (0 to 1). */
static int shape_at(const shape *s, double row, double col, double *light)
{
    const double dy = row - s->row, dx = col - s->col;
    const double v = dy * s->cosine - dx * s->sine, u = dy * s->sine + dx * s->cosine;
    const double a = v / s->half_rows, b = u / s->half_cols, square = a * a + b * b;
    const int inside = s->outline == RECTANGLE ? fabs(a) <= 0.9 && fabs(b) <= 0.9
                                               : square <= 1.0 && (s->outline != RING || square >= 0.36);
    if (!inside)
        return 0;
    const double pv = v / s->period - floor(v / s->period), pu = u / s->period - floor(u / s->period);
    double wave = 1.0;
    switch (s->texture) {
    case STRIPES: wave = pu < 0.5; break;
    case CHECKS: wave = (pu < 0.5) == (pv < 0.5); break;
    case DOTS: wave = (pu - 0.5) * (pu - 0.5) + (pv - 0.5) * (pv - 0.5) < 0.1; break;
    case NOISY: wave = 0.5 + natural_noise(s->key, row, col, 16.0); break;
    default: break;
    }
    *light = 1.0 - s->contrast * (1.0 - wave);
    return 1;
}

hada_status hada_scene_procedural(hada_image *out, uint64_t seed, int channels, int rows, int cols, hada_error *err)
{
    HADA_NEED(out, err);
    *out = (hada_image){0};
    if (channels != 1 && channels != 3)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a scene of %d channels is not possible; use 1 or 3", channels);
    HADA_TRY(hada_image_create(out, channels, rows, cols, err));
    hada_random random;
    hada_random_seed(&random, seed, SEQUENCE_SCENE);
    enum { SHAPES = 48 };
    shape shapes[SHAPES];
    const int count = 24 + (int)hada_random_below(&random, SHAPES - 24 + 1);
    for (int i = 0; i < count; i++)
        shapes[i] = random_shape(&random, rows, cols);
    const double largest = (rows > cols ? rows : cols) / 2.0;
    double ground[3], tint[3];
    for (int c = 0; c < 3; c++) {
        ground[c] = hada_random_range(&random, 0.15, 0.55);
        tint[c] = hada_random_range(&random, 0.2, 0.6);
    }
    const uint64_t key = (uint64_t)hada_random_bits(&random) << 32 | hada_random_bits(&random);
    for (int r = 0; r < rows; r++)
        for (int k = 0; k < cols; k++) {
            double light = 1.0;
            const shape *front = NULL; /* the last one drawn is in front */
            for (int i = count - 1; i >= 0 && !front; i--)
                if (shape_at(&shapes[i], r, k, &light))
                    front = &shapes[i];
            const double common = natural_noise(key, r, k, largest);
            for (int c = 0; c < channels; c++) {
                /* a grey scene shows the green of the coloured one */
                const int colour = channels == 1 ? 1 : c;
                double value;
                if (front)
                    value = front->colour[colour] * light * (1.0 + 0.15 * common);
                else
                    value =
                        ground[colour] +
                        tint[colour] * (1.2 * common + 0.5 * natural_noise(key + 1 + (uint64_t)colour, r, k, largest));
                out->data[((size_t)c * (size_t)rows + (size_t)r) * (size_t)cols + (size_t)k] =
                    (float)fmin(fmax(value, 0.0), 1.0);
            }
        }
    return HADA_OK;
}

hada_status hada_scene_regions(int *labels, uint64_t seed, int regions, int rows, int cols, hada_error *err)
{
    HADA_NEED(labels, err);
    if (regions < 1 || rows < 1 || cols < 1 || (double)regions > (double)rows * cols)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%d regions in %d x %d pixels are not possible", regions, rows,
                         cols);
    int *places = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(places, 2 * (size_t)regions, "the regions", err));
    int *row = places, *col = row + regions;
    hada_random random;
    hada_random_seed(&random, seed, SEQUENCE_REGIONS);
    /* each centre is the farthest from the others of some darts: regions of similar size */
    for (int i = 0; i < regions; i++) {
        double best = -1.0;
        for (int dart = 0; dart < 24 || best <= 0.0; dart++) {
            const int r = (int)hada_random_below(&random, (uint32_t)rows),
                      k = (int)hada_random_below(&random, (uint32_t)cols);
            double nearest = INFINITY;
            for (int j = 0; j < i; j++)
                nearest = fmin(nearest, (double)(r - row[j]) * (r - row[j]) + (double)(k - col[j]) * (k - col[j]));
            if (nearest > best)
                best = nearest, row[i] = r, col[i] = k;
        }
    }
    const double largest = (rows < cols ? rows : cols) / 3.0, bend = largest / 2.0;
    const uint64_t key = (uint64_t)hada_random_bits(&random) << 32 | hada_random_bits(&random);
    for (int r = 0; r < rows; r++)
        for (int k = 0; k < cols; k++) {
            const double y = r + bend * smooth_noise(key, r, k, largest),
                         x = k + bend * smooth_noise(key + 1, r, k, largest);
            double best = INFINITY;
            for (int i = 0; i < regions; i++) {
                const double d = (y - row[i]) * (y - row[i]) + (x - col[i]) * (x - col[i]);
                if (d < best)
                    best = d, labels[(size_t)r * (size_t)cols + (size_t)k] = i;
            }
        }
    for (int i = 0; i < regions; i++)
        labels[(size_t)row[i] * (size_t)cols + (size_t)col[i]] = i;
done:
    free(places);
    return status;
}

hada_status hada_scene_part(hada_image *out, const hada_image *image, const int *labels, int label, hada_error *err)
{
    HADA_NEED(out && labels, err);
    HADA_NEED_IMAGE(image, out, err);
    HADA_TRY(hada_image_create(out, image->channels, image->rows, image->cols, err));
    const size_t pixels = (size_t)image->rows * (size_t)image->cols, count = hada_image_count(image);
    for (size_t i = 0; i < count; i++)
        if (labels[i % pixels] == label)
            out->data[i] = image->data[i];
    return HADA_OK;
}

void hada_image_add_noise(hada_image *image, double sigma, uint64_t seed)
{
    if (!image || !image->data || !isfinite(sigma))
        return;
    hada_random random;
    hada_random_seed(&random, seed, SEQUENCE_NOISE);
    const size_t count = hada_image_count(image);
    for (size_t i = 0; i < count; i++)
        image->data[i] = (float)(image->data[i] + sigma * hada_random_normal(&random));
}
