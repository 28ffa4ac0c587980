/* Point spread functions as people take them: cleaned, of another size, of depths that were not measured. */
#include <hadalens/scene.h>

#include "filter/psf.h"
#include "fit/psf_depths.h"
#include "image/pixels.h"
#include "model/model.h"
#include "ref/ref_fft.h"
#include "ref/ref_surface.h"
#include "testing.h"

enum { ROWS = 96, COLS = 120, SPOTS = 15 };
#define MASK 8.0

static int setup(void **state)
{
    static hada_context *context;
    ASSERT_OK(hada_context_create(&context, NULL, err));
    *state = context;
    return 0;
}

static int teardown(void **state)
{
    hada_context *context = *state;
    close_context(&context);
    return 0;
}

/* Spots of the standard deviation `sigma` within 30 pixels, the pattern `scale` times as large, of light 1 each. */
static hada_image spots(int rows, int cols, double scale, double sigma)
{
    const double pi = 3.14159265358979323846;
    hada_image psf;
    hada_random random;
    ASSERT_OK(hada_image_create(&psf, 1, rows, cols, err));
    hada_random_seed(&random, 3, 0);
    for (int s = 0; s < SPOTS; s++) {
        const double y = rows / 2 + scale * hada_random_range(&random, -30.0, 30.0);
        const double x = cols / 2 + scale * hada_random_range(&random, -30.0, 30.0);
        for (int i = 0; i < rows * cols; i++) {
            const double dy = i / cols - y, dx = i % cols - x;
            psf.data[i] += (float)(exp(-(dy * dy + dx * dx) / (2 * sigma * sigma)) / (2 * pi * sigma * sigma));
        }
    }
    return psf;
}

static double sum_of(const hada_image *image)
{
    double sum = 0.0;
    for (size_t i = 0; i < hada_image_count(image); i++)
        sum += image->data[i];
    return sum;
}

static double distance(const hada_image *a, const hada_image *b)
{
    double square = 0.0, energy = 0.0;
    for (size_t i = 0; i < hada_image_count(b); i++) {
        square += pow((double)a->data[i] - b->data[i], 2);
        energy += pow(b->data[i], 2);
    }
    return sqrt(square / energy);
}

/* Noise, and a background that is uneven by 20 to 50 times the noise, would add up to more light than the spots. */
TEST(background_and_noise_are_taken_off)
{
    enum { LARGE = 200 };
    double even = 0.0;
    for (int n = 0; n < 6; n++) {
        const double noise = n < 3 ? 0.001 : 0.002;
        SCOPED(hada_image) right = spots(LARGE, LARGE, 1.0, 1.0), psf = spots(LARGE, LARGE, 1.0, 1.0);
        DEFAULTS(hada_psf_options, options);
        hada_random random;
        hada_psf_seen seen;
        hada_random_seed(&random, 8, 0);
        for (size_t i = 0; i < hada_image_count(&psf); i++) {
            const double y = (double)(i / LARGE) / LARGE, x = (double)(i % LARGE) / LARGE;
            const double more = n % 3 == 2 ? 0.04 * exp(-2.0 * (x * x + y * y)) : n % 3 * (0.03 * x + 0.02 * y);
            psf.data[i] += (float)(0.1 + more + noise * hada_random_normal(&random));
        }
        ASSERT_OK(hada_psf_clean(&psf, &options, &seen, err));
        const double off = distance(&psf, &right), light = sum_of(&psf) / SPOTS;
        even = n % 3 ? even : off;
        assert_true(n % 3 ? seen.uneven > 0.03 : seen.uneven == 0.0 && fabs(seen.background - 0.1) < 0.3 * noise);
        assert_true(seen.dark > 0.95 && seen.dark < 0.999 && seen.border < 0.01 && fabs(seen.noise / noise - 1) < 0.1);
        if (!(fabs(light - 1.0) < 0.03 && off < 40.0 * noise && off < 1.1 * even))
            fail_msg("%d: %g of the light, %g off, %g", n, light, off, even);
    }
}

/* Hot pixels are replaced, beside spots that are hardly wider than a pixel as well; spots of single pixels stay. */
TEST(hot_pixels_are_replaced)
{
    enum { HOT = 9 };
    static const double widths[] = {0.45, 0.8, 2.0};
    for (size_t k = 0; k <= HADA_COUNT(widths); k++) {
        SCOPED(hada_image)
        psf = k < HADA_COUNT(widths) ? spots(ROWS, COLS, 1.0, widths[k]) : spots(ROWS, COLS, 1.0, 0.01);
        SCOPED(hada_image) right = {0};
        DEFAULTS(hada_psf_options, options);
        hada_random random;
        hada_psf_seen seen;
        float most = 0.0F;
        hada_random_seed(&random, 8, 0);
        for (int s = 0; s < SPOTS && k == HADA_COUNT(widths); s++)
            psf.data[(size_t)(7 + 5 * s) * COLS + (size_t)(11 * s + 3) % COLS] = 1.0F;
        for (size_t i = 0; i < hada_image_count(&psf); i++) {
            psf.data[i] = isfinite(psf.data[i]) && psf.data[i] < 10.0F ? psf.data[i] : 0.0F;
            most = fmaxf(most, psf.data[i]);
        }
        for (size_t i = 0; i < hada_image_count(&psf); i++)
            psf.data[i] += (float)(0.05 + 0.002 * most * hada_random_normal(&random));
        ASSERT_OK(hada_image_copy(&right, &psf, err));
        ASSERT_OK(hada_psf_clean(&right, &options, &seen, err));
        assert_int_equal(seen.hot, 0);
        for (int i = 0; i < HOT && k < HADA_COUNT(widths); i++)
            psf.data[(i * 10 + 4) * COLS + (i % 3 ? 2 * i : COLS - 1 - 2 * i)] += i % 2 ? 1.2F * most : 0.5F * most;
        ASSERT_OK(hada_psf_clean(&psf, &options, &seen, err));
        assert_int_equal(seen.hot, k < HADA_COUNT(widths) ? HOT : 0);
        assert_true(distance(&psf, &right) < 0.02);
    }
}

/* Files hold nothing below black: the noise's negative half is gone, more of it or less, in whole steps or not. */
TEST(noise_below_black_is_cut_off)
{
    static const double noises[] = {0.0005, 0.002}, levels[] = {-0.5, 0.0, 0.5, 1.0, 1.5}, steps[] = {0.0, 0.159 / 255};
    for (int k = 0; k < 20; k++) {
        const double noise = noises[k % 2], level = levels[k / 2 % 5] * noise, step = steps[k / 10];
        SCOPED(hada_image) right = spots(ROWS, COLS, 1.0, 1.0), psf = spots(ROWS, COLS, 1.0, 1.0);
        DEFAULTS(hada_psf_options, options);
        hada_random random;
        hada_psf_seen seen;
        hada_random_seed(&random, 8, 0);
        for (size_t i = 0; i < hada_image_count(&psf); i++) {
            const double value = fmax(psf.data[i] + level + noise * hada_random_normal(&random), 0.0);
            psf.data[i] = (float)(step > 0.0 ? step * nearbyint(value / step) : value);
        }
        ASSERT_OK(hada_psf_clean(&psf, &options, &seen, err));
        const int known = noise < 2.0 * step || fabs(seen.noise / noise - 1.0) < 0.25;
        if (!(known && fabs(sum_of(&psf) - SPOTS) < 0.05 * SPOTS && distance(&psf, &right) < 40.0 * noise))
            fail_msg("noise %g, level %g, steps %g: noise %g, light %g of %d, %g off", noise, level, step, seen.noise,
                     sum_of(&psf), SPOTS, distance(&psf, &right));
    }
}

TEST(shapes_are_measured)
{
    SCOPED(hada_image) psf = spots(2 * ROWS, 2 * COLS, 1.0, 1.0), wider = spots(2 * ROWS, 2 * COLS, 1.02, 1.0), small;
    hada_psf_shape shape;
    ASSERT_OK(hada_psf_measure(&shape, &psf, &psf, err));
    /* Gaussian spots of deviation 1: the autocorrelation falls to half at 1.67 pixels */
    assert_true(fabs(shape.detail - 3.33) < 0.3 && fabs(shape.alike - 1.0) < 1e-6);
    assert_true(shape.rows > 40 && shape.rows < 66 && shape.cols > 40 && shape.cols < 66);
    ASSERT_OK(hada_psf_measure(&shape, &wider, &psf, err));
    assert_true(shape.alike > 0.7 && shape.alike < 0.99);
    ASSERT_OK(hada_image_create(&small, 1, 1, 2, err));
    small.data[0] = 1.0F;
    ASSERT_OK(hada_psf_measure(&shape, &small, NULL, err));
    assert_true(shape.rows == 1 && shape.cols == 1 && shape.detail == 0.0 && shape.alike == 0.0 && shape.col == -1.0);
}

/* A stack whose bead wanders, about an axis beside the middle: what was added comes out, but for what another axis
 * would explain. Binned ones, too. */
TEST(drift_is_found)
{
    enum { STACK = 8 };
    for (int large = 0; large < 2; large++) {
        const int rows = large ? 300 : ROWS, cols = large ? 400 : COLS;
        hada_image psf[STACK];
        double distances[STACK], moved[STACK][2], found[STACK][2], off = 0.0;
        hada_random random;
        hada_random_seed(&random, 4, 0);
        for (int k = 0; k < STACK; k++) {
            const double scale = 1.0 + 0.2 * (STACK - 1 - k) / STACK;
            SCOPED(hada_image) still = spots(rows, cols, scale, large ? 3.0 : 1.2);
            distances[k] = 1.0 / (0.3 + 0.1 * (STACK - 1 - k) / STACK); /* 1 / distance rises with the scale */
            for (int i = 0; i < 2; i++)
                moved[k][i] = hada_random_range(&random, -2.0, 2.0);
            ASSERT_OK(hada_image_magnify(&psf[k], &still, 1.0, moved[k][0] + 9.0 / distances[k], moved[k][1] - 2.0,
                                         rows, cols, err));
        }
        const hada_psfs all = {psf, distances, STACK};
        ASSERT_OK(hada_psf_drift(found, &all, err));
        for (int i = 0; i < 2; i++) { /* what is left of the difference beside a + b / distance */
            double mean = 0.0, inverse = 0.0, product = 0.0, square = 0.0;
            for (int k = 0; k < STACK; k++) {
                mean += (moved[k][i] - found[k][i]) / STACK;
                inverse += 1.0 / distances[k] / STACK;
            }
            for (int k = 0; k < STACK; k++) {
                product += (1.0 / distances[k] - inverse) * (moved[k][i] - found[k][i] - mean);
                square += pow(1.0 / distances[k] - inverse, 2.0);
            }
            for (int k = 0; k < STACK; k++)
                off = fmax(off,
                           fabs(moved[k][i] - found[k][i] - mean - product / square * (1.0 / distances[k] - inverse)));
        }
        if (!(off < (large ? 0.3 : 0.1)))
            fail_msg("%d columns: %g pixels off", cols, off);
        for (int k = 0; k < STACK; k++)
            hada_image_destroy(&psf[k]);
    }
}

TEST(computed_psfs_stay_as_they_are)
{
    SCOPED(hada_image) right = spots(ROWS, COLS, 1.0, 1.0), psf = spots(ROWS, COLS, 1.0, 1.0);
    DEFAULTS(hada_psf_options, options);
    ASSERT_OK(hada_psf_clean(&psf, &options, NULL, err));
    assert_true(distance(&psf, &right) < 1e-6);
    options.psf_dark = 0.0;
    right.data[7] = -1.0F;
    ASSERT_OK(hada_psf_clean(&right, &options, NULL, err));
    assert_true(right.data[7] == 0.0F);
}

TEST(edges_are_told_and_fade_out)
{
    SCOPED(hada_image) psf;
    DEFAULTS(hada_psf_options, options);
    hada_psf_seen seen;
    ASSERT_OK(hada_image_create(&psf, 2, 20, 30, err));
    for (size_t i = 0; i < hada_image_count(&psf); i++)
        psf.data[i] = 2.0F;
    options.psf_dark = 0.0;
    options.psf_taper = 5;
    ASSERT_OK(hada_psf_clean(&psf, &options, &seen, err));
    assert_true(fabs(seen.border - 1.0) < 1e-9);
    assert_true(psf.data[0] < 0.01F && psf.data[10 * 30 + 15] == 2.0F && psf.data[600 + 10 * 30] < 0.1F);
    options.psf_dark = 3.0;
    ASSERT_FAILS(hada_psf_clean(&psf, &options, &seen, err), HADA_ERROR_NUMERIC, "brighter than its background (3)");
}

/* A PSF in a frame of zeros is the PSF alone; of one that is larger, what the frame cannot see does not matter. */
TEST(psfs_of_any_size_make_the_same_model)
{
    static const double distances[] = {100.0};
    static const int frames[][2] = {{ROWS, COLS}, {ROWS - 15, COLS + 7}};
    for (int i = 0; i < 4; i++) {
        const int rows = frames[i / 2][0], cols = frames[i / 2][1], larger = i % 2;
        SCOPED(hada_image) psf = larger ? spots(3 * ROWS, 3 * COLS + 1, 1.0, 1.0) : spots(82, 71, 1.0, 1.0);
        SCOPED(hada_image) framed;
        SCOPED(hada_model) * one, *two;
        DEFAULTS(hada_psf_options, options);
        ASSERT_OK(hada_image_crop(&framed, &psf, psf.rows / 2 - rows / 2, psf.cols / 2 - cols / 2, rows, cols, err));
        options.psf_dark = 0.0;
        options.window_rows = options.window_cols = 20;
        options.frame_rows = rows;
        options.frame_cols = cols;
        ASSERT_OK(hada_model_from_psf(&one, *state, &psf, 1, distances, &options, err));
        ASSERT_OK(hada_model_from_psf(&two, *state, &framed, 1, distances, &options, err));
        assert_int_equal(one->info.raw_rows, rows);
        assert_int_equal(one->info.raw_cols, cols);
        for (size_t k = 0; k < 2 * hada_model_plane(one); k++)
            assert_true(fabsf(one->otf[k] - two->otf[k]) < 1e-5F);
    }
}

TEST(magnified_images_keep_light_and_stay_sharp)
{
    static const double scales[] = {1.0, 1.03, 1.2, 0.97, 0.8};
    for (int i = 0; i < 5; i++) {
        const double scale = scales[i];
        /* the spots are magnified with their places */
        SCOPED(hada_image) psf = spots(ROWS, COLS, 1.0, 1.1), right = spots(ROWS, COLS + 2, scale, 1.1 * scale), got;
        ASSERT_OK(hada_image_magnify(&got, &psf, scale, 0.0, 0.0, ROWS, COLS + 2, err));
        assert_true(fabs(sum_of(&got) - SPOTS) < 1e-3 * SPOTS);
        const double error = distance(&got, &right);
        if (!(error < 0.02))
            fail_msg("%g: %g", scale, error);
    }
}

/* Against the quintic spline, which is what surfaces take between depths. */
TEST(magnified_images_are_those_of_the_reference)
{
    enum { PIXELS = ROWS * COLS };
    SCOPED(hada_image) psf = spots(ROWS, COLS, 1.0, 1.2), got;
    double *image = calloc(PIXELS, sizeof *image), *out = calloc(PIXELS, sizeof *out), square = 0.0, energy = 0.0;
    double *spectrum = calloc((size_t)ROWS * (COLS / 2 + 1) * 2, sizeof *spectrum);
    for (int i = 0; i < PIXELS; i++) /* the reference has its origin at (0, 0) */
        image[(i / COLS + ROWS - ROWS / 2) % ROWS * COLS + (i % COLS + COLS - COLS / 2) % COLS] = psf.data[i];
    ASSERT_OK(hada_ref_fft_forward(image, ROWS, COLS, spectrum, err));
    ASSERT_OK(hada_ref_spline(spectrum, ROWS, COLS, image, err));
    hada_ref_magnify(image, ROWS, COLS, 1.07, 0.8, -1.3, 1.0, out);
    ASSERT_OK(hada_image_magnify(&got, &psf, 1.07, 0.8, -1.3, ROWS, COLS, err));
    for (int i = 0; i < PIXELS; i++) {
        const double right = out[(i / COLS + ROWS - ROWS / 2) % ROWS * COLS + (i % COLS + COLS - COLS / 2) % COLS];
        square += pow(got.data[i] - right, 2);
        energy += right * right;
    }
    HADA_FREE(image, out, spectrum);
    assert_true(sqrt(square / energy) < 0.01);
}

/* All of the pattern is magnified, the spots too. */
static hada_image of_distance(double distance_mm, int rows, int cols)
{
    const double scale = 1.0 + MASK / distance_mm;
    return spots(rows, cols, scale, scale);
}

TEST(other_depths_follow_the_law)
{
    static const double known_mm[] = {60.0, 200.0}, wanted_mm[] = {40.0, 60.0, 100.0, 400.0};
    hada_image known[2] = {of_distance(60.0, ROWS, COLS), of_distance(200.0, ROWS, COLS)};
    const hada_psfs psfs = {known, known_mm, 2}, one = {known, known_mm, 1};
    for (int i = 0; i < 2; i++) {
        hada_image got[4] = {{0}};
        double mask = i ? MASK : 0.0, left = 0.0;
        ASSERT_OK(hada_psf_depths(got, wanted_mm, 4, i ? &one : &psfs, &mask, &left, *state, err));
        assert_true(fabs(mask / MASK - 1.0) < 0.02 && (i ? left == 0.0 : left > 0.0 && left < 0.1));
        for (int z = 0; z < 4; z++) {
            SCOPED(hada_image) right = of_distance(wanted_mm[z], got[z].rows, got[z].cols);
            const double error = distance(&got[z], &right);
            if (!(error < 0.03))
                fail_msg("%g mm: %g", wanted_mm[z], error);
            hada_image_destroy(&got[z]);
        }
    }
    double mask = 0.0, left;
    hada_image got[1] = {{0}};
    hada_image_destroy(&known[1]);
    known[1] = spots(ROWS, COLS, 1.0, 1.0);
    for (int i = 0; i < ROWS * COLS / 2; i++) { /* turned: no law */
        const float swap = known[1].data[i];
        known[1].data[i] = known[1].data[ROWS * COLS - 1 - i];
        known[1].data[ROWS * COLS - 1 - i] = swap;
    }
    ASSERT_FAILS(hada_psf_depths(got, wanted_mm, 1, &psfs, &mask, &left, *state, err), HADA_ERROR_NUMERIC,
                 "magnification");
    hada_image_destroy(&known[0]);
    hada_image_destroy(&known[1]);
}

FIXTURE(setup, teardown)
