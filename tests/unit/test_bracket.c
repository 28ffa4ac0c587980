/* Exposures of one scene merged into one frame: their lengths, saturated pixels, weights, dark level; files of them;
 * what does not belong together. */
#include "camera_small.h"
#include "io_testing.h"
#include "ref/ref_mosaic.h"

enum { ROWS = 48, COLS = 60, CHANNELS = 3, EXPOSURES = 3 };
static const double lengths[EXPOSURES] = {5.0, 1.0, 24.0};
#define DARK 0.04

/* What a sensor that saturates at 1 records in a time. */
static hada_image expose(const hada_image *light, double length, double noise, uint64_t seed)
{
    hada_image frame;
    hada_random random;
    hada_random_seed(&random, seed, 3);
    ASSERT_OK(hada_image_create(&frame, light->channels, light->rows, light->cols, err));
    for (size_t i = 0; i < hada_image_count(&frame); i++)
        frame.data[i] = (float)fmin(1.0, DARK + length * (double)light->data[i] + noise * hada_random_normal(&random));
    return frame;
}

static hada_image light_of(int channels)
{
    hada_image light = small_scene(channels, ROWS, COLS, 4);
    for (size_t i = 0; i < hada_image_count(&light); i++) /* of great contrast */
        light.data[i] = 0.19f * light.data[i] * light.data[i];
    return light;
}

/* Values from here on may be cut off: a 128th below the largest of the channel, or of the colour. */
static float limit_at(const hada_image *frame, const char *pattern, size_t i)
{
    const size_t plane = ROWS * COLS;
    float largest = 0.0f;
    for (size_t j = 0; j < hada_image_count(frame); j++)
        if (pattern ? hada_ref_mosaic_channel(pattern, (int)(j / COLS), (int)(j % COLS)) ==
                          hada_ref_mosaic_channel(pattern, (int)(i / COLS), (int)(i % COLS))
                    : j / plane == i / plane)
            largest = fmaxf(largest, frame->data[j]);
    return largest * 127.0f / 128.0f;
}

/* Without noise each value is the light, in the units of the shortest exposure. */
TEST(merged_frames_are_the_light)
{
    static const hada_mosaic patterns[] = {HADA_MOSAIC_NONE, HADA_MOSAIC_RGGB};
    for (int k = 0; k < 2; k++) {
        SCOPED(hada_image) light = light_of(k ? 1 : CHANNELS);
        SCOPED(hada_image) merged = {0};
        SCOPED(hada_image) weights = {0};
        hada_image frames[EXPOSURES];
        double scales[EXPOSURES], dark;
        light.data[7] = 3.0f; /* saturates all, as do more of them */
        for (int i = 100; i < 140; i++)
            light.data[i] = 2.0f;
        for (int i = 0; i < EXPOSURES; i++)
            frames[i] = expose(&light, lengths[i], 0.0, 1);
        frames[2].data[9] = NAN; /* the others have it */
        ASSERT_OK(hada_image_merge_exposures(&merged, &weights, frames, EXPOSURES, patterns[k], scales, &dark, err));
        for (int i = 0; i < EXPOSURES; i++)
            assert_true(fabs(scales[i] / lengths[i] - 1.0) < 1e-5);
        assert_true(fabs(dark - DARK) < 1e-5);
        for (size_t i = 0; i < hada_image_count(&light); i++) {
            double length = 0.0;
            for (int e = 0; e < EXPOSURES; e++)
                length +=
                    frames[e].data[i] < limit_at(&frames[e], k ? "rggb" : NULL, i) ? lengths[e] : 0.0; /* NaN is not */
            const double expected = length > 0.0 ? DARK + light.data[i] : frames[1].data[i];
            assert_true(fabs(merged.data[i] - expected) < 1e-5);
            assert_true(fabs(weights.data[i] - (length > 0.0 ? length : 1.0) / 30.0) < 1e-5);
        }
        destroy_images(frames, EXPOSURES);
    }
}

/* With noise the merged frame is better than each of them. */
TEST(merged_frames_have_less_noise)
{
    SCOPED(hada_image) light = light_of(1);
    SCOPED(hada_image) merged = {0};
    hada_image frames[EXPOSURES];
    double scales[EXPOSURES], error = 0.0, least = INFINITY;
    for (int i = 0; i < EXPOSURES; i++)
        frames[i] = expose(&light, lengths[i], 0.004, (uint64_t)i + 1);
    ASSERT_OK(hada_image_merge_exposures(&merged, NULL, frames, EXPOSURES, HADA_MOSAIC_NONE, scales, NULL, err));
    for (int e = 0; e < EXPOSURES; e++) {
        double mine = 0.0;
        assert_true(fabs(scales[e] / scales[1] / lengths[e] - 1.0) < 0.01);
        for (size_t i = 0; i < hada_image_count(&light); i++)
            mine += pow((frames[e].data[i] - DARK) / lengths[e] - light.data[i], 2.0);
        least = fmin(least, mine);
    }
    for (size_t i = 0; i < hada_image_count(&light); i++)
        error += pow(merged.data[i] - DARK - light.data[i], 2.0);
    if (error > 0.75 * least)
        fail_msg("error %.3g, %.3g of the best exposure", error, least);
    destroy_images(frames, EXPOSURES);
}

TEST(what_does_not_belong_together)
{
    SCOPED(hada_image) light = light_of(1);
    SCOPED(hada_image) other = small_scene(1, ROWS, COLS, 50);
    SCOPED(hada_image) merged = {0};
    SCOPED(hada_image) weights = {0};
    hada_image frames[2] = {expose(&light, 1.0, 0.0, 1), expose(&other, 0.5, 0.0, 1)};
    ASSERT_FAILS(hada_image_merge_exposures(&merged, &weights, frames, 2, HADA_MOSAIC_NONE, NULL, NULL, err),
                 HADA_ERROR_NUMERIC, "same scene");
    ASSERT_FAILS(hada_image_merge_exposures(&merged, NULL, frames, 1, HADA_MOSAIC_NONE, NULL, NULL, err),
                 HADA_ERROR_ARGUMENT, "two exposures");
    ASSERT_FAILS(hada_image_merge_exposures(&merged, NULL, frames, 2, HADA_MOSAIC_AUTO, NULL, NULL, err),
                 HADA_ERROR_ARGUMENT, "pattern");
    hada_image_destroy(&frames[1]);
    frames[1] = expose(&light, 1e4, 0.0, 1); /* saturates nearly all */
    ASSERT_FAILS(hada_image_merge_exposures(&merged, &weights, frames, 2, HADA_MOSAIC_NONE, NULL, NULL, err),
                 HADA_ERROR_NUMERIC, "exposure between");
    frames[1].rows--;
    ASSERT_FAILS(hada_image_merge_exposures(&merged, NULL, frames, 2, HADA_MOSAIC_NONE, NULL, NULL, err),
                 HADA_ERROR_SIZE, "47 x 60");
    frames[1].rows++;
    assert_null(merged.data);
    assert_null(weights.data);
    destroy_images(frames, 2);
}

static void save(const char *path, const hada_image *images, int count)
{
    hada_tiff_writer *writer;
    DEFAULTS(hada_tiff_write_options, options);
    options.slices = count;
    ASSERT_OK(hada_tiff_create(&writer, path, 1, ROWS, COLS, &options, err));
    for (int i = 0; i < count; i++)
        ASSERT_OK(hada_tiff_write(writer, &images[i], err));
    ASSERT_OK(hada_tiff_finish(&writer, err));
}

/* Pages and files alike are exposures. */
TEST(files_of_exposures)
{
    SCOPED(hada_image) light = light_of(1);
    SCOPED(hada_image) merged = {0};
    SCOPED(hada_image) weights = {0};
    SCOPED(hada_image) expected = {0};
    SCOPED(hada_image) expected_weights = {0};
    hada_image frames[EXPOSURES];
    char first[64], second[64];
    for (int i = 0; i < EXPOSURES; i++)
        frames[i] = expose(&light, lengths[i], 0.003, (uint64_t)i + 1);
    make_path(first);
    make_path(second);
    save(first, frames, 2);
    save(second, &frames[2], 1);
    const char *paths[] = {first, second, "/nowhere/none.tif"};
    ASSERT_FAILS(hada_exposures_load(&merged, &weights, paths, 3, HADA_AUTO, HADA_MOSAIC_NONE, NULL, err),
                 HADA_ERROR_FILE_OPEN, "none.tif");
    ASSERT_OK(hada_exposures_load(&merged, &weights, paths, 2, HADA_AUTO, HADA_MOSAIC_NONE, NULL, err));
    ASSERT_OK(
        hada_image_merge_exposures(&expected, &expected_weights, frames, EXPOSURES, HADA_MOSAIC_NONE, NULL, NULL, err));
    assert_memory_equal(merged.data, expected.data, hada_image_count(&light) * sizeof(float));
    assert_memory_equal(weights.data, expected_weights.data, hada_image_count(&light) * sizeof(float));
    destroy_images(frames, EXPOSURES);
    remove(first);
    remove(second);
}
