/* Flat frames: what pixels make of the same light, division by it, saturated and unlit pixels, planes, models that keep
 * one, cameras that are learned from divided frames. */
#include "camera_small.h"
#include "device_fixture.h"
#include "image/pixels.h"
#include "io_testing.h"
#include "planes/maker.h"
#include "ref/ref_mosaic.h"

enum { ROWS = 60, COLS = 72, WINDOW = 24, CHANNELS = 3, AREA = ROWS * COLS, COUNT = CHANNELS * AREA };
#define DARK 0.05

/* Light that falls off towards the borders; a spot of dust, and a few pixels that see nothing. */
static hada_image sensor(int channels)
{
    hada_image flat;
    hada_random random;
    hada_random_seed(&random, 8, 0);
    ASSERT_OK(hada_image_create(&flat, channels, ROWS, COLS, err));
    for (int i = 0; i < channels * AREA; i++) {
        const double y = i % AREA / COLS / (ROWS / 2.0) - 1.0, x = i % COLS / (COLS / 2.0) - 1.0;
        const double dust = hypot(i % AREA / COLS - 20.0, i % COLS - 30.0) < 3.0 ? 0.3 : 1.0;
        const double value = dust * (1.0 + 0.02 * hada_random_normal(&random)) / pow(1.0 + 0.5 * (x * x + y * y), 2.0);
        flat.data[i] = i % AREA % 997 == 500 ? 0.0f : (float)(0.6 * value * (1.0 + 0.3 * (i / AREA)));
    }
    return flat;
}

/* What the sensor makes of a frame's light. */
static hada_image through(const hada_image *frame, const hada_image *flat, double dark)
{
    hada_image seen;
    ASSERT_OK(hada_image_copy(&seen, frame, err));
    for (size_t i = 0; i < hada_image_count(frame); i++)
        seen.data[i] = (float)(frame->data[i] * flat->data[i % hada_image_count(flat)] / 0.6 + dark);
    return seen;
}

/* 1 in the mean of each channel or, of a mosaic, of each colour; 0 where hardly any light is seen. */
TEST(sensitivity_is_relative_to_the_colour)
{
    static const hada_mosaic patterns[] = {HADA_MOSAIC_NONE, HADA_MOSAIC_BGGR};
    for (int k = 0; k < 2; k++) {
        SCOPED(hada_image) colours = sensor(CHANNELS);
        SCOPED(hada_image) flat = {0};
        SCOPED(hada_image) got = {0};
        SCOPED(hada_image) again = {0};
        ASSERT_OK(hada_image_copy(&flat, &colours, err));
        if (k) {
            flat.channels = 1;
            hada_mosaic_take(patterns[k], colours.data, ROWS, COLS, flat.data);
        }
        ASSERT_OK(hada_flat_sensitivity(&got, &flat, CHANNELS, patterns[k], err));
        for (int c = 0; c < CHANNELS; c++) {
            double sum = 0.0;
            int count = 0;
            for (int i = 0; i < AREA; i++)
                if (!k || hada_ref_mosaic_channel("bggr", i / COLS, i % COLS) == c) {
                    sum += colours.data[c * AREA + i];
                    count++;
                }
            for (int i = 0; i < AREA; i++) {
                const double expected = colours.data[c * AREA + i] / (sum / count);
                if (k && hada_ref_mosaic_channel("bggr", i / COLS, i % COLS) != c)
                    continue;
                if (fabs(got.data[c * AREA + i] - expected) > 1e-6 || (expected == 0.0) != (i % 997 == 500))
                    fail_msg("mosaic %d, channel %d, pixel %d: %g instead of %g", k, c, i,
                             (double)got.data[c * AREA + i], expected);
            }
        }
        ASSERT_OK(hada_flat_sensitivity(&again, &got, CHANNELS, HADA_MOSAIC_NONE, err));
        if (!k)
            assert_true(relative_change(again.data, got.data, COUNT) < 1e-6);
    }
}

TEST(corrected_frames_are_those_of_even_sensors)
{
    SCOPED(hada_image) flat = sensor(CHANNELS);
    SCOPED(hada_image) scene = small_scene(CHANNELS, ROWS, COLS, 4);
    SCOPED(hada_image) sensitivity = {0};
    ASSERT_OK(hada_flat_sensitivity(&sensitivity, &flat, CHANNELS, HADA_MOSAIC_NONE, err));
    for (int mosaic = 0; mosaic < 2; mosaic++) {
        SCOPED(hada_image) seen = through(&scene, &sensitivity, 0.0);
        for (size_t i = 0; i < COUNT; i++)
            seen.data[i] = seen.data[i] * 0.6f + (float)DARK;
        if (mosaic) {
            hada_mosaic_take(HADA_MOSAIC_GRBG, seen.data, ROWS, COLS, seen.data);
            seen.channels = 1;
        }
        ASSERT_OK(hada_flat_correct(&seen, mosaic ? HADA_MOSAIC_GRBG : HADA_MOSAIC_NONE, &sensitivity, DARK, err));
        for (int i = 0; i < (int)hada_image_count(&seen); i++) {
            const int c = mosaic ? hada_ref_mosaic_channel("grbg", i / COLS, i % COLS) : i / AREA;
            const double expected = scene.data[c * AREA + i % AREA] + DARK, got = seen.data[i];
            if (i % AREA % 997 == 500) /* from its neighbours */
                assert_true(got >= DARK && got <= 1.0 + DARK);
            else if (fabs(got - expected) > 2e-6)
                fail_msg("mosaic %d, value %d: %g instead of %g", mosaic, i, got, expected);
        }
    }
    SCOPED(hada_image) small = small_scene(CHANNELS, ROWS, COLS - 1, 4);
    ASSERT_FAILS(hada_flat_correct(&small, HADA_MOSAIC_NONE, &sensitivity, 0.0, err), HADA_ERROR_SIZE, "60 x 71");
    memset(flat.data + AREA, 0, AREA * sizeof *flat.data);
    SCOPED(hada_image) none = {0};
    ASSERT_FAILS(hada_flat_sensitivity(&none, &flat, CHANNELS, HADA_MOSAIC_NONE, err), HADA_ERROR_NUMERIC, "no light");
}

/* Saturation shows in values as they came. Levels that are estimated are those of divided frames. */
TEST(exposures_are_divided)
{
    const hada_model_info info = {
        .channels = CHANNELS, .raw_rows = ROWS, .raw_cols = COLS, .grid_rows = ROWS, .grid_cols = COLS};
    SCOPED(hada_image) flat = sensor(CHANNELS);
    SCOPED(hada_image) scene = small_scene(CHANNELS, ROWS, COLS, 4);
    SCOPED(hada_image) sensitivity = {0};
    ASSERT_OK(hada_flat_sensitivity(&sensitivity, &flat, CHANNELS, HADA_MOSAIC_NONE, err));
    SCOPED(hada_image) seen = through(&scene, &sensitivity, 0.0);
    static float weights[COUNT], given[COUNT];
    const float white = 1.0f;
    double energy = 0.0;
    size_t clipped = 0;
    for (size_t i = 0; i < COUNT; i++) {
        seen.data[i] = fminf(seen.data[i] + (float)DARK, white);
        clipped += seen.data[i] == white;
        given[i] = fminf(sensitivity.data[i], 1.0f);
    }
    assert_true(clipped > 100);
    for (int varies = 0; varies < 2; varies++) {
        const hada_exposure_rule rule = {.dark = DARK,
                                         .dark_varies = varies,
                                         .energy = 1,
                                         .weights = 1,
                                         .repairs = 1,
                                         .pixel_weights = given,
                                         .flat = &sensitivity};
        hada_frame_exposure exposure;
        hada_pixels pixels;
        hada_pixels_of_image(&pixels, &seen);
        ASSERT_OK(hada_exposure_begin(&exposure, &info, &hada_frame_plain, &pixels, err));
        ASSERT_OK(hada_exposure_examine(&exposure, &rule, err));
        assert_true(exposure.saturated >= clipped &&
                    exposure.saturated <= clipped + 4 * CHANNELS); /* unlit: as beside */
        assert_int_equal(exposure.repaired, 0);
        hada_exposure_weigh(&exposure, weights);
        energy = 0.0;
        for (size_t i = 0; i < COUNT; i++) {
            const double level = varies ? exposure.levels[CHANNELS + i / AREA] : DARK, s = sensitivity.data[i];
            const double expected = s > 0.0 ? level + (seen.data[i] - level) / s : exposure.own.data[i];
            if (fabs(exposure.own.data[i] - expected) > 1e-5)
                fail_msg("value %zu: %g instead of %g", i, (double)exposure.own.data[i], expected);
            assert_true(weights[i] == (seen.data[i] == white ? -given[i] : given[i]));
            if (seen.data[i] == white)
                assert_true(hada_exposure_brightest(&exposure, i) == exposure.own.data[i]);
            energy += pow(exposure.own.data[i] - exposure.levels[i / AREA], 2.0);
        }
        assert_true(fabs(exposure.energy / energy - 1.0) < 1e-6);
        assert_true(!varies || fabs(exposure.levels[0] - DARK) < 0.02);
        hada_exposure_end(&exposure);
    }
}

static hada_result run(const hada_model *model, const hada_image *frame, const hada_image *flat)
{
    DEFAULTS(hada_plan_options, options);
    hada_result result = {0};
    hada_plan *plan;
    options.flat_frame = flat;
    ASSERT_OK(hada_plan_create(&plan, context, model, &options, err));
    ASSERT_OK(hada_plan_run(plan, frame, &result, err));
    hada_plan_destroy(&plan);
    return result;
}

/* Planes are nearly those of an even sensor; a model in a file keeps its flat frame. */
TEST(planes_of_divided_frames)
{
    static const hada_boundary boundaries[] = {HADA_BOUNDARY_CIRCULAR, HADA_BOUNDARY_PADDED};
    const double distance = 100.0;
    for (size_t k = 0; k < 2; k++) {
        SCOPED(hada_image) psf = small_psf(CHANNELS, ROWS, COLS, 8, 3);
        SCOPED(hada_image) scene = small_scene(CHANNELS, WINDOW, WINDOW, 1);
        SCOPED(hada_image) flat = sensor(1);
        DEFAULTS(hada_psf_options, options);
        hada_model *model, *loaded;
        options.window_rows = options.window_cols = WINDOW;
        options.psf_dark = 0;
        options.dark = DARK;
        options.boundary = boundaries[k];
        ASSERT_OK(hada_model_from_psf(&model, context, &psf, 1, &distance, &options, err));
        SCOPED(hada_image) even = small_frame(&psf, &scene, boundaries[k] == HADA_BOUNDARY_PADDED, 0.002, 5);
        SCOPED(hada_image) seen = through(&even, &flat, DARK);
        for (int i = 0; i < COUNT; i++)
            even.data[i] += (float)DARK;
        const hada_image *frames[] = {&even, &seen, &seen}, *flats[] = {NULL, &flat, NULL};
        double error[3];
        hada_result results[3];
        for (int i = 0; i < 3; i++) {
            results[i] = run(model, frames[i], flats[i]);
            const hada_image *plane = &results[i].planes[0];
            double a = 0.0, b = 0.0; /* the mean sensitivity is not told from the scene's brightness */
            for (size_t j = 0; j < hada_image_count(plane); j++) {
                a += (double)plane->data[j] * scene.data[j];
                b += (double)plane->data[j] * plane->data[j];
            }
            for (size_t j = 0; j < hada_image_count(plane); j++)
                plane->data[j] *= (float)(a / b);
            error[i] = relative_change(plane->data, scene.data, hada_image_count(plane));
        }
        if (error[1] > fmin(1.8 * error[0], 0.05) || error[2] < 2.5 * error[1])
            fail_msg("boundary %zu: error %.3g of an even sensor, %.3g with the flat frame, %.3g without it", k,
                     error[0], error[1], error[2]);

        char path[64];
        SCOPED(hada_image) sensitivity = {0};
        ASSERT_OK(hada_flat_sensitivity(&sensitivity, &flat, 1, HADA_MOSAIC_NONE, err));
        ASSERT_OK(hada_model_set_flat(model, &sensitivity, err));
        make_path(path);
        ASSERT_OK(hada_model_save(model, path, err));
        ASSERT_OK(hada_model_load(&loaded, path, err));
        assert_memory_equal(hada_model_get_info(loaded)->flat->data, hada_model_get_info(model)->flat->data,
                            COUNT * sizeof(float));
        hada_result given = run(loaded, &seen, &flat), kept = run(loaded, &seen, NULL);
        assert_memory_equal(given.planes[0].data, kept.planes[0].data,
                            hada_image_count(&kept.planes[0]) * sizeof(float));
        ((float *)hada_model_get_info(loaded)->flat->data)[7] = -1.0f;
        ASSERT_FAILS(hada_model_save(loaded, path, err), HADA_ERROR_MODEL, "flat"); /* as it could not be read again */
        hada_model_destroy(&loaded);
        remove(path);
        hada_result_destroy(&given);
        hada_result_destroy(&kept);
        for (int i = 0; i < 3; i++)
            hada_result_destroy(&results[i]);
        hada_model_destroy(&model);
    }
}

TEST(flat_frames_that_do_not_fit)
{
    const double distance = 100.0;
    SCOPED(hada_image) psf = small_psf(CHANNELS, ROWS, COLS, 8, 3);
    SCOPED(hada_image) flat = sensor(CHANNELS);
    SCOPED(hada_model) * model;
    hada_plan *plan = NULL;
    DEFAULTS(hada_plan_options, options);
    ASSERT_OK(hada_model_from_psf(&model, context, &psf, 1, &distance, NULL, err));
    options.flat_frame = &flat;
    flat.rows--;
    ASSERT_FAILS(hada_plan_create(&plan, context, model, &options, err), HADA_ERROR_SIZE, "59 x 72");
    flat.rows++;
    memset(flat.data, 0, COUNT * sizeof *flat.data);
    ASSERT_FAILS(hada_plan_create(&plan, context, model, &options, err), HADA_ERROR_NUMERIC, "no light");
    assert_null(plan);
}

enum { PAIRS = 5 };

/* A fit learns from divided frames, and its model divides frames; a training needs them divided too. */
TEST(cameras_are_learned_from_divided_frames)
{
    const double distance = 100.0;
    const int count = PAIRS;
    SCOPED(hada_image) psf = small_psf(CHANNELS, ROWS, COLS, 8, 3);
    SCOPED(hada_image) flat = sensor(CHANNELS);
    hada_image frames[PAIRS], scenes[PAIRS];
    for (int i = 0; i < PAIRS; i++) {
        scenes[i] = small_scene(CHANNELS, WINDOW, WINDOW, (uint64_t)i + 20);
        SCOPED(hada_image) even = small_frame(&psf, &scenes[i], 0, 0.002, (uint64_t)i + 20);
        frames[i] = through(&even, &flat, DARK);
    }
    small_pairs of = {frames, scenes};
    double error[2];
    for (int k = 0; k < 2; k++) {
        DEFAULTS(hada_dataset_options, scan);
        DEFAULTS(hada_fit_options, fit);
        DEFAULTS(hada_fit_task, task);
        hada_dataset *pairs;
        SCOPED(hada_model) * model;
        scan.flat_frame = k ? &flat : NULL;
        scan.flat_dark = fit.dark = DARK;
        fit.scene_response = HADA_RESPONSE_LINEAR;
        fit.refine_steps = 0;
        task.fit = &fit;
        task.boundary = HADA_BOUNDARY_CIRCULAR;
        ASSERT_OK(hada_dataset_create(&pairs, 1, &distance, &count, small_read_pair, &of, &scan, err));
        ASSERT_OK(hada_fit_run(&model, NULL, context, pairs, &task, err));
        assert_true((hada_model_get_info(model)->flat != NULL) == k);
        hada_result result = run(model, &frames[0], NULL);
        error[k] = relative_change(result.planes[0].data, scenes[0].data, hada_image_count(&scenes[0]));
        hada_result_destroy(&result);
        hada_dataset_destroy(&pairs);
        if (k) {
            DEFAULTS(hada_train_task, train);
            scan.flat_frame = NULL;
            train.model = model;
            train.output = io_path("trained.model");
            ASSERT_OK(hada_dataset_create(&pairs, 1, &distance, &count, small_read_pair, &of, &scan, err));
            ASSERT_FAILS(hada_train_run(&context, 1, pairs, &train, err), HADA_ERROR_MODEL, "flat frame");
            hada_dataset_destroy(&pairs);
        }
    }
    if (error[1] > 0.6 * error[0])
        fail_msg("error %.3g with the flat frame, %.3g without it", error[1], error[0]);
    for (int i = 0; i < PAIRS; i++) {
        hada_image_destroy(&frames[i]);
        hada_image_destroy(&scenes[i]);
    }
}

/* Hot pixels of all channels: beside the window, where the frame is not the scene's random pixels themselves. */
static int is_bad(int k)
{
    const int row = k % AREA / COLS, col = k % COLS;
    return row % 7 == 3 && (col == 5 || col == 65);
}

/* Bad pixels and light of the room are found, and the model knows them: frames give what those of a sound sensor in the
 * dark give. A training needs frames without them, too. */
TEST(cameras_are_learned_from_poor_frames)
{
    const double distance = 100.0;
    const int count = PAIRS;
    SCOPED(hada_image) psf = small_psf(CHANNELS, ROWS, COLS, 8, 3);
    hada_image frames[PAIRS + 1], scenes[PAIRS + 1];
    small_pairs of = {frames, scenes};
    double error[2];
    for (int poor = 0; poor < 2; poor++) {
        DEFAULTS(hada_fit_options, fit);
        DEFAULTS(hada_fit_task, task);
        DEFAULTS(hada_plan_options, plain);
        SCOPED(hada_model) * model;
        hada_dataset *pairs;
        for (int i = 0; i <= PAIRS; i++) {
            scenes[i] = small_scene(CHANNELS, WINDOW, WINDOW, (uint64_t)i + 20);
            frames[i] = small_frame(&psf, &scenes[i], 0, 0.002, (uint64_t)i + 20);
            for (int k = 0; k < COUNT; k++) {
                float *value = &frames[i].data[k];
                *value *= 0.4f;
                if (poor)
                    *value = is_bad(k) ? 1.0f : *value + 0.1f + 0.1f * (float)(k % COLS) / COLS;
            }
        }
        fit.scene_response = HADA_RESPONSE_LINEAR;
        fit.refine_steps = 10;
        task.fit = &fit;
        task.boundary = HADA_BOUNDARY_CIRCULAR;
        ASSERT_OK(hada_dataset_create(&pairs, 1, &distance, &count, small_read_pair, &of, NULL, err));
        ASSERT_OK(hada_fit_run(&model, NULL, context, pairs, &task, err));
        const hada_model_info *info = hada_model_get_info(model);
        assert_true((info->flat != NULL) == poor && (info->dark_frame != NULL) == poor);
        hada_result result = run(model, &frames[PAIRS], NULL);
        error[poor] = relative_change(result.planes[0].data, scenes[PAIRS].data, hada_image_count(&scenes[0]));
        if (poor) {
            DEFAULTS(hada_train_task, train);
            hada_model *loaded;
            char path[64];
            for (int k = 0; k < COUNT; k++)
                if ((info->flat->data[k] == 0.0f) != is_bad(k))
                    fail_msg("value %d is taken for %s", k, info->flat->data[k] == 0.0f ? "bad" : "sound");
            make_path(path);
            ASSERT_OK(hada_model_save(model, path, err));
            ASSERT_OK(hada_model_load(&loaded, path, err));
            assert_memory_equal(hada_model_get_info(loaded)->dark_frame->data, info->dark_frame->data,
                                COUNT * sizeof(float));
            hada_result kept = run(loaded, &frames[PAIRS], NULL);
            assert_memory_equal(kept.planes[0].data, result.planes[0].data,
                                hada_image_count(&kept.planes[0]) * sizeof(float));
            hada_result_destroy(&kept);
            plain.dark = HADA_DARK_FRAME; /* in place of the model's, and its level */
            SCOPED(hada_image) given = {0};
            ASSERT_OK(hada_image_copy(&given, info->dark_frame, err));
            for (int k = 0; k < COUNT; k++)
                given.data[k] += (float)info->dark;
            plain.dark_frame = &given;
            hada_plan *plan;
            hada_result same = {0};
            ASSERT_OK(hada_plan_create(&plan, context, loaded, &plain, err));
            ASSERT_OK(hada_plan_run(plan, &frames[PAIRS], &same, err));
            assert_true(relative_change(same.planes[0].data, result.planes[0].data, hada_image_count(&same.planes[0])) <
                        1e-3);
            hada_result_destroy(&same);
            hada_plan_destroy(&plan);
            ((float *)hada_model_get_info(loaded)->dark_frame->data)[7] = NAN;
            ASSERT_FAILS(hada_model_save(loaded, path, err), HADA_ERROR_MODEL, "dark_frame");
            hada_model_destroy(&loaded);
            remove(path);
            train.model = model;
            train.output = io_path("trained.model");
            ASSERT_FAILS(hada_train_run(&context, 1, pairs, &train, err), HADA_ERROR_MODEL, "dark frame");
        }
        hada_result_destroy(&result);
        hada_dataset_destroy(&pairs);
        for (int i = 0; i <= PAIRS; i++) {
            hada_image_destroy(&frames[i]);
            hada_image_destroy(&scenes[i]);
        }
    }
    if (error[1] > 1.3 * error[0])
        fail_msg("error %.3g from poor frames, %.3g from good ones", error[1], error[0]);
}

FIXTURE(open_device, close_device)
