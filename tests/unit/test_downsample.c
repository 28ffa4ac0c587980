/* Binned frames: means, mosaics, saturated pixels; plans that take frames of the sensor's size; pairs that are binned,
 * and models and sums that say so. */
#include "camera_small.h"
#include "device_fixture.h"
#include "image/mosaic.h"
#include "io_testing.h"
#include "model/model.h"
#include "ref/ref_mosaic.h"

enum {
    N = 4,
    ROWS = 64,
    COLS = 72,
    WINDOW = 24,
    CHANNELS = 3,
    AREA = ROWS * COLS,
    SIDE = N * ROWS + 3,
    WIDE = N * COLS
};
static const char *const names[] = {NULL, "grbg", "bggr"};
static const hada_mosaic patterns[] = {HADA_MOSAIC_NONE, HADA_MOSAIC_GRBG, HADA_MOSAIC_BGGR};

/* The mean of a bin's pixels, of a mosaic of those that hold the colour, in double precision. */
static double mean(const hada_image *image, const char *pattern, int factor, int channel, int row, int col)
{
    double sum = 0.0;
    int count = 0;
    for (int r = row * factor; r < (row + 1) * factor; r++)
        for (int c = col * factor; c < (col + 1) * factor; c++)
            if (!pattern || hada_ref_mosaic_channel(pattern, r, c) == channel) {
                const int plane = pattern ? 0 : channel;
                sum += image->data[(plane * image->rows + r) * image->cols + c];
                count++;
            }
    return sum / count;
}

TEST(bins_are_means)
{
    for (int factor = 1; factor <= 6; factor++)
        for (int k = 0; k < 3; k++) {
            SCOPED(hada_image) image = small_scene(k ? 1 : CHANNELS, 25, 38, (uint64_t)k + 3);
            SCOPED(hada_image) got = {0};
            if (k && factor % 2) {
                ASSERT_FAILS(hada_image_downsample(&got, &image, factor, patterns[k], 1, err), HADA_ERROR_ARGUMENT,
                             "even number");
                continue;
            }
            ASSERT_OK(hada_image_downsample(&got, &image, factor, patterns[k], 1, err));
            assert_int_equal(got.channels, CHANNELS);
            assert_int_equal(got.rows, 25 / factor);
            assert_int_equal(got.cols, 38 / factor);
            size_t i = 0;
            for (int c = 0; c < CHANNELS; c++)
                for (int row = 0; row < got.rows; row++)
                    for (int col = 0; col < got.cols; col++, i++) /* summed in double precision, rounded once */
                        assert_true(fabs(got.data[i] - mean(&image, names[k], factor, c, row, col)) <= 0x1p-24);
        }
}

/* Bins that hold a value at which a channel is cut off have it; those that hold a NaN are NaN. */
TEST(saturated_bins_stay_saturated)
{
    for (int k = 0; k < 2; k++) {
        SCOPED(hada_image) image = small_scene(1, 40, 60, 5);
        SCOPED(hada_image) marked = {0};
        SCOPED(hada_image) means = {0};
        for (size_t i = 0; i < hada_image_count(&image); i++)
            image.data[i] = i % 7 == 0 ? 0.9f : 0.85f * image.data[i];
        image.data[3] = NAN;
        ASSERT_OK(hada_image_downsample(&marked, &image, 2, patterns[k], 1, err));
        ASSERT_OK(hada_image_downsample(&means, &image, 2, patterns[k], 0, err));
        int saturated = 0, broken = 0;
        size_t i = 0;
        for (int c = 0; c < marked.channels; c++)
            for (int row = 0; row < 20; row++)
                for (int col = 0; col < 30; col++, i++) {
                    int holds = 0;
                    for (int j = 0; j < 4; j++) {
                        const int r = 2 * row + j / 2, q = 2 * col + j % 2;
                        holds |= image.data[r * 60 + q] == 0.9f && (!k || hada_ref_mosaic_channel("grbg", r, q) == c);
                    }
                    if (isnan(means.data[i])) {
                        assert_true(isnan(marked.data[i]));
                        broken++;
                    } else {
                        assert_true(marked.data[i] == (holds ? 0.9f : means.data[i]));
                        saturated += holds;
                    }
                }
        assert_int_equal(broken, 1);
        assert_true(saturated > 100);
    }
}

TEST(images_that_cannot_be_binned)
{
    SCOPED(hada_image) image = small_scene(1, 8, 9, 5);
    SCOPED(hada_image) colours = small_scene(3, 8, 9, 5);
    hada_image got;
    ASSERT_FAILS(hada_image_downsample(&got, &image, 0, HADA_MOSAIC_NONE, 0, err), HADA_ERROR_ARGUMENT, "by 0");
    ASSERT_FAILS(hada_image_downsample(&got, &image, 9, HADA_MOSAIC_NONE, 0, err), HADA_ERROR_ARGUMENT, "8 x 9");
    ASSERT_FAILS(hada_image_downsample(&got, &colours, 2, HADA_MOSAIC_RGGB, 0, err), HADA_ERROR_ARGUMENT, "3 channel");
    ASSERT_FAILS(hada_image_downsample(&got, &image, 2, HADA_MOSAIC_AUTO, 0, err), HADA_ERROR_ARGUMENT, "mosaic");
    assert_null(got.data);
}

/* A frame of the sensor: what a small one shows, in more pixels, with noise. */
static hada_image enlarge(const hada_image *small, const char *pattern, int rows, uint64_t seed)
{
    hada_image image;
    hada_random random;
    hada_random_seed(&random, seed, 1);
    ASSERT_OK(hada_image_create(&image, pattern ? 1 : small->channels, rows, WIDE, err));
    for (size_t i = 0; i < hada_image_count(&image); i++) {
        const int row = (int)(i / WIDE) % rows, col = (int)(i % WIDE);
        const int c = pattern ? hada_ref_mosaic_channel(pattern, row, col) : (int)(i / WIDE) / rows;
        const int from = row / N < small->rows ? row / N : small->rows - 1;
        image.data[i] =
            small->data[(c * small->rows + from) * small->cols + col / N] + 0.004f * (float)hada_random_normal(&random);
    }
    return image;
}

static hada_model *make(int downsample, hada_mosaic mosaic)
{
    const double distance = 100.0;
    SCOPED(hada_image) psf = small_psf(CHANNELS, ROWS, COLS, 8, 3);
    DEFAULTS(hada_psf_options, options);
    hada_model *model;
    options.window_rows = options.window_cols = WINDOW;
    options.psf_dark = 0;
    options.downsample = downsample;
    options.mosaic = mosaic;
    options.refine_tv = 0.01;
    ASSERT_OK(hada_model_from_psf(&model, context, &psf, 1, &distance, &options, err));
    return model;
}

static void compare(const hada_model *model, const hada_image *frame, const hada_plan_options *options,
                    const hada_image *small, const hada_plan_options *small_options)
{
    SCOPED(hada_plan) * plan, *small_plan;
    SCOPED(hada_result) result = {0}, expected = {0};
    DEFAULTS(hada_pixels, pixels);
    hada_match match = {.size = sizeof match}, small_match = {.size = sizeof small_match};
    uint64_t device, host, small_host;
    ASSERT_OK(hada_plan_create(&plan, context, model, options, err));
    ASSERT_OK(hada_plan_create(&small_plan, context, model, small_options, err));
    ASSERT_OK(hada_plan_run(plan, frame, &result, err));
    ASSERT_OK(hada_plan_run(small_plan, small, &expected, err));
    assert_memory_equal(result.planes[0].data, expected.planes[0].data,
                        hada_image_count(&expected.planes[0]) * sizeof(float));
    hada_pixels_planar(&pixels, frame->data, HADA_PIXEL_F32, frame->channels, frame->rows, frame->cols);
    ASSERT_OK(hada_plan_match(plan, &pixels, &match, err));
    hada_pixels_planar(&pixels, small->data, HADA_PIXEL_F32, small->channels, small->rows, small->cols);
    ASSERT_OK(hada_plan_match(small_plan, &pixels, &small_match, err));
    assert_int_equal(match.verdict, small_match.verdict);
    assert_true(match.unexplained == small_match.unexplained);
    ASSERT_OK(hada_plan_estimate(context, model, options, &device, &host, err));
    ASSERT_OK(hada_plan_estimate(context, model, small_options, &device, &small_host, err));
    assert_true(host >= small_host);
}

/* A frame of the sensor gives what its binned frame gives, with all that is said of its pixels. */
TEST(plans_take_frames_of_the_sensor)
{
    for (int k = 0; k < 3; k++) {
        SCOPED(hada_image) psf = small_psf(CHANNELS, ROWS, COLS, 8, 3);
        SCOPED(hada_image) scene = small_scene(CHANNELS, WINDOW, WINDOW, 1);
        SCOPED(hada_image) light = small_frame(&psf, &scene, 1, 0.0, 5);
        SCOPED(hada_image) flat_light = small_scene(CHANNELS, ROWS, COLS, 9);
        for (int i = 0; i < CHANNELS * AREA; i++)
            flat_light.data[i] = 0.7f + 0.3f * flat_light.data[i];
        /* whole, binned: frame, dark frame, flat frame, weights */
        hada_image image[4], binned[4];
        for (int i = 0; i < 4; i++) {
            image[i] = enlarge(i ? &flat_light : &light, names[k], i ? N * ROWS : SIDE, (uint64_t)i);
            for (size_t j = 0; i == 1 && j < hada_image_count(&image[i]); j++)
                image[i].data[j] *= 0.02f;
            ASSERT_OK(hada_image_downsample(&binned[i], &image[i], N, patterns[k], i == 0, err));
        }
        SCOPED(hada_model) *known = make(N, patterns[k]), *plain = make(1, HADA_MOSAIC_NONE);
        for (int with = 0; with < 2; with++) {
            DEFAULTS(hada_plan_options, whole);
            DEFAULTS(hada_plan_options, small);
            if (with) {
                whole.dark = small.dark = HADA_DARK_FRAME;
                whole.dark_frame = &image[1];
                whole.flat_frame = &image[2];
                whole.pixel_weights = &image[3];
                small.dark_frame = &binned[1];
                small.flat_frame = &binned[2];
                small.pixel_weights = &binned[3];
            }
            compare(known, &image[0], &whole, &binned[0], &small);
            compare(known, &binned[0], &small, &binned[0], &small);
            whole.downsample = N;
            whole.mosaic = patterns[k];
            compare(plain, &image[0], &whole, &binned[0], &small);
        }
        destroy_images(image, 4);
        destroy_images(binned, 4);
    }
}

TEST(plans_refuse_other_sizes)
{
    SCOPED(hada_model) *model = make(1, HADA_MOSAIC_NONE);
    SCOPED(hada_image) small = small_scene(CHANNELS, ROWS, COLS, 1);
    SCOPED(hada_image) frame = enlarge(&small, NULL, N * ROWS, 1);
    SCOPED(hada_image) mosaic = enlarge(&small, "grbg", N * ROWS, 1);
    DEFAULTS(hada_plan_options, options);
    hada_result result = {0};
    hada_plan *plan = NULL;
    ASSERT_OK(hada_plan_create(&plan, context, model, &options, err));
    ASSERT_FAILS(hada_plan_run(plan, &frame, &result, err), HADA_ERROR_MODEL, "4 times the 64 x 72");
    hada_plan_destroy(&plan);
    options.downsample = N;
    ASSERT_OK(hada_plan_create(&plan, context, model, &options, err));
    ASSERT_FAILS(hada_plan_run(plan, &mosaic, &result, err), HADA_ERROR_MODEL, "one channel");
    frame.rows = N * ROWS - 1;
    ASSERT_FAILS(hada_plan_run(plan, &frame, &result, err), HADA_ERROR_MODEL, "255 x 288");
    hada_plan_destroy(&plan);
    options.downsample = 3;
    options.mosaic = HADA_MOSAIC_RGGB;
    ASSERT_FAILS(hada_plan_create(&plan, context, model, &options, err), HADA_ERROR_ARGUMENT, "even number");
    options.downsample = 0;
    ASSERT_FAILS(hada_plan_create(&plan, context, model, &options, err), HADA_ERROR_ARGUMENT, "downsample");
    assert_null(plan);
}

enum { PAIRS = 5 };

/* A camera learned from binned pairs is that of pairs that were binned before, and bins frames; its file and its sums
 * say so. */
TEST(cameras_are_learned_from_binned_pairs)
{
    const double distance = 100.0;
    const int count = PAIRS;
    for (int k = 0; k < 2; k++) {
        SCOPED(hada_image) psf = small_psf(CHANNELS, ROWS, COLS, 8, 3);
        SCOPED(hada_image) flat_light = small_scene(CHANNELS, ROWS, COLS, 9);
        SCOPED(hada_image) flat = enlarge(&flat_light, NULL, N * ROWS, 4);
        hada_image frames[PAIRS], scenes[PAIRS], small_frames[PAIRS], small_scenes[PAIRS];
        for (int i = 0; i < PAIRS; i++) {
            SCOPED(hada_image) scene = small_scene(CHANNELS, WINDOW, WINDOW, (uint64_t)i + 20);
            SCOPED(hada_image) light = small_frame(&psf, &scene, 0, 0.0, (uint64_t)i + 20);
            frames[i] = enlarge(&light, names[k], N * ROWS, (uint64_t)i);
            scenes[i] = small_scene(CHANNELS, N * WINDOW, N * WINDOW, (uint64_t)i);
            for (int j = 0; j < CHANNELS * N * WINDOW * N * WINDOW; j++)
                scenes[i].data[j] =
                    scene.data[(j / (N * WINDOW) / N) * WINDOW + j % (N * WINDOW) / N] + 0.01f * scenes[i].data[j];
            ASSERT_OK(hada_image_downsample(&small_frames[i], &frames[i], N, patterns[k], 1, err));
            ASSERT_OK(hada_image_downsample(&small_scenes[i], &scenes[i], N, HADA_MOSAIC_NONE, 0, err));
        }
        small_pairs whole = {frames, scenes}, small = {small_frames, small_scenes};
        hada_model *model[2];
        char path[64], sums[80];
        make_path(path);
        snprintf(sums, sizeof sums, "%s.sums", path);
        for (int binned = 0; binned < 2; binned++) {
            DEFAULTS(hada_dataset_options, scan);
            DEFAULTS(hada_fit_options, fit);
            DEFAULTS(hada_fit_task, task);
            SCOPED(hada_dataset) * pairs;
            fit.scene_response = HADA_RESPONSE_LINEAR;
            fit.refine_steps = 0;
            task.fit = &fit;
            task.boundary = HADA_BOUNDARY_CIRCULAR;
            task.save_sums = binned ? sums : NULL;
            scan.downsample = binned ? N : 1;
            scan.mosaic = binned ? patterns[k] : HADA_MOSAIC_NONE;
            ASSERT_OK(hada_dataset_create(&pairs, 1, &distance, &count, small_read_pair, binned ? &whole : &small,
                                          &scan, err));
            assert_int_equal(hada_dataset_get_info(pairs)->downsample, binned ? N : 1);
            ASSERT_OK(hada_fit_run(&model[binned], NULL, context, pairs, &task, err));
        }
        const hada_model_info *info = hada_model_get_info(model[1]);
        hada_model_arrays arrays[2] = {{.size = sizeof arrays[0]}, {.size = sizeof arrays[1]}};
        ASSERT_OK(hada_model_get_arrays(model[0], &arrays[0], err));
        ASSERT_OK(hada_model_get_arrays(model[1], &arrays[1], err));
        assert_memory_equal(arrays[0].filters, arrays[1].filters,
                            2 * (size_t)CHANNELS * (size_t)info->grid_rows * (size_t)(info->grid_cols / 2 + 1) *
                                sizeof(float));
        assert_int_equal(hada_model_get_info(model[0])->downsample, 1);
        assert_int_equal(info->downsample, N);
        assert_int_equal(info->sensor_mosaic, patterns[k]);
        assert_int_equal(info->mosaic, HADA_MOSAIC_NONE);
        assert_int_equal(info->raw_rows, ROWS);

        /* the file, the sums */
        hada_model *loaded, *merged;
        ASSERT_OK(hada_model_save(model[1], path, err));
        ASSERT_OK(hada_model_load(&loaded, path, err));
        const char *files[] = {sums};
        DEFAULTS(hada_fit_task, merge);
        merge.merge = files;
        merge.merge_count = 1;
        ASSERT_OK(hada_fit_run(&merged, NULL, context, NULL, &merge, err));
        const hada_model *said[] = {loaded, merged};
        for (int i = 0; i < 2; i++) {
            assert_int_equal(hada_model_get_info(said[i])->downsample, N);
            assert_int_equal(hada_model_get_info(said[i])->sensor_mosaic, patterns[k]);
        }

        /* flat frames of either size; a training needs pairs that are binned too */
        DEFAULTS(hada_dataset_options, scan);
        DEFAULTS(hada_train_task, train);
        SCOPED(hada_image) small_flat = {0};
        hada_dataset *pairs;
        ASSERT_OK(hada_image_downsample(&small_flat, &flat, N, HADA_MOSAIC_NONE, 0, err));
        scan.downsample = N;
        scan.mosaic = patterns[k];
        for (int i = 0; i < 2; i++) {
            SCOPED(hada_image) raw, scene;
            scan.flat_frame = i ? &small_flat : k ? NULL : &flat;
            ASSERT_OK(hada_dataset_create(&pairs, 1, &distance, &count, small_read_pair, &whole, &scan, err));
            ASSERT_OK(hada_dataset_read(pairs, 0, 0, &raw, &scene, err));
            assert_int_equal(raw.rows, ROWS);
            assert_int_equal(raw.channels, CHANNELS);
            if (scan.flat_frame)
                ASSERT_OK(hada_model_set_flat(loaded, hada_dataset_get_info(pairs)->flat, err));
            assert_true(!scan.flat_frame || hada_model_get_info(loaded)->flat->rows == ROWS);
            hada_dataset_destroy(&pairs);
        }
        scan.downsample = 2;
        scan.flat_frame = NULL;
        train.model = model[1];
        train.output = io_path("trained.model");
        ASSERT_OK(hada_dataset_create(&pairs, 1, &distance, &count, small_read_pair, &whole, &scan, err));
        ASSERT_FAILS(hada_train_run(&context, 1, pairs, &train, err), HADA_ERROR_MODEL, "bins frames by 4");
        hada_dataset_destroy(&pairs);
        scan.downsample = 0;
        ASSERT_FAILS(hada_dataset_create(&pairs, 1, &distance, &count, small_read_pair, &whole, &scan, err),
                     HADA_ERROR_ARGUMENT, "downsample");
        remove(path);
        remove(sums);
        for (int i = 0; i < 2; i++)
            hada_model_destroy(&model[i]);
        hada_model_destroy(&loaded);
        hada_model_destroy(&merged);
        destroy_images(frames, PAIRS);
        destroy_images(scenes, PAIRS);
        destroy_images(small_frames, PAIRS);
        destroy_images(small_scenes, PAIRS);
    }
}

static hada_status read_one(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *error)
{
    const hada_image *frame = user;
    assert_int_equal(depth + pair, 0);
    const hada_status status = hada_image_copy(raw, frame, error);
    return status ? status : hada_image_create(scene, CHANNELS, N * WINDOW, N * WINDOW, error);
}

/* A dark frame of the sensor's size or of the binned one is subtracted, of mosaics too. */
TEST(dark_frames_are_subtracted)
{
    const double distance = 100.0;
    const int count = 1;
    for (int k = 0; k < 3; k++)
        for (int bins = 0; bins < 2; bins++) {
            DEFAULTS(hada_dataset_options, options);
            SCOPED(hada_image) frame = small_scene(k ? 1 : CHANNELS, N * ROWS, N * COLS, 8);
            SCOPED(hada_image) dark = small_scene(k ? 1 : CHANNELS, N * ROWS, N * COLS, 9);
            SCOPED(hada_image) expected = {0};
            SCOPED(hada_image) small = {0};
            options.mosaic = patterns[k];
            options.downsample = bins ? N : 1;
            for (int of = 0; of < 3; of++) { /* none, of the sensor, binned */
                SCOPED(hada_image) raw = {0};
                SCOPED(hada_image) scene = {0};
                SCOPED(hada_dataset) * data;
                options.dark_frame = of == 1 ? &dark : of == 2 ? &small : NULL;
                if (of == 2 && !bins)
                    continue;
                ASSERT_OK(hada_dataset_create(&data, 1, &distance, &count, read_one, &frame, &options, err));
                ASSERT_OK(hada_dataset_read(data, 0, 0, &raw, &scene, err));
                const hada_image *kept = hada_dataset_get_info(data)->dark_frame;
                assert_int_equal(kept != NULL, of > 0);
                if (of && relative_change(raw.data, expected.data, hada_image_count(&raw)) > 1e-6)
                    fail_msg("mosaic %d, binned %d, dark frame %d", k, bins, of);
                if (of)
                    continue;
                assert_true(raw.channels == CHANNELS);
                ASSERT_OK(hada_image_copy(&expected, &raw, err));
                SCOPED(hada_image) same = {0};
                if (bins)
                    ASSERT_OK(hada_image_downsample(&small, &dark, N, patterns[k], 0, err));
                else if (k)
                    ASSERT_OK(hada_mosaic_colours(patterns[k], &dark, &same, err));
                else
                    ASSERT_OK(hada_image_copy(&same, &dark, err));
                const hada_image *off = bins ? &small : &same;
                for (size_t i = 0; i < hada_image_count(&expected); i++)
                    expected.data[i] -= off->data[i];
            }
            hada_dataset *data = NULL;
            SCOPED(hada_image) raw = {0};
            SCOPED(hada_image) scene = {0};
            dark.rows--;
            options.dark_frame = &dark;
            ASSERT_OK(hada_dataset_create(&data, 1, &distance, &count, read_one, &frame, &options, err));
            ASSERT_FAILS(hada_dataset_read(data, 0, 0, &raw, &scene, err), HADA_ERROR_SIZE, "dark frame");
            hada_dataset_destroy(&data);
            dark.data[5] = NAN;
            ASSERT_FAILS(hada_dataset_create(&data, 1, &distance, &count, read_one, &frame, &options, err),
                         HADA_ERROR_NOT_FINITE, "dark frame");
            assert_null(data);
        }
}

FIXTURE(open_device, close_device)
