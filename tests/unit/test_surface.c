/* Surfaces found from frames of a small camera: slants and balls, the sensor cropping or not, and what has no light. */
#include "dry.h"
#include "surface/level.h"
#include "testing.h"

enum { DEPTHS = 12, CHANNELS = 2, SPOTS = 29, WINDOW = 96, AREA = WINDOW * WINDOW, REACH = 6 };
#define SIGMA  0.9
#define MASK   22.0
#define RADIUS 56.0

/* A camera on the device and its law. */
typedef struct fixture {
    hada_context *context;
    hada_slot *slot;
    hada_spectrum_layout layout;
    hada_buffer otf, spectrum, pixels;
    hada_surface_camera camera;
    hada_surface_shape shape;
    hada_magnification law;
    hada_surface *surface;
    double spot[SPOTS][2];
    size_t grid; /* pixels */
} fixture;

/* What a surface is to be found from. */
#define FRAME(f) (&(hada_surface_frame){.spectrum = (f).spectrum.mem, .pixels = (f).pixels.mem})

static double distance_of(double depth)
{
    return 1.0 / (1.0 / 60.0 - 0.00115 * depth);
}

/* Adds a point's light of this depth to an image of the grid, which is periodic; the point is `y`, `x` from the axis.
 */
static void shine(const fixture *f, double depth, int channel, double light, int y, int x, float *image)
{
    const int rows = f->camera.rows, cols = f->camera.cols;
    const double scale =
        (1.0 + MASK / distance_of(depth)) / (1.0 + MASK / distance_of(DEPTHS / 2)) * (1.0 + 0.002 * channel);
    light /= SPOTS * 2.0 * 3.14159265358979 * SIGMA * SIGMA;
    for (int s = 0; s < SPOTS; s++) {
        const double at_y = scale * f->spot[s][0], at_x = scale * f->spot[s][1];
        const int row = (int)lrint(at_y), col = (int)lrint(at_x);
        double along[2 * REACH + 1];
        for (int j = -REACH; j <= REACH; j++)
            along[j + REACH] = exp(-(col + j - at_x) * (col + j - at_x) / (2.0 * SIGMA * SIGMA));
        for (int i = -REACH; i <= REACH; i++) {
            const double down = light * exp(-(row + i - at_y) * (row + i - at_y) / (2.0 * SIGMA * SIGMA));
            float *line = image + (size_t)((y + row + i + 2 * rows) % rows) * (size_t)cols;
            for (int j = -REACH; j <= REACH; j++)
                line[(x + col + j + 2 * cols) % cols] += (float)(down * along[j + REACH]);
        }
    }
}

/* The spectra of images of the grid. */
static void transform(fixture *f, const float *images, int count, hada_buffer *out, size_t first)
{
    const size_t bytes = (size_t)count * f->grid * sizeof *images;
    const hada_fft_desc desc = hada_fft_whole(HADA_FFT_FORWARD, f->camera.rows, f->camera.cols, count);
    SCOPED(hada_buffer) real;
    SCOPED(hada_fft) * plan;
    ASSERT_OK(hada_buffer_create_from(&real, f->slot, images, bytes, "images", err));
    ASSERT_OK(hada_fft_create(&plan, f->slot, &desc, err));
    ASSERT_OK(hada_fft_forward(plan, count, real.mem, 0, out->mem, first, err));
}

static void upload_camera(fixture *f)
{
    const int images = DEPTHS * CHANNELS;
    SCOPED_MEMORY float *psfs = calloc((size_t)images * f->grid, sizeof *psfs);
    ASSERT_OK(hada_buffer_create(&f->otf, f->context, (size_t)images * f->layout.count * 8, "the OTFs", err));
    for (int i = 0; i < images; i++)
        shine(f, i / CHANNELS, i % CHANNELS, 1.0, 0, 0, psfs + (size_t)i * f->grid);
    transform(f, psfs, images, &f->otf, 0);
}

/* rows x cols of the sensor; padded: it crops, else it is the grid. */
static void set_up(fixture *f, int rows, int cols, int padded)
{
    double distances[DEPTHS];
    hada_random random;
    *f = (fixture){0};
    hada_random_seed(&random, 11, 0);
    for (int s = 0; s < SPOTS;) {
        double nearest = HUGE_VAL;
        f->spot[s][0] = hada_random_range(&random, -RADIUS, RADIUS);
        f->spot[s][1] = hada_random_range(&random, -RADIUS, RADIUS);
        for (int i = 0; i < s; i++)
            nearest = fmin(nearest, hypot(f->spot[s][0] - f->spot[i][0], f->spot[s][1] - f->spot[i][1]));
        s += nearest > 11.0 && hypot(f->spot[s][0], f->spot[s][1]) < RADIUS;
    }
    for (int k = 0; k < DEPTHS; k++)
        distances[k] = distance_of(k);
    ASSERT_OK(hada_context_create(&f->context, NULL, err));
    ASSERT_OK(hada_slot_create(&f->slot, f->context, err));
    const int grid_rows = padded ? rows + WINDOW : rows, grid_cols = padded ? cols + WINDOW : cols;
    f->grid = (size_t)grid_rows * (size_t)grid_cols;
    f->layout = hada_surface_layout(f->context, grid_rows, grid_cols);
    f->camera = (hada_surface_camera){grid_rows, grid_cols, CHANNELS, DEPTHS, NULL, 0};
    f->shape = (hada_surface_shape){.frame = {(grid_rows - rows) / 2, (grid_cols - cols) / 2, rows, cols},
                                    .window = {(grid_rows - WINDOW) / 2, (grid_cols - WINDOW) / 2, WINDOW, WINDOW},
                                    .boundary = padded ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR};
    upload_camera(f);
    f->camera.otf = f->otf.mem;
    ASSERT_OK(hada_buffer_create(&f->spectrum, f->context, CHANNELS * f->layout.count * 8, "the frame", err));
    ASSERT_OK(hada_buffer_create(&f->pixels, f->context, (size_t)(CHANNELS * rows * cols) * 4, "the frame", err));
    ASSERT_OK(hada_magnification_measure(&f->law, f->slot, &f->camera, distances, err));
    ASSERT_OK(hada_surface_create(&f->surface, f->slot, &f->camera, &f->shape, &f->law, err));
}

static void tear_down(fixture *f)
{
    hada_surface_destroy(&f->surface);
    hada_magnification_free(&f->law);
    HADA_DESTROY_BUFFERS(&f->otf, &f->spectrum, &f->pixels);
    hada_slot_destroy(&f->slot);
    hada_context_destroy(&f->context);
}

/* Bright rectangles of every size on a grey ground, in each channel a little different. */
static void paint(double *scene)
{
    hada_random random;
    hada_random_seed(&random, 4, 0);
    for (int i = 0; i < CHANNELS * AREA; i++)
        scene[i] = 0.2;
    for (int k = 0; k < 300; k++) {
        const int h = 2 + (int)hada_random_below(&random, 12), w = 2 + (int)hada_random_below(&random, 12);
        const int y = (int)hada_random_below(&random, (uint32_t)(WINDOW - h)),
                  x = (int)hada_random_below(&random, (uint32_t)(WINDOW - w));
        const double light = hada_random_range(&random, 0.1, 1.0);
        for (int i = y; i < y + h; i++)
            for (int j = x; j < x + w; j++)
                for (int c = 0; c < CHANNELS; c++)
                    scene[c * AREA + i * WINDOW + j] = light * (1.0 - 0.3 * c);
    }
}

/* What the sensor sees of a scene at these depths, with 1 % noise. */
static void shoot(fixture *f, const double *scene, const double *depth)
{
    const int rows = f->camera.rows, cols = f->camera.cols;
    const hada_rectangle *w = &f->shape.window, *frame = &f->shape.frame;
    SCOPED_MEMORY float *images = calloc(CHANNELS * f->grid, sizeof *images),
                        *pixels = calloc(CHANNELS * f->grid, sizeof *pixels);
    float *to = pixels;
    hada_random random;
    hada_random_seed(&random, 9, 0);
    for (int c = 0; c < CHANNELS; c++) {
        float *image = images + (size_t)c * f->grid, top = 0.0F;
        for (int i = 0; i < AREA; i++)
            shine(f, depth[i], c, scene[c * AREA + i], w->row0 + i / WINDOW, w->col0 + i % WINDOW, image);
        for (size_t i = 0; i < f->grid; i++)
            top = fmaxf(top, image[i]);
        for (int y = 0; y < rows; y++)
            for (int x = 0; x < cols; x++) {
                float *pixel = image + (size_t)y * (size_t)cols + (size_t)x;
                const int seen = y >= frame->row0 && y < frame->row0 + frame->rows && x >= frame->col0 &&
                                 x < frame->col0 + frame->cols;
                *pixel = seen ? *pixel + (float)(0.01 * top * hada_random_normal(&random)) : 0.0F;
                if (seen)
                    *to++ = *pixel;
            }
    }
    transform(f, images, CHANNELS, &f->spectrum, 0);
    ASSERT_OK(hada_buffer_write(&f->pixels, f->slot, 0, pixels, f->pixels.bytes, err));
}

/* Bright and dark stripes over the frame, of which the camera knows nothing. */
static void shade(fixture *f, double part)
{
    const hada_rectangle *frame = &f->shape.frame;
    const size_t area = (size_t)frame->rows * (size_t)frame->cols;
    SCOPED_MEMORY float *pixels = calloc(CHANNELS * area, sizeof *pixels),
                        *images = calloc(CHANNELS * f->grid, sizeof *images);
    ASSERT_OK(hada_buffer_read(&f->pixels, f->slot, 0, pixels, CHANNELS * area * sizeof *pixels, err));
    for (int c = 0; c < CHANNELS; c++)
        for (int y = 0; y < frame->rows; y++)
            for (int x = 0; x < frame->cols; x++) {
                float *pixel = pixels + (size_t)c * area + (size_t)y * (size_t)frame->cols + (size_t)x;
                const size_t row = (size_t)(y + frame->row0), col = (size_t)(x + frame->col0);
                *pixel *= (float)(1.0 + part * sin(0.2 * x + 0.1 * y));
                images[(size_t)c * f->grid + row * (size_t)f->camera.cols + col] = *pixel;
            }
    transform(f, images, CHANNELS, &f->spectrum, 0);
    ASSERT_OK(hada_buffer_write(&f->pixels, f->slot, 0, pixels, CHANNELS * area * sizeof *pixels, err));
}

static double frame_energy(const fixture *f)
{
    const size_t values = CHANNELS * (size_t)f->shape.frame.rows * (size_t)f->shape.frame.cols;
    SCOPED_MEMORY float *pixels = calloc(values, sizeof *pixels);
    double sum = 0.0;
    ASSERT_OK(hada_buffer_read(&f->pixels, f->slot, 0, pixels, values * sizeof *pixels, err));
    for (size_t i = 0; i < values; i++)
        sum += (double)pixels[i] * pixels[i];
    return sum;
}

static float *read_texture(const fixture *f, const hada_surface_result *result)
{
    const hada_buffer view = {
        .context = f->context, .mem = result->texture, .bytes = CHANNELS * AREA * sizeof(float), .part = 1};
    float *texture = calloc(CHANNELS * AREA, sizeof *texture);
    ASSERT_OK(hada_buffer_read(&view, f->slot, 0, texture, CHANNELS * AREA * sizeof *texture, err));
    return texture;
}

/* Runs, and holds the depths' mean error and the texture's PSNR. */
static void find(fixture *f, const double *scene, const double *depth, double error, double psnr)
{
    hada_surface_result result;
    double apart = 0.0, square = 0.0, close = 0.0;
    DEFAULTS(hada_surface_rule, rule);
    shoot(f, scene, depth);
    ASSERT_OK(hada_surface_run(f->surface, FRAME(*f), &rule, &result, err));
    SCOPED_MEMORY float *texture = read_texture(f, &result);
    assert_int_equal(result.rows, WINDOW);
    assert_int_equal(result.cols, WINDOW);
    for (int i = 0; i < AREA; i++) {
        assert_true(result.depth[i] >= 0.0F && result.depth[i] <= DEPTHS - 1);
        assert_true(result.confidence[i] >= 0.0F && result.confidence[i] <= 1.0F);
        apart += fabs(result.depth[i] - depth[i]) / AREA;
        close += fabs(result.depth[i] - depth[i]) < 0.5 ? 1.0 / AREA : 0.0;
    }
    for (int i = 0; i < CHANNELS * AREA; i++)
        square += (texture[i] - scene[i]) * (texture[i] - scene[i]) / (CHANNELS * AREA);
    if (apart > error || -10.0 * log10(square) < psnr || close < 0.9)
        fail_msg("depth error %.3f, %.3f within half, %.2f dB", apart, close, -10.0 * log10(square));
}

static void slant(double *depth)
{
    for (int i = 0; i < AREA; i++)
        depth[i] = 0.5 + (DEPTHS - 2.0) * (i % WINDOW) / (WINDOW - 1.0);
}

static void ball(double *depth)
{
    for (int i = 0; i < AREA; i++) {
        const double y = (i / WINDOW - 48.0) / 40.0, x = (i % WINDOW - 48.0) / 40.0, r = y * y + x * x;
        depth[i] = r < 1.0 ? 8.0 - 6.0 * sqrt(1.0 - r) : 8.0;
    }
}

static double scene[CHANNELS * AREA], depth[AREA];

TEST(test_cropped)
{
    fixture f;
    set_up(&f, 180, 216, 1);
    paint(scene);
    slant(depth);
    find(&f, scene, depth, 0.3, 23.5);
    ball(depth);
    find(&f, scene, depth, 0.3, 23.5);
    tear_down(&f);
}

/* Surfaces beyond the camera's depths are reported as unknown; those between them are not. */
TEST(test_outside)
{
    hada_surface_result result;
    double beyond = 0.0, said = 0.0, within = 0.0, wrong = 0.0;
    fixture f;
    set_up(&f, 180, 216, 1);
    DEFAULTS(hada_surface_rule, rule);
    paint(scene);
    for (int i = 0; i < AREA; i++)
        depth[i] = -1.2 + (DEPTHS + 1.4) * (i % WINDOW) / (WINDOW - 1.0);
    shoot(&f, scene, depth);
    ASSERT_OK(hada_surface_run(f.surface, FRAME(f), &rule, &result, err));
    for (int i = 0; i < AREA; i++) {
        const int far = depth[i] < -0.7 || depth[i] > DEPTHS - 0.3, near = depth[i] > 0.0 && depth[i] < DEPTHS - 1;
        beyond += far;
        said += far && result.outside[i];
        within += near;
        wrong += near && result.outside[i];
        assert_true(result.depth[i] >= 0.0F && result.depth[i] <= DEPTHS - 1);
    }
    if (said < 0.6 * beyond || wrong > 0.03 * within)
        fail_msg("%.0f of %.0f pixels beyond are known as such, %.0f of %.0f within are taken for such", said, beyond,
                 wrong, within);
    tear_down(&f);
}

TEST(test_circular)
{
    fixture f;
    set_up(&f, 216, 240, 0);
    paint(scene);
    slant(depth);
    find(&f, scene, depth, 0.3, 23.5);
    tear_down(&f);
}

/* Sizes that are no round numbers, memory that is known before, the same bits whatever was before, no light. */
TEST(test_objects)
{
    fixture f;
    hada_surface_result result;
    set_up(&f, 185, 219, 1);
    DEFAULTS(hada_surface_rule, rule);
    hada_surface_destroy(&f.surface);
    const uint64_t before = hada_context_bytes(f.context);
    ASSERT_OK(hada_surface_create(&f.surface, f.slot, &f.camera, &f.shape, &f.law, err));
    ASSERT_DRY(hada_context_bytes(f.context) - before, f.context, hada_surface,
               hada_surface_create(&object, &dry.slot, &f.camera, &f.shape, &f.law, NULL), hada_surface_destroy);
    paint(scene);
    slant(depth);
    find(&f, scene, depth, 0.3, 23.5);
    ASSERT_OK(hada_surface_run(f.surface, FRAME(f), &rule, &result, err));
    float *first = read_texture(&f, &result), kept = result.depth[AREA / 3];
    assert_int_equal(result.levels, 3);
    assert_true(result.energy[0] > 0.0 && result.energy[2] > 0.0);
    hada_buffer_clear(&f.spectrum, f.slot, 0, f.spectrum.bytes, NULL);
    hada_buffer_clear(&f.pixels, f.slot, 0, f.pixels.bytes, NULL);
    ASSERT_OK(hada_surface_run(f.surface, FRAME(f), &rule, &result, err));
    float *dark = read_texture(&f, &result);
    for (int i = 0; i < AREA; i++)
        assert_true(dark[i] == 0.0F && result.confidence[i] == 0.0F);
    shoot(&f, scene, depth);
    ASSERT_OK(hada_surface_run(f.surface, FRAME(f), &rule, &result, err));
    float *again = read_texture(&f, &result);
    assert_memory_equal(first, again, CHANNELS * AREA * sizeof *first);
    assert_true(kept == result.depth[AREA / 3]);
    HADA_FREE(first, dark, again);
    tear_down(&f);
}

/* A device that has not so much memory in one piece: transfer functions in several buffers, the same bits. */
TEST(test_pieces)
{
    fixture f;
    hada_surface_result result;
    set_up(&f, 180, 216, 1);
    DEFAULTS(hada_surface_rule, rule);
    uint64_t *largest = &f.context->info.max_allocation_bytes;
    const uint64_t before = *largest, plane = (uint64_t)f.layout.count * CHANNELS * 8;
    paint(scene);
    ball(depth);
    shoot(&f, scene, depth);
    ASSERT_OK(hada_surface_run(f.surface, FRAME(f), &rule, &result, err));
    SCOPED_MEMORY float *whole = read_texture(&f, &result), *depths = calloc(AREA, sizeof *depths);
    memcpy(depths, result.depth, AREA * sizeof *depths);
    hada_surface_destroy(&f.surface);
    const uint64_t held = hada_context_bytes(f.context);
    *largest = 5 * plane;
    ASSERT_OK(hada_surface_create(&f.surface, f.slot, &f.camera, &f.shape, &f.law, err));
    assert_true(hada_context_bytes(f.context) - held > 2 * *largest);
    ASSERT_DRY(hada_context_bytes(f.context) - held, f.context, hada_surface,
               hada_surface_create(&object, &dry.slot, &f.camera, &f.shape, &f.law, NULL), hada_surface_destroy);
    ASSERT_OK(hada_surface_run(f.surface, FRAME(f), &rule, &result, err));
    SCOPED_MEMORY float *pieces = read_texture(&f, &result);
    assert_memory_equal(whole, pieces, CHANNELS * AREA * sizeof *whole);
    assert_memory_equal(depths, result.depth, AREA * sizeof *depths);
    /* not one plane */
    hada_surface_destroy(&f.surface);
    *largest = plane - 1;
    ASSERT_FAILS(hada_surface_create(&f.surface, f.slot, &f.camera, &f.shape, &f.law, err), HADA_ERROR_DEVICE_MEMORY,
                 "in one piece");
    *largest = before;
    tear_down(&f);
}

/* Weights of pixels: all 1 they leave as much as none; the light of pixels with weight 0, which is wrong, is not
 * fitted; saturated pixels are reached, and what others leave stays what it was. */
TEST(test_weights)
{
    fixture f;
    hada_surface_result result;
    set_up(&f, 180, 216, 1);
    DEFAULTS(hada_surface_rule, rule);
    hada_surface_destroy(&f.surface);
    f.shape.weighs = 1;
    ASSERT_OK(hada_surface_create(&f.surface, f.slot, &f.camera, &f.shape, &f.law, err));
    paint(scene);
    slant(depth);
    shoot(&f, scene, depth);
    const size_t values = f.pixels.bytes / sizeof(float);
    SCOPED_MEMORY float *weights = malloc(f.pixels.bytes), *pixels = malloc(f.pixels.bytes),
                        *sorted = malloc(f.pixels.bytes);
    for (size_t i = 0; i < values; i++)
        weights[i] = 1.0F;
    hada_buffer buffer;
    ASSERT_OK(hada_buffer_create_from(&buffer, f.slot, weights, f.pixels.bytes, "weights", err));
    hada_surface_frame frame = *FRAME(f);
    ASSERT_OK(hada_surface_run(f.surface, &frame, &rule, &result, err));
    const hada_surface_result without = result;
    const double left = without.energy[without.levels - 1];
    frame.weights = buffer.mem;
    ASSERT_OK(hada_surface_run(f.surface, &frame, &rule, &result, err));
    for (int l = 0; l + 1 < result.levels; l++) /* which have no weights */
        assert_true(result.energy[l] == without.energy[l]);
    const double ones = result.energy[result.levels - 1]; /* whose steps are shorter */
    if (fabs(ones - left) > 0.05 * left)
        fail_msg("%.3e is left, with weights of 1 %.3e", left, ones);
    /* the brightest tenth is cut off where the whole resolution sees it */
    ASSERT_OK(hada_buffer_read(&f.pixels, f.slot, 0, sorted, f.pixels.bytes, err));
    memcpy(pixels, sorted, f.pixels.bytes);
    qsort(sorted, values, sizeof *sorted, ascending_floats);
    const float most = sorted[values - values / 10];
    SCOPED_MEMORY float *cut = malloc(f.pixels.bytes);
    for (size_t i = 0; i < values; i++) {
        cut[i] = fminf(pixels[i], most);
        weights[i] = pixels[i] < most ? 1.0F : -1.0F;
    }
    ASSERT_OK(hada_buffer_write(&f.pixels, f.slot, 0, cut, f.pixels.bytes, err));
    ASSERT_OK(hada_buffer_write(&buffer, f.slot, 0, weights, f.pixels.bytes, err));
    ASSERT_OK(hada_surface_run(f.surface, &frame, &rule, &result, err));
    const double reached = result.energy[result.levels - 1];
    if (reached > 1.1 * left)
        fail_msg("%.3e is left, with saturated values %.3e", left, reached);
    for (size_t i = 0; i < values; i++)
        weights[i] = 1.0F;
    /* every tenth value is wrong where the whole resolution sees it; the coarse levels have it right */
    for (size_t i = 0; i < values; i += 10) {
        pixels[i] = 0.0F;
        weights[i] = 0.0F;
    }
    ASSERT_OK(hada_buffer_write(&f.pixels, f.slot, 0, pixels, f.pixels.bytes, err));
    ASSERT_OK(hada_surface_run(f.surface, FRAME(f), &rule, &result, err));
    const double taken = result.energy[result.levels - 1];
    ASSERT_OK(hada_buffer_write(&buffer, f.slot, 0, weights, f.pixels.bytes, err));
    ASSERT_OK(hada_surface_run(f.surface, &frame, &rule, &result, err));
    const double left_out = result.energy[result.levels - 1];
    if (left_out > 1.1 * left || taken < 4.0 * left)
        fail_msg("%.3e is left; with wrong values taken %.3e, left out %.3e", left, taken, left_out);
    hada_buffer_destroy(&buffer);
    tear_down(&f);
}

/* A try that is in vain ends at its first level, where the camera does not explain the frame; one that is just enough
 * goes to its end, with the bits of one that nobody limits. */
TEST(test_in_vain)
{
    fixture f;
    hada_surface_rule rule, limited;
    hada_surface_result result;
    set_up(&f, 180, 216, 1);
    hada_surface_rule_init(&rule);
    limited = rule;
    paint(scene);
    for (int spoilt = 0; spoilt < 2; spoilt++) {
        (spoilt ? slant : ball)(depth);
        shoot(&f, scene, depth);
        if (spoilt)
            shade(&f, 0.6);
        ASSERT_OK(hada_surface_run(f.surface, FRAME(f), &rule, &result, err));
        assert_false(result.in_vain);
        const double left = result.energy[result.levels - 1];
        SCOPED_MEMORY float *texture = read_texture(&f, &result), *depths = calloc(AREA, sizeof *depths);
        memcpy(depths, result.depth, AREA * sizeof *depths);
        limited.frame = frame_energy(&f);
        limited.enough = left / 3.0;
        ASSERT_OK(hada_surface_run(f.surface, FRAME(f), &limited, &result, err));
        if (spoilt != result.in_vain)
            fail_msg("%s: %.3e is left of %.3e, and the level says %d", spoilt ? "spoilt" : "a ball", left,
                     limited.frame, result.in_vain);
        assert_true(!spoilt || (result.energy[0] > 0.0 && result.energy[1] == 0.0));
        limited.enough = left;
        ASSERT_OK(hada_surface_run(f.surface, FRAME(f), &limited, &result, err));
        assert_false(result.in_vain);
        SCOPED_MEMORY float *again = read_texture(&f, &result);
        assert_true(left == result.energy[result.levels - 1]);
        assert_memory_equal(texture, again, CHANNELS * AREA * sizeof *texture);
        assert_memory_equal(depths, result.depth, AREA * sizeof *depths);
    }
    tear_down(&f);
}

/* Levels: by how far light moves, down to windows that are too small; planes between depths that lie far apart. */
TEST(test_levels)
{
    hada_surface_plan plans[HADA_SURFACE_LEVELS];
    fixture f;
    set_up(&f, 180, 216, 1);
    assert_int_equal(hada_surface_levels(f.context, &f.camera, &f.shape, &f.law, plans), 3);
    assert_true(plans[0].shrink == 4.0 && plans[1].shrink == 2.0 && plans[2].whole);
    assert_true(plans[0].shape.free && plans[1].shape.free && !plans[2].shape.free);
    assert_int_equal(plans[0].steps, 1);
    assert_int_equal(plans[2].steps, (int)ceil(f.law.shift / 0.6));
    /* one depth more at either end */
    assert_int_equal(plans[2].before, 1);
    assert_int_equal(plans[2].shape.planes, (DEPTHS + 1) * plans[2].steps + 1);
    f.law.kind = HADA_MAGNIFICATION_NONE;
    const int levels = hada_surface_levels(f.context, &f.camera, &f.shape, &f.law, plans);
    const hada_surface_plan *last = &plans[levels - 1];
    assert_true(last->before == 0 && last->shape.planes == (DEPTHS - 1) * last->steps + 1);
    f.law.kind = HADA_MAGNIFICATION_LAW;
    assert_int_equal(hada_surface_levels(f.context, &f.camera, &f.shape, &f.law, plans), 3);
    /* a window's pixel keeps its place, within the coarse window's margin */
    const hada_map_place place = hada_surface_level_place(&plans[2], &plans[0]);
    assert_true(place.row >= 2.0 && place.row < 4.0 && fabs(place.down - 0.25) < 0.01);
    f.shape.window.rows = 40;
    assert_int_equal(hada_surface_levels(f.context, &f.camera, &f.shape, &f.law, plans), 2);
    assert_true(plans[0].whole && plans[0].shape.free && plans[1].whole && !plans[1].shape.free);
    tear_down(&f);
}
