/* Bad pixels of single frames: found, left out, and sharp light that is none. */
#include "camera_small.h"
#include "device_fixture.h"
#include "image/correct.h"
#include "model/model.h"

enum { ROWS = 72, COLS = 90, WINDOW = 36, PIXELS = ROWS * COLS, CHANNELS = 3, VALUES = CHANNELS * PIXELS };
#define NOISE 0.004

/* Smooth light with noise that grows with it. */
static hada_image smooth_light(int channels, uint64_t seed)
{
    hada_image image;
    hada_random random;
    ASSERT_OK(hada_image_create(&image, channels, ROWS, COLS, err));
    hada_random_seed(&random, seed, 1);
    for (int i = 0; i < channels * PIXELS; i++) {
        const double light = 0.3 + 0.2 * sin(i / COLS * 0.08) + 0.1 * cos(i % COLS * 0.06);
        image.data[i] = (float)(light + 2 * NOISE * sqrt(light) * hada_random_normal(&random));
    }
    return image;
}

static size_t found_in(const hada_image *image, hada_mosaic mosaic, size_t **list)
{
    hada_pixels pixels;
    size_t count;
    hada_pixels_init(&pixels);
    hada_pixels_of_image(&pixels, image);
    ASSERT_OK(hada_bad_pixels_find(&pixels, mosaic, 0, list, &count, err));
    return count;
}

static size_t count_in(const hada_image *image, hada_mosaic mosaic)
{
    size_t *list;
    const size_t count = found_in(image, mosaic, &list);
    free(list);
    return count;
}

/* Hot, dead and stuck ones, beside each other, in a corner and at a border; and nothing else. */
TEST(bad_pixels_are_found)
{
    static const struct {
        int row, col;
        float value;
    } bad[] = {{0, 0, 1.0f},   {0, 41, 1.0f},  {20, 89, 1.0f}, {31, 17, 1.0f},  {31, 18, 0.9f},
               {40, 60, 0.0f}, {55, 30, 1.0f}, {56, 31, 0.9f}, {71, 50, 0.85f}, {66, 7, 0.8f}};
    for (int channels = 1; channels <= CHANNELS; channels += 2)
        for (uint64_t seed = 1; seed < 6; seed++) {
            SCOPED(hada_image) image = smooth_light(channels, seed);
            const int channel = channels - 1;
            size_t *list;
            assert_int_equal(count_in(&image, HADA_MOSAIC_NONE), 0);
            for (size_t i = 0; i < HADA_COUNT(bad); i++)
                image.data[channel * PIXELS + bad[i].row * COLS + bad[i].col] = bad[i].value;
            assert_int_equal(found_in(&image, HADA_MOSAIC_NONE, &list), HADA_COUNT(bad));
            for (size_t i = 1; i < HADA_COUNT(bad); i++)
                assert_true(list[i] > list[i - 1]);
            for (size_t i = 0; i < HADA_COUNT(bad); i++) {
                const size_t place = (size_t)(channel * PIXELS + bad[i].row * COLS + bad[i].col);
                size_t k = 0;
                while (k < HADA_COUNT(bad) && list[k] != place)
                    k++;
                assert_true(k < HADA_COUNT(bad));
            }
            free(list);
        }
}

/* In a mosaic neighbours are of the same colour: the others may see any other light. */
TEST(colours_of_a_mosaic_are_no_bad_pixels)
{
    SCOPED(hada_image) image = smooth_light(1, 7);
    for (int i = 0; i < PIXELS; i++)
        image.data[i] *= i / COLS % 2 == 0 && i % COLS % 2 == 0 ? 0.1f : 1.0f;
    assert_int_equal(count_in(&image, HADA_MOSAIC_RGGB), 0);
    image.data[30 * COLS + 44] = 0.5f; /* among those that see a tenth */
    image.data[31 * COLS + 61] = 1.0f;
    assert_int_equal(count_in(&image, HADA_MOSAIC_RGGB), 2);
}

/* Points of light, as sharp as the header says, anywhere between the pixels; and a frame without noise. */
TEST(sharp_light_is_no_bad_pixel)
{
    for (int k = 0; k < 40; k++) {
        SCOPED(hada_image) image = smooth_light(1, 9);
        for (int i = 0; i < PIXELS; i++)
            image.data[i] = k % 2 ? 0.0f : 0.02f * image.data[i];
        for (int p = 0; p < 9; p++) {
            const double y = 8 + 7 * p + 0.13 * k, x = 9 + 8 * p + 0.31 * k;
            for (int row = 0; row < ROWS; row++)
                for (int col = 0; col < COLS; col++)
                    image.data[row * COLS + col] +=
                        (float)exp(-0.5 * ((row - y) * (row - y) + (col - x) * (col - x)) / 0.6 / 0.6);
        }
        assert_int_equal(count_in(&image, HADA_MOSAIC_NONE), 0);
    }
}

/* More than one of 200 belong to what the camera shows; frames of a few pixels, and empty ones, have none. */
TEST(many_are_not_bad)
{
    SCOPED(hada_image) image = smooth_light(1, 11), tiny, empty;
    for (int i = 0; i < PIXELS; i += 97)
        image.data[i] = 1.0f;
    assert_int_equal(count_in(&image, HADA_MOSAIC_NONE), 0);
    ASSERT_OK(hada_image_create(&tiny, 1, 5, 5, err));
    tiny.data[12] = 1.0f;
    assert_int_equal(count_in(&tiny, HADA_MOSAIC_NONE), 0);
    ASSERT_OK(hada_image_create(&empty, 1, ROWS, COLS, err));
    assert_int_equal(count_in(&empty, HADA_MOSAIC_NONE), 0);
    for (int i = 0; i < PIXELS; i++)
        empty.data[i] = NAN;
    assert_int_equal(count_in(&empty, HADA_MOSAIC_NONE), 0);
}

/* Means over 3 x 3 pixels. */
static hada_image softened(const hada_image *psf)
{
    hada_image out;
    ASSERT_OK(hada_image_create(&out, psf->channels, ROWS, COLS, err));
    for (int i = 0; i < VALUES; i++) {
        const int row = i / COLS % ROWS, col = i % COLS;
        for (int k = 0; k < 9 && row > 0 && col > 0 && row < ROWS - 1 && col < COLS - 1; k++)
            out.data[i] += psf->data[i + (k / 3 - 1) * COLS + k % 3 - 1] / 9.0f;
    }
    return out;
}

/* A camera whose point spread function is of single pixels may show such frames. */
TEST(sharp_cameras_are_not_judged)
{
    static const double distance = 100.0;
    SCOPED(hada_image) psf = small_psf(1, ROWS, COLS, 40, 3), frame;
    SCOPED(hada_model) * model;
    SCOPED(hada_plan) * plan;
    SCOPED(hada_result) result = {0};
    DEFAULTS(hada_psf_options, options);
    options.window_rows = options.window_cols = WINDOW;
    options.psf_dark = 0.0;
    ASSERT_OK(hada_model_from_psf(&model, context, &psf, 1, &distance, &options, err));
    ASSERT_OK(hada_plan_create(&plan, context, model, NULL, err));
    ASSERT_OK(hada_image_create(&frame, 1, ROWS, COLS, err));
    memcpy(frame.data, psf.data, PIXELS * sizeof *frame.data);
    ASSERT_OK(hada_plan_run(plan, &frame, &result, err));
    assert_int_equal(result.report->bad_pixels, 0);
    assert_true(isinf(hada_model_sharpness(model->otf, &model->info)) ||
                hada_model_sharpness(model->otf, &model->info) > 2.0);
}

/* A frame with bad pixels gives what it gives without; where the caller says which pixels count, none is looked for. */
TEST(frames_are_reconstructed_without_them)
{
    static const double distance = 100.0;
    for (int padded = 0; padded < 2; padded++) {
        SCOPED(hada_image)
        spots = small_psf(CHANNELS, ROWS, COLS, 40, 3), psf = softened(&spots), coarse = small_scene(CHANNELS, 9, 9, 4),
        scene, weights, kept;
        SCOPED(hada_model) * model;
        SCOPED(hada_plan) * plan, *judged;
        hada_result result = {0}, with = {0};
        DEFAULTS(hada_psf_options, of_psf);
        DEFAULTS(hada_plan_options, options);
        ASSERT_OK(hada_image_create(&scene, CHANNELS, WINDOW, WINDOW, err));
        for (int i = 0; i < CHANNELS * WINDOW * WINDOW; i++)
            scene.data[i] = coarse.data[(i / WINDOW / WINDOW * 9 + i / WINDOW % WINDOW / 4) * 9 + i % WINDOW / 4];
        of_psf.window_rows = of_psf.window_cols = WINDOW;
        of_psf.boundary = padded ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR;
        of_psf.psf_dark = 0.0;
        ASSERT_OK(hada_model_from_psf(&model, context, &psf, 1, &distance, &of_psf, err));
        SCOPED(hada_image) frame = small_frame(&psf, &scene, padded, NOISE, 5);
        options.refine_tv = 1e-3;
        ASSERT_OK(hada_plan_create(&plan, context, model, &options, err));
        ASSERT_OK(hada_plan_run(plan, &frame, &result, err));
        assert_int_equal(result.report->bad_pixels, 0);
        ASSERT_OK(hada_image_copy(&kept, &result.all_in_focus, err));
        for (int i = 0; i < 7; i++)
            frame.data[i % CHANNELS * PIXELS + (5 + 9 * i) * COLS + 8 + 11 * i] = i % 2 ? 3.0f : 1.5f;
        ASSERT_OK(hada_plan_run(plan, &frame, &result, err));
        ASSERT_OK(hada_image_create(&weights, CHANNELS, ROWS, COLS, err));
        for (int i = 0; i < VALUES; i++)
            weights.data[i] = 1.0f;
        options.pixel_weights = &weights;
        ASSERT_OK(hada_plan_create(&judged, context, model, &options, err));
        ASSERT_OK(hada_plan_run(judged, &frame, &with, err));
        const size_t count = hada_image_count(&kept);
        const double off = relative_change(result.all_in_focus.data, kept.data, count),
                     before = relative_change(with.all_in_focus.data, kept.data, count);
        print_message("%s: off by %.4f, with them %.4f\n", padded ? "padded" : "circular", off, before);
        assert_int_equal(result.report->bad_pixels, 7);
        assert_int_equal(with.report->bad_pixels, 0);
        assert_true(off < 0.05 && before > 5 * off);
        hada_result_destroy(&result);
        hada_result_destroy(&with);
    }
}

FIXTURE(open_device, close_device)
