/* Sensors: their random numbers have the distributions that they claim, and nothing depends on anything but the seed.
 */
#include "ref/ref_sensor.h"
#include "testing.h"

enum { ROWS = 150, COLS = 200, PIXELS = ROWS * COLS };

typedef struct bench {
    hada_context *context;
    hada_camera camera;
    hada_simulator *simulator;
} bench;

static int open_device(void **state)
{
    static bench b;
    ASSERT_OK(hada_context_create(&b.context, NULL, err));
    b.camera.size = sizeof b.camera;
    ASSERT_OK(hada_camera_preset(&b.camera, "sim300", err));
    ASSERT_OK(hada_camera_resize(&b.camera, ROWS, COLS, 0, 0, err));
    ASSERT_OK(hada_simulator_create(&b.simulator, b.context, &b.camera, NULL, err));
    *state = &b;
    return 0;
}

static int close_device(void **state)
{
    bench *b = *state;
    hada_simulator_destroy(&b->simulator);
    close_context(&b->context);
    return 0;
}

static hada_image flat(int channels, float value)
{
    hada_image image;
    ASSERT_OK(hada_image_create(&image, channels, ROWS, COLS, err));
    for (size_t i = 0; i < hada_image_count(&image); i++)
        image.data[i] = value;
    return image;
}

/* What docs/explanation/simulation.md says of the approximation for many electrons. */
TEST(approximation)
{
    const struct {
        double mean, bound;
    } stated[] = {{16.0, 1.3e-4}, {32.0, 4.5e-5}, {64.0, 1.6e-5}, {200.0, 3e-6}, {1000.0, 3e-7}};
    for (size_t i = 0; i < sizeof stated / sizeof *stated; i++) {
        const double mean = stated[i].mean;
        double largest = 0.0;
        for (int k = (int)fmax(0.0, mean - 5.0 * sqrt(mean)); k < mean + 5.0 * sqrt(mean); k++)
            largest = fmax(largest, fabs(hada_ref_poisson_approximated(mean, k) - hada_ref_poisson_below(mean, k)));
        assert_true(largest < stated[i].bound && largest > 0.5 * stated[i].bound);
    }
}

static void moments(const float *values, double *mean, double *variance)
{
    double sum = 0.0, squares = 0.0;
    for (int i = 0; i < PIXELS; i++)
        sum += values[i];
    *mean = sum / PIXELS;
    for (int i = 0; i < PIXELS; i++)
        squares += (values[i] - *mean) * (values[i] - *mean);
    *variance = squares / (PIXELS - 1);
}

/* Mean and variance within 4.5 standard errors, and Kolmogorov's statistic below its 0.1 % point (for counts, whose
 * steps make it smaller, that is on the safe side of wrong alarms only: a bias of 1 % of a standard deviation shows).
 */
TEST(shot_noise)
{
    const bench *b = *state;
    const double means[] = {0.05, 1.0, 5.0, 15.99, 16.0, 100.0, 5000.0};
    for (size_t m = 0; m < sizeof means / sizeof *means; m++) {
        DEFAULTS(hada_sensor, sensor);
        sensor.full_well = 65536.0; /* electrons come back from shares exactly */
        sensor.saturate = 0;
        sensor.exposure = means[m] / 65536.0;
        SCOPED(hada_image) frame = flat(1, 1.0f);
        ASSERT_OK(hada_simulator_expose(b->simulator, &sensor, 42 + m, &frame, err));
        double mean, variance, distance = 0.0;
        for (int i = 0; i < PIXELS; i++) {
            frame.data[i] *= 65536.0f;
            assert_true(frame.data[i] >= 0.0f && frame.data[i] == rintf(frame.data[i]));
        }
        moments(frame.data, &mean, &variance);
        assert_true(fabs(mean - means[m]) < 4.5 * sqrt(means[m] / PIXELS));
        /* the fourth central moment of a Poisson number is mean + 3 mean^2 */
        assert_true(fabs(variance - means[m]) < 4.5 * sqrt((means[m] + 2.0 * means[m] * means[m]) / PIXELS));
        qsort(frame.data, PIXELS, sizeof(float), ascending_floats);
        double below = 0.0;
        for (int i = 0, k = 0; i < PIXELS; k++) {
            below += exp(k * log(means[m]) - means[m] - lgamma(k + 1.0));
            while (i < PIXELS && frame.data[i] <= (float)k)
                i++;
            distance = fmax(distance, fabs((double)i / PIXELS - below));
        }
        assert_true(distance * sqrt(PIXELS) < 1.95);
    }
}

TEST(read_noise)
{
    const bench *b = *state;
    DEFAULTS(hada_sensor, sensor);
    sensor.read_noise = 0.01;
    sensor.dark_level = 0.0625;
    sensor.exposure = 0.25;
    SCOPED(hada_image) frame = flat(1, 0.5f);
    ASSERT_OK(hada_simulator_expose(b->simulator, &sensor, 7, &frame, err));
    double mean, variance, distance = 0.0, together = 0.0;
    moments(frame.data, &mean, &variance);
    assert_true(fabs(mean - 0.1875) < 4.5 * 0.01 / sqrt(PIXELS));
    assert_true(fabs(variance / 1e-4 - 1.0) < 4.5 * sqrt(2.0 / PIXELS));
    for (int i = 1; i < PIXELS; i++) /* neighbours know nothing of each other */
        together += (frame.data[i] - mean) * (frame.data[i - 1] - mean);
    assert_true(fabs(together / PIXELS / variance) < 4.5 / sqrt(PIXELS));
    qsort(frame.data, PIXELS, sizeof(float), ascending_floats);
    for (int i = 0; i < PIXELS; i++) {
        const double below = 0.5 * erfc(-(frame.data[i] - 0.1875) / 0.01 / sqrt(2.0));
        distance = fmax(distance, fmax(fabs((i + 1.0) / PIXELS - below), fabs((double)i / PIXELS - below)));
    }
    assert_true(distance * sqrt(PIXELS) < 1.95);
}

TEST(seeds)
{
    const bench *b = *state;
    DEFAULTS(hada_sensor, sensor);
    sensor.full_well = 1000.0;
    sensor.read_noise = 2.0;
    hada_image frames[3];
    const uint64_t seed[] = {5, 5, 5 + (1ull << 32)};
    for (int i = 0; i < 3; i++) {
        frames[i] = flat(3, 0.3f);
        ASSERT_OK(hada_simulator_expose(b->simulator, &sensor, seed[i], &frames[i], err));
    }
    assert_memory_equal(frames[0].data, frames[1].data, 3 * PIXELS * sizeof(float));
    int same = 0, channels = 0;
    for (int i = 0; i < PIXELS; i++) {
        same += frames[0].data[i] == frames[2].data[i];
        channels += frames[0].data[i] == frames[0].data[PIXELS + i];
    }
    assert_true(same < PIXELS / 100 && channels < PIXELS / 100);
    destroy_images(frames, 3);
}

/* Light far above the full well, and below zero. */
TEST(saturation_and_rounding)
{
    const bench *b = *state;
    DEFAULTS(hada_sensor, sensor);
    sensor.full_well = 500.0;
    sensor.dark_level = 0.25;
    SCOPED(hada_image) frame = flat(1, 50.0f);
    for (int i = 0; i < PIXELS / 2; i++)
        frame.data[i] = -1.0f;
    ASSERT_OK(hada_simulator_expose(b->simulator, &sensor, 1, &frame, err));
    for (int i = 0; i < PIXELS; i++)
        assert_true(frame.data[i] == (i < PIXELS / 2 ? 0.25f : 1.0f));
    hada_image_destroy(&frame);
    hada_sensor_init(&sensor);
    sensor.bits = 10;
    frame = flat(1, 0.0f);
    for (int i = 0; i < PIXELS; i++)
        frame.data[i] = (float)i / PIXELS;
    ASSERT_OK(hada_simulator_expose(b->simulator, &sensor, 1, &frame, err));
    for (int i = 0; i < PIXELS; i++) {
        const double level = frame.data[i] * 1023.0;
        assert_true(fabs(level - rint(level)) < 1e-4 && fabs(level - i * 1023.0 / PIXELS) < 0.5001);
    }
}

TEST(vignetting)
{
    bench *b = *state;
    DEFAULTS(hada_sensor, sensor);
    sensor.vignetting = HADA_VIGNETTING_COS4;
    DEFAULTS(hada_simulator_options, options);
    for (int moved = 0; moved < 2; moved++) {
        SCOPED(hada_simulator) * simulator;
        options.shift_rows = 20 * moved;
        options.shift_cols = -30 * moved;
        ASSERT_OK(hada_simulator_create(&simulator, b->context, &b->camera, &options, err));
        SCOPED(hada_image) frame = flat(3, 1.0f);
        ASSERT_OK(hada_simulator_expose(simulator, &sensor, 1, &frame, err));
        const int at[][2] = {{0, 0}, {75, 100}, {149, 13}};
        for (int i = 0; i < 3; i++) {
            const double y = (at[i][0] - 75 + options.shift_rows) * b->camera.pixel_pitch_mm,
                         x = (at[i][1] - 100 + options.shift_cols) * b->camera.pixel_pitch_mm;
            const double expected = pow(cos(atan(hypot(x, y) / b->camera.distance_mm)), 4.0);
            assert_true(fabs(frame.data[2 * PIXELS + at[i][0] * COLS + at[i][1]] - expected) < 1e-6);
        }
    }
    SCOPED(hada_image) gain = flat(1, 0.5f), frame = flat(3, 1.0f);
    gain.data[3] = 0.25f;
    sensor.vignetting = HADA_VIGNETTING_IMAGE;
    sensor.gain = &gain;
    ASSERT_OK(hada_simulator_expose(b->simulator, &sensor, 1, &frame, err));
    for (int i = 0; i < 3 * PIXELS; i++)
        assert_true(frame.data[i] == (i % PIXELS == 3 ? 0.25f : 0.5f));
    gain.data[0] = -1.0f;
    ASSERT_FAILS(hada_simulator_expose(b->simulator, &sensor, 1, &frame, err), HADA_ERROR_ARGUMENT, "");
    gain.rows--;
    ASSERT_FAILS(hada_simulator_expose(b->simulator, &sensor, 1, &frame, err), HADA_ERROR_SIZE, "");
}

TEST(refusals)
{
    const bench *b = *state;
    hada_error error;
    SCOPED(hada_image) frame = flat(1, 1.0f);
    hada_sensor good, bad;
    hada_sensor_init(&good);
    for (int i = 0; i < 9; i++) {
        bad = good;
        switch (i) {
        case 0: bad.size = 1; break;
        case 1: bad.exposure = 0.0; break;
        case 2: bad.full_well = 2e6; break;
        case 3: bad.read_noise = -1.0; break;
        case 4: bad.dark_level = 1.0; break;
        case 5: bad.bits = 17; break;
        case 6: bad.bits = 8, bad.saturate = 0; break;
        case 7: bad.vignetting = (hada_vignetting)9; break;
        default: bad.vignetting = HADA_VIGNETTING_IMAGE; break;
        }
        assert_int_equal(hada_simulator_expose(b->simulator, &bad, 1, &frame, &error), HADA_ERROR_ARGUMENT);
        assert_true(strlen(error.message) > 20);
    }
    frame.data[2] = NAN;
    assert_int_equal(hada_simulator_expose(b->simulator, &good, 1, &frame, &error), HADA_ERROR_NOT_FINITE);
    frame.cols--;
    assert_int_equal(hada_simulator_expose(b->simulator, &good, 1, &frame, &error), HADA_ERROR_SIZE);
}

FIXTURE(open_device, close_device)
