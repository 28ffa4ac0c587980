/* The noise of a frame, the unit of the weights, and the noise that a model states. */
#include "image/statistics.h"
#include "model/model.h"
#include "testing.h"

enum { ROWS = 150, COLS = 201, AREA = ROWS * COLS };

/* Two channels of a smooth image, a few edges, and noise. */
static void paint(float *frame, double noise)
{
    hada_random random;
    hada_random_seed(&random, 4, 0);
    for (int c = 0; c < 2; c++)
        for (int i = 0; i < AREA; i++) {
            const int y = i / COLS, x = i % COLS;
            const double light = 0.5 + 0.3 * sin(0.1 * x + c) * cos(0.07 * y) + (x > 90 && y > 40 ? 0.1 : 0.0);
            frame[c * AREA + i] = (float)(light + noise * hada_random_normal(&random));
        }
}

static double mean_square(const float *frame)
{
    double sum = 0.0;
    for (int i = 0; i < 2 * AREA; i++)
        sum += frame[i] * frame[i] / (2.0 * AREA);
    return sum;
}

static hada_pixels pixels_of(const float *frame, int channels, int rows, int cols)
{
    DEFAULTS(hada_pixels, pixels);
    hada_pixels_planar(&pixels, frame, HADA_PIXEL_F32, channels, rows, cols);
    return pixels;
}

static double estimate(const float *frame, int channels, int rows, int cols)
{
    const hada_pixels pixels = pixels_of(frame, channels, rows, cols);
    return hada_noise_estimate(&pixels, HADA_MOSAIC_NONE);
}

/* of_largest above 0: the usual noise was measured on frames, whose largest value this one has. */
static double unit_by(const float *frame, hada_noise_share usual, double mean, double largest)
{
    const hada_pixels pixels = pixels_of(frame, 2, ROWS, COLS);
    return hada_noise_unit(&pixels, HADA_MOSAIC_NONE, &usual, mean, largest);
}

static double unit(const float *frame, double share, double mean)
{
    return unit_by(frame, (hada_noise_share){share, 0.0}, mean, 1.0);
}

TEST(test_estimate)
{
    static float frame[2 * AREA];
    for (double noise = 0.003; noise < 0.2; noise *= 3.0) {
        paint(frame, noise);
        const double found = estimate(frame, 2, ROWS, COLS);
        if (!(fabs(found - noise) < 0.05 * noise + 1e-4))
            fail_msg("noise %g, found %g", noise, found);
    }
    assert_true(estimate(frame, 1, 3, COLS) == 0.0);
    assert_true(estimate(frame, 1, 4, 4) > 0.0);
}

/* Spots of a lens array, hardly wider than a pixel, all over the frame. */
TEST(test_estimate_of_a_sharp_frame)
{
    enum { SPOTS = 3000, REACH = 5 };
    static float frame[AREA];
    const double noise = 0.003, width = 0.9;
    hada_random random;
    hada_random_seed(&random, 6, 0);
    for (int spot = 0; spot < SPOTS; spot++) {
        const double y = hada_random_uniform(&random) * ROWS, x = hada_random_uniform(&random) * COLS;
        const double light = 0.1 * hada_random_uniform(&random);
        for (int row = (int)y - REACH; row <= (int)y + REACH; row++)
            for (int col = (int)x - REACH; col <= (int)x + REACH; col++)
                if (row >= 0 && row < ROWS && col >= 0 && col < COLS)
                    frame[row * COLS + col] +=
                        (float)(light * exp(-((row - y) * (row - y) + (col - x) * (col - x)) / (2.0 * width * width)));
    }
    for (int i = 0; i < AREA; i++)
        frame[i] += (float)(noise * hada_random_normal(&random));
    const double found = estimate(frame, 1, ROWS, COLS);
    if (!(found > 0.9 * noise && found < 1.2 * noise))
        fail_msg("noise %g, found %g", noise, found);
}

/* A frame's own mean square while noise is as usual; with noise far from that, in proportion. */
TEST(test_unit)
{
    static float frame[2 * AREA];
    paint(frame, 0.02);
    const double own = mean_square(frame), share = estimate(frame, 2, ROWS, COLS) / sqrt(own);
    assert_true(unit(frame, 0.0, own) == own);
    assert_true(unit(frame, share, own) == own);
    assert_true(unit(frame, share / 1.5, own) == own);
    assert_true(unit(frame, share * 1.5, own) == own);
    assert_true(fabs(unit(frame, share / 5.0, own) / own - 25.0) < 1e-9);
    assert_true(fabs(unit(frame, share * 5.0, own) / own - 1.0 / 25.0) < 1e-9);
    assert_true(fabs(unit(frame, share / 500.0, own) / own - 64.0) < 1e-9);
    assert_true(fabs(unit(frame, share * 500.0, own) / own - 1.0 / 64.0) < 1e-9);
    /* between, it rises */
    const double little = unit(frame, share / 1.8, own);
    const double more = unit(frame, share / 2.4, own);
    assert_true(little > own && more > little && more < 2.4 * 2.4 * own);
    /* a frame without noise, and one without light */
    for (int i = 0; i < 2 * AREA; i++)
        frame[i] = 0.5F;
    assert_true(fabs(unit(frame, share, 0.25) - 0.25 / 64.0) < 1e-12);
    assert_true(unit(frame, share, 0.0) == 0.0);
}

/* Where the usual noise was measured on frames, less of it counts from the first, to the power of 3/2, and more of it
 * does not where it is only that the frame has little light beside its largest value. */
TEST(test_unit_of_measured_noise)
{
    static float frame[2 * AREA];
    paint(frame, 0.02);
    const double own = mean_square(frame), noise = estimate(frame, 2, ROWS, COLS), largest = 0.7;
    const hada_noise_share usual = {noise / sqrt(own), noise / largest};
    const double ratios[] = {0.02, 0.25, 0.7, 1.0, 1.5, 5.0}; /* of the noise to the usual */
    for (size_t i = 0; i < HADA_COUNT(ratios); i++) {
        const hada_noise_share other = {usual.of_light / ratios[i], usual.of_largest / ratios[i]};
        const double by = ratios[i] < 1.0   ? fmax(ratios[i] * fmax(sqrt(ratios[i]), 0.8), 1.0 / 8.0)
                          : ratios[i] < 1.6 ? 1.0
                                            : ratios[i];
        assert_true(fabs(unit_by(frame, other, own, largest) / (own * by * by) - 1.0) < 1e-9);
    }
    /* as bright at most, with a fifth of the light, or with five times as much */
    assert_true(unit_by(frame, (hada_noise_share){usual.of_light / 5.0, usual.of_largest}, own, largest) == own);
    assert_true(unit_by(frame, (hada_noise_share){usual.of_light / 5.0, usual.of_largest * 5.0}, own, largest) == own);
    const double more = unit_by(frame, (hada_noise_share){usual.of_light * 2.0, usual.of_largest}, own, largest);
    assert_true(fabs(more - 0.16 * own) < 1e-9);
    /* the shares of the frame */
    const hada_pixels pixels = pixels_of(frame, 2, ROWS, COLS);
    const hada_noise_share share = hada_noise_share_of(&pixels, HADA_MOSAIC_NONE, own, largest);
    assert_true(share.of_light == usual.of_light && share.of_largest == usual.of_largest);
    assert_true(hada_noise_share_of(&pixels, HADA_MOSAIC_NONE, 0.0, largest).of_light == 0.0);
}

/* A camera that shows the scene as it is: frames are as bright as scenes. */
TEST(test_model)
{
    const double distance = 100.0, brightness = 0.16, noise = 0.01;
    hada_model_info info = {.form = HADA_FORM_COMPLEX,
                            .boundary = HADA_BOUNDARY_CIRCULAR,
                            .depths = 1,
                            .channels = 2,
                            .has_otf = 1,
                            .alpha = 1,
                            .noise = noise,
                            .distances_mm = &distance};
    SCOPED(hada_model) * model;
    ASSERT_OK(hada_model_set_sizes(&info, 12, 15, 12, 15, err));
    ASSERT_OK(hada_model_create(&model, &info, 1, err));
    const size_t plane = hada_model_plane(model);
    assert_true(hada_model_noise_share(model).of_light == 0.0); /* frames are dark */
    for (size_t i = 0; i < plane; i++) {
        model->otf[2 * i] = model->otf[2 * (plane + i)] = 1.0F;
        model->scene_power[i] = (float)(brightness * 12 * 15);
    }
    assert_true(fabs(hada_model_noise_share(model).of_light - noise / sqrt(brightness)) < 1e-7);
    assert_true(hada_model_noise_share(model).of_largest == 0.0);
    model->info.noise = 0.0;
    assert_true(hada_model_noise_share(model).of_light == 0.0);
    model->info.refine_noise = 0.03;
    model->info.refine_noise_largest = 0.01;
    assert_true(hada_model_noise_share(model).of_light == 0.03 && hada_model_noise_share(model).of_largest == 0.01);
}
