/* Procedural scenes and regions: what to look at when there are no photographs. */
#include <hadalens/scene.h>
#include <hadalens/simulate.h>

#include "core/base.h"
#include "core/random.h"

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
    void *places = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(places = hada_alloc((size_t)regions, 2 * sizeof(int), "the regions", err)));
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
    HADA_NEED(out && image && labels, err);
    HADA_TRY(hada_image_create(out, image->channels, image->rows, image->cols, err));
    const size_t pixels = (size_t)image->rows * (size_t)image->cols, count = hada_image_count(image);
    for (size_t i = 0; i < count; i++)
        if (labels[i % pixels] == label)
            out->data[i] = image->data[i];
    return HADA_OK;
}

void hada_image_add_noise(hada_image *image, double sigma, uint64_t seed)
{
    if (!image || !image->data)
        return;
    hada_random random;
    hada_random_seed(&random, seed, SEQUENCE_NOISE);
    const size_t count = hada_image_count(image);
    for (size_t i = 0; i < count; i++)
        image->data[i] = (float)(image->data[i] + sigma * hada_random_normal(&random));
}
