/* Optics between depths: the law of magnification found from PSFs, and transfer functions made by it. */
#include "filter/bank.h"
#include "ref/ref_fft.h"
#include "ref/ref_surface.h"
#include "surface/magnification.h"
#include "testing.h"

enum {
    ROWS = 96,
    COLS = 128,
    PIXELS = ROWS * COLS,
    VALUES = ROWS * (COLS / 2 + 1),
    DEPTHS = 6,
    SPOTS = 23,
    CHANNELS = 2
};
#define SIGMA 0.8
#define MASK  15.0
/* Spots so narrow are aliased by 2.7 % each, the two that are blended and the one that they are compared with: the
 * pixels do not know them better. */
#define EXACT 0.06

static double spot_y[SPOTS], spot_x[SPOTS];

/* Spots within a circle of 40 pixels. */
static void place_spots(void)
{
    hada_random random;
    hada_random_seed(&random, 5, 0);
    for (int i = 0; i < SPOTS; i++)
        do {
            spot_y[i] = hada_random_range(&random, -40.0, 40.0);
            spot_x[i] = hada_random_range(&random, -40.0, 40.0);
        } while (hypot(spot_y[i], spot_x[i]) > 40.0);
}

/* Light moves about 1.1 pixels between neighbours at 47 pixels from the axis. */
static double distance_of(double depth)
{
    return 1.0 / (1.0 / 60.0 - 0.0019 * depth);
}

/* The target of a pattern magnified about a point: spots of the same width, each channel 0.2 % larger. */
static void expose(double scale, double row, double col, int channel, double noise, unsigned seed, double *psf)
{
    hada_random random;
    double sum = 0.0;
    hada_random_seed(&random, seed, 1);
    scale *= 1.0 + 0.002 * channel;
    for (int i = 0; i < PIXELS; i++) {
        const int y = i / COLS, x = i % COLS;
        psf[i] = 0.0;
        for (int s = 0; s < SPOTS; s++) {
            const double dy = (y < ROWS / 2 ? y : y - ROWS) - row - scale * spot_y[s];
            const double dx = (x < COLS / 2 ? x : x - COLS) - col - scale * spot_x[s];
            if (fabs(dy) < 6.0 && fabs(dx) < 6.0)
                psf[i] += exp(-(dy * dy + dx * dx) / (2.0 * SIGMA * SIGMA));
        }
        sum += psf[i];
    }
    for (int i = 0; i < PIXELS; i++)
        psf[i] = psf[i] / sum + noise / sum * hada_random_normal(&random);
}

/* A camera on the device; scale and place of each depth's pattern. */
typedef struct fixture {
    hada_context *context;
    hada_slot *slot;
    hada_spectrum_layout layout;
    hada_buffer otf, made;
    hada_surface_camera camera;
    hada_magnification law;
    double distances[DEPTHS];
    double *spectra; /* [depth][channel][VALUES] complex */
} fixture;

static size_t spectrum_at(int depth, int channel)
{
    return 2 * VALUES * (size_t)(depth * CHANNELS + channel);
}

typedef double scale_at(double depth);

static double pinhole(double depth)
{
    return 1.0 + MASK / distance_of(depth);
}

static void set_up(fixture *f, scale_at *scale, double col, double noise)
{
    *f = (fixture){0};
    place_spots();
    ASSERT_OK(hada_context_create(&f->context, NULL, err));
    ASSERT_OK(hada_slot_create(&f->slot, f->context, err));
    f->layout = hada_surface_layout(f->context, ROWS, COLS);
    const size_t image = 2 * f->layout.count, images = DEPTHS * CHANNELS;
    SCOPED_MEMORY double *psf = calloc(PIXELS, sizeof *psf);
    SCOPED_MEMORY float *rows = calloc(VALUES, 2 * sizeof *rows), *packed = calloc(images, image * sizeof *packed);
    f->spectra = calloc(images * VALUES, 2 * sizeof *f->spectra);
    assert_true(psf && rows && packed && f->spectra);
    for (int k = 0; k < DEPTHS; k++) {
        f->distances[k] = distance_of(k);
        for (int c = 0; c < CHANNELS; c++) {
            double *spectrum = f->spectra + spectrum_at(k, c);
            expose(scale(k), 0.0, col / f->distances[k], c, noise, (unsigned)(k * CHANNELS + c), psf);
            ASSERT_OK(hada_ref_fft_forward(psf, ROWS, COLS, spectrum, err));
            for (size_t i = 0; i < 2 * VALUES; i++)
                rows[i] = (float)spectrum[i];
            hada_layout_pack(&f->layout, rows, packed + image * (size_t)(k * CHANNELS + c));
        }
    }
    ASSERT_OK(hada_buffer_create_from(&f->otf, f->slot, packed, images * image * sizeof *packed, "the OTFs", err));
    ASSERT_OK(hada_buffer_create(&f->made, f->context, images * image * sizeof *packed, "the OTFs", err));
    f->camera = (hada_surface_camera){ROWS, COLS, CHANNELS, DEPTHS, f->otf.mem, 0};
    ASSERT_OK(hada_magnification_measure(&f->law, f->slot, &f->camera, f->distances, err));
}

static void tear_down(fixture *f)
{
    hada_magnification_free(&f->law);
    HADA_DESTROY_BUFFERS(&f->otf, &f->made);
    hada_slot_destroy(&f->slot);
    hada_context_destroy(&f->context);
    free(f->spectra);
}

/* What was made last of a depth and channel, row-major. */
static float *read_made(fixture *f, int place, int channel)
{
    const size_t bytes = 2 * f->layout.count * sizeof(float);
    float *blocks = malloc(bytes), *rows = calloc(VALUES, 2 * sizeof *rows);
    ASSERT_OK(hada_buffer_read(&f->made, f->slot, (size_t)(place * CHANNELS + channel) * bytes, blocks, bytes, err));
    hada_layout_unpack(&f->layout, blocks, rows);
    free(blocks);
    return rows;
}

/* |a - b| / |b| over half spectra. */
static double apart(const float *a, const double *b)
{
    double square = 0.0, all = 0.0;
    for (size_t i = 0; i < 2 * VALUES; i++) {
        const size_t kx = i / 2 % (COLS / 2 + 1);
        const double often = kx == 0 || kx == COLS / 2 ? 1.0 : 2.0;
        square += often * (a[i] - b[i]) * (a[i] - b[i]);
        all += often * b[i] * b[i];
    }
    return sqrt(square / all);
}

/* The same of what is made at a depth and its exact transfer function. */
static double made_apart(fixture *f, double depth, int channel)
{
    hada_between *between;
    SCOPED_MEMORY double *psf = calloc(PIXELS, sizeof *psf), *spectrum = calloc(VALUES, 2 * sizeof *spectrum);
    ASSERT_OK(hada_between_create(&between, f->slot, &f->camera, &f->law, err));
    ASSERT_OK(hada_between_make(between, 1, &depth, f->made.mem, 0, NULL, err));
    SCOPED_MEMORY float *made = read_made(f, 0, channel);
    expose(pinhole(depth), 0.0, f->law.col > 1.0 ? 60.0 / distance_of(depth) : 0.0, channel, 0.0, 0, psf);
    ASSERT_OK(hada_ref_fft_forward(psf, ROWS, COLS, spectrum, err));
    const double error = apart(made, spectrum);
    hada_between_destroy(&between);
    return error;
}

TEST(test_law)
{
    fixture f;
    set_up(&f, pinhole, 0.0, 0.0);
    assert_int_equal(f.law.kind, HADA_MAGNIFICATION_LAW);
    assert_true(fabs(f.law.mask - MASK) < 0.01 * MASK);
    assert_true(fabs(f.law.row) < 3.0 && fabs(f.law.col) < 3.0);
    assert_true(f.law.edge > 36.0 && f.law.edge < 52.0);
    assert_true(f.law.unexplained[HADA_MAGNIFICATION_LAW] < 0.08);
    assert_true(f.law.unexplained[HADA_MAGNIFICATION_NONE] > 0.25);
    assert_int_equal(hada_magnification_steps(&f.law, 2.0 * f.law.shift), 1);
    assert_int_equal(hada_magnification_steps(&f.law, 0.26 * f.law.shift), 4);
    for (int c = 0; c < CHANNELS; c++) {
        assert_true(made_apart(&f, 0.5, c) < EXACT);
        assert_true(made_apart(&f, 3.25, c) < EXACT);
        assert_true(made_apart(&f, DEPTHS - 1.5, c) < EXACT);
    }
    /* what blending as they stand would make is worse */
    for (int k = 0; k < DEPTHS; k++)
        f.law.depth[k] = (hada_magnified){1.0, 0.0, 0.0};
    assert_true(made_apart(&f, 0.5, 0) > 2.0 * EXACT);
    tear_down(&f);
}

/* An axis beside the grid's origin moves the pattern with 1 / distance; by much more than spots are wide as well. */
TEST(test_axis)
{
    for (double col = 60.0; col < 1800.0; col += 1440.0) {
        fixture f;
        set_up(&f, pinhole, col, 0.0);
        assert_int_equal(f.law.kind, HADA_MAGNIFICATION_LAW);
        assert_true(fabs(f.law.mask - MASK) < 0.01 * MASK);
        assert_true(fabs(f.law.col - col) < 3.0);
        assert_true(col > 60.0 || made_apart(&f, 1.5, 1) < EXACT);
        tear_down(&f);
    }
}

static double bent(double depth)
{
    return 1.3 - 0.006 * depth * depth;
}

static double still(double depth)
{
    return 1.2 + 0.0 * depth;
}

/* Magnifications that follow no law, or that are all the same. */
TEST(test_other_kinds)
{
    fixture f;
    set_up(&f, bent, 0.0, 0.0);
    assert_int_equal(f.law.kind, HADA_MAGNIFICATION_FREE);
    for (int k = 0; k + 1 < DEPTHS; k++) {
        const hada_magnified by = hada_magnified_between(&f.law.depth[k], &f.law.depth[k + 1]);
        assert_true(fabs(by.scale - bent(k + 1) / bent(k)) < 1e-3);
        assert_true(fabs(by.row) < 0.05 && fabs(by.col) < 0.05);
    }
    tear_down(&f);
    set_up(&f, still, 0.0, 0.0);
    assert_int_equal(f.law.kind, HADA_MAGNIFICATION_NONE);
    assert_true(f.law.shift == 0.0);
    tear_down(&f);
}

/* PSFs that have nothing to do with one another are said to. */
TEST(test_unrelated)
{
    fixture f;
    set_up(&f, pinhole, 0.0, 100.0);
    assert_int_equal(f.law.kind, HADA_MAGNIFICATION_NONE);
    assert_true(f.law.unexplained[HADA_MAGNIFICATION_NONE] > 0.9);
    tear_down(&f);
}

/* Noise of PSFs leaves the law nearly as it is. */
TEST(test_noise)
{
    fixture f;
    set_up(&f, pinhole, 0.0, 0.02);
    assert_int_equal(f.law.kind, HADA_MAGNIFICATION_LAW);
    assert_true(fabs(f.law.mask - MASK) < 0.02 * MASK);
    assert_true(made_apart(&f, 2.0, 0) > 0.1); /* of a depth itself: there is as much noise as this */
    tear_down(&f);
}

static void reference(const fixture *f, double depth, int channel, double *spectrum)
{
    /* beyond the camera's depths there is one neighbour */
    const int beyond = depth < 0.0 || depth > DEPTHS - 1, low = depth < 0.0 ? 0 : (int)fmin(depth, DEPTHS - 1);
    const hada_magnified to = hada_magnification_at(&f->law, depth);
    SCOPED_MEMORY double *coefficients = calloc(PIXELS, sizeof *coefficients), *image = calloc(PIXELS, sizeof *image);
    for (int i = 0; i < 2 - beyond; i++) {
        const hada_magnified by = hada_magnified_between(&f->law.depth[low + i], &to);
        const double share = beyond ? 1.0 : i ? depth - low : 1.0 - (depth - low);
        ASSERT_OK(hada_ref_spline(f->spectra + spectrum_at(low + i, channel), ROWS, COLS, coefficients, err));
        hada_ref_magnify(coefficients, ROWS, COLS, by.scale, by.row, by.col, share, image);
    }
    ASSERT_OK(hada_ref_fft_forward(image, ROWS, COLS, spectrum, err));
}

/* The way there and back on the device, against double precision; any order gives the same bits. */
TEST(test_reference)
{
    const double depths[4] = {3.7, 0.4, 2.0, 4.6}, again = 0.4, outside[2] = {-0.7, DEPTHS - 0.9};
    hada_between *between;
    fixture f;
    set_up(&f, pinhole, 60.0, 0.01);
    double *spectrum = calloc(VALUES, 2 * sizeof *spectrum);
    ASSERT_OK(hada_between_create(&between, f.slot, &f.camera, &f.law, err));
    ASSERT_OK(hada_between_make(between, 4, depths, f.made.mem, 0, NULL, err));
    for (int i = 0; i < 4; i++)
        for (int c = 0; c < CHANNELS; c++) {
            SCOPED_MEMORY float *made = read_made(&f, i, c);
            if (i == 2)
                memcpy(spectrum, f.spectra + spectrum_at(2, c), 2 * VALUES * sizeof *spectrum);
            else
                reference(&f, depths[i], c, spectrum);
            assert_true(apart(made, spectrum) < 1e-6);
        }
    ASSERT_OK(hada_between_make(between, 2, outside, f.made.mem, 0, NULL, err));
    for (int i = 0; i < 2; i++) {
        SCOPED_MEMORY float *made = read_made(&f, i, 1);
        reference(&f, outside[i], 1, spectrum);
        assert_true(apart(made, spectrum) < 1e-6);
    }
    ASSERT_OK(hada_between_make(between, 4, depths, f.made.mem, 0, NULL, err));
    float *first = read_made(&f, 1, 0);
    ASSERT_OK(hada_between_make(between, 1, &again, f.made.mem, (DEPTHS - 1) * CHANNELS, NULL, err));
    float *second = read_made(&f, DEPTHS - 1, 0);
    assert_memory_equal(first, second, 2 * VALUES * sizeof *first);
    HADA_FREE(first, second, spectrum);
    hada_between_destroy(&between);
    tear_down(&f);
}

/* A coarser grid has the same low frequencies; both of depths of the camera and of those between. */
TEST(test_coarse)
{
    const double depths[2] = {1.0, 1.5};
    hada_between *between;
    fixture f;
    set_up(&f, pinhole, 0.0, 0.0);
    const hada_spectrum_layout small = hada_surface_layout(f.context, ROWS / 2, COLS / 2);
    const size_t image = 2 * small.count;
    SCOPED_MEMORY float *blocks = calloc(2 * CHANNELS * image, sizeof *blocks);
    ASSERT_OK(hada_between_create(&between, f.slot, &f.camera, &f.law, err));
    ASSERT_OK(hada_between_make(between, 2, depths, f.made.mem, 0, &small, err));
    ASSERT_OK(hada_buffer_read(&f.made, f.slot, 0, blocks, 2 * CHANNELS * image * sizeof *blocks, err));
    ASSERT_OK(hada_between_make(between, 2, depths, f.made.mem, 0, NULL, err));
    for (int i = 0; i < 2; i++) {
        SCOPED_MEMORY float *whole = read_made(&f, i, 1);
        for (int ky = 1 - ROWS / 4; ky < ROWS / 4; ky++)
            for (int kx = 0; kx < COLS / 4; kx++) {
                const float *a = blocks + image * (size_t)(i * CHANNELS + 1) +
                                 2 * hada_spectrum_index(&small, ky < 0 ? ky + ROWS / 2 : ky, kx);
                const float *b = whole + 2 * ((size_t)(ky < 0 ? ky + ROWS : ky) * (COLS / 2 + 1) + (size_t)kx);
                assert_true(a[0] == b[0] && a[1] == b[1]);
            }
    }
    hada_between_destroy(&between);
    tear_down(&f);
}

TEST(test_refused)
{
    const double beyond = DEPTHS + 0.1;
    hada_between *between;
    fixture f;
    set_up(&f, pinhole, 0.0, 0.0);
    ASSERT_OK(hada_between_create(&between, f.slot, &f.camera, &f.law, err));
    ASSERT_FAILS(hada_between_make(between, 1, &beyond, f.made.mem, 0, NULL, err), HADA_ERROR_ARGUMENT,
                 "none of what is known");
    hada_between_destroy(&between);
    f.camera.rows = 7;
    ASSERT_FAILS(hada_between_create(&between, f.slot, &f.camera, &f.law, err), HADA_ERROR_SIZE, "");
    f.camera.rows = ROWS;
    f.camera.depths--;
    ASSERT_FAILS(hada_between_create(&between, f.slot, &f.camera, &f.law, err), HADA_ERROR_ARGUMENT, "");
    tear_down(&f);
}
