/* Colour filter mosaics: filling in, the weights of an exposure, planes beside those of demosaiced frames, a model that
 * knows its pattern, cameras that are learned from mosaics. */
#include "camera_small.h"
#include "device_fixture.h"
#include "image/statistics.h"
#include "io_testing.h"
#include "planes/maker.h"
#include "ref/ref_mosaic.h"

enum { ROWS = 60, COLS = 72, WINDOW = 24, CHANNELS = 3, PLANE = ROWS * COLS };
static const hada_mosaic patterns[] = {HADA_MOSAIC_RGGB, HADA_MOSAIC_BGGR, HADA_MOSAIC_GRBG, HADA_MOSAIC_GBRG};

/* Of a frame of three channels, the values that a sensor with a mosaic gives. */
static hada_image mosaic_of(const hada_image *frame, hada_mosaic pattern)
{
    hada_image mosaic;
    const char *name = hada_enum_name(HADA_ENUM_MOSAIC, (int)pattern);
    ASSERT_OK(hada_image_create(&mosaic, 1, frame->rows, frame->cols, err));
    for (int i = 0; i < frame->rows * frame->cols; i++) {
        const int channel = hada_ref_mosaic_channel(name, i / frame->cols, i % frame->cols);
        mosaic.data[i] = frame->data[channel * frame->rows * frame->cols + i];
    }
    return mosaic;
}

/* Exact where a pixel holds the colour; sizes that are odd, and the least one. */
TEST(fills_as_the_reference)
{
    static const int sizes[][2] = {{2, 2}, {2, 3}, {3, 2}, {5, 7}, {8, 6}};
    hada_random random;
    hada_random_seed(&random, 3, 0);
    for (size_t p = 0; p < HADA_COUNT(patterns); p++)
        for (size_t s = 0; s < HADA_COUNT(sizes); s++) {
            const int rows = sizes[s][0], cols = sizes[s][1];
            const char *name = hada_enum_name(HADA_ENUM_MOSAIC, (int)patterns[p]);
            float values[64], got[192], back[64];
            double expected[192];
            for (int i = 0; i < rows * cols; i++)
                values[i] = (float)hada_random_uniform(&random);
            hada_mosaic_fill(patterns[p], values, rows, cols, got);
            hada_ref_mosaic(name, rows, cols, values, expected);
            for (int i = 0; i < 3 * rows * cols; i++)
                if (fabs(got[i] - expected[i]) > 1e-6)
                    fail_msg("%s %d x %d: value %d is %g instead of %g", name, rows, cols, i, (double)got[i],
                             expected[i]);
            hada_mosaic_take(patterns[p], got, rows, cols, back);
            assert_memory_equal(back, values, (size_t)(rows * cols) * sizeof *values);
        }
}

/* Weights, dark levels of each colour, energy, repair from pixels of the same place in the pattern. */
TEST(exposures_weigh_what_pixels_hold)
{
    enum { R = 20, C = 23, AREA = R * C };
    static float values[AREA], given[3 * AREA], weights[3 * AREA];
    const hada_model_info info = {
        .channels = 3, .raw_rows = R, .raw_cols = C, .grid_rows = R, .grid_cols = C, .mosaic = HADA_MOSAIC_GRBG};
    hada_exposure_rule rule = {.dark_varies = 1, .repairs = 1, .energy = 1, .weights = 1, .pixel_weights = given};
    hada_frame_exposure exposure;
    hada_random random;
    hada_pixels pixels;
    size_t good = 0, saturated = 0;
    double energy = 0.0, sums[3] = {0.0};
    int counts[3] = {0};
    const hada_frame_kind kind = {.mosaic = HADA_MOSAIC_AUTO, .downsample = 1};
    hada_random_seed(&random, 3, 0);
    for (int i = 0; i < AREA; i++) {
        const int c = hada_ref_mosaic_channel("grbg", i / C, i % C);
        values[i] = 0.1f * (float)(c + 1) + 0.1f * (float)hada_random_uniform(&random);
        if (i % 19 == 0)
            values[i] = 1.0f; /* cut off */
        for (int k = 0; k < 3; k++)
            given[k * AREA + i] = k == c ? 1.0f - 0.5f * (float)(i % 2) : 0.0f; /* of other colours it says nothing */
    }
    values[5 * C + 4] = NAN;
    values[6 * C + 4] = 7.0f; /* said to be bad: neither saturated nor the brightest */
    given[hada_ref_mosaic_channel("grbg", 6, 4) * AREA + 6 * C + 4] = 0.0f;
    hada_pixels_planar(&pixels, values, HADA_PIXEL_F32, 1, R, C);
    ASSERT_OK(hada_exposure_begin(&exposure, &info, &kind, &pixels, err));
    ASSERT_OK(hada_exposure_examine(&exposure, &rule, err));
    assert_int_equal(exposure.mosaic, HADA_MOSAIC_GRBG);
    assert_int_equal(exposure.repaired, 1);
    assert_int_equal(exposure.pixels.channels, 3);
    assert_int_equal(hada_exposure_count(&exposure), 3 * AREA);
    assert_true(hada_exposure_is_weighted(&exposure) && exposure.brightest == 1.0f);
    const size_t above = hada_exposure_weigh(&exposure, weights);
    for (int i = 0; i < AREA; i++) {
        const int own = hada_ref_mosaic_channel("grbg", i / C, i % C), bad = i == 5 * C + 4 || i == 6 * C + 4;
        const float *filled = exposure.own.data + own * AREA;
        for (int c = 0; c < 3; c++) {
            const float weight = c != own || bad ? 0.0f : 1.0f - 0.5f * (float)(i % 2);
            const float expected = values[i] == 1.0f ? -weight : weight;
            if (weights[c * AREA + i] != expected)
                fail_msg("channel %d, pixel %d: weight %g instead of %g", c, i, (double)weights[c * AREA + i],
                         (double)expected);
            good += expected > 0.0f;
            saturated += expected < 0.0f;
        }
        assert_true(bad || filled[i] == values[i]);
        if (bad) /* as its colour is */
            assert_true(filled[i] >= 0.1f * (float)(own + 1) && filled[i] <= 0.1f * (float)(own + 2));
        sums[own] += (filled[i] - exposure.levels[own]) * (filled[i] - exposure.levels[own]);
        counts[own]++;
    }
    assert_int_equal(above, good);
    assert_int_equal(exposure.saturated, saturated);
    for (int c = 0; c < 3; c++) {
        energy += sums[c] / counts[c] * AREA;
        assert_true(fabs(exposure.levels[c] - 0.1 * (c + 1)) < 0.01);
    }
    assert_true(fabs(exposure.energy / energy - 1.0) < 1e-6);
    hada_exposure_end(&exposure);
}

/* By pixels of one colour: that of each value, not of what was filled in. */
TEST(noise_is_that_of_the_pixels)
{
    enum { R = 150, C = 201, AREA = R * C };
    static float frame[AREA], filled[3 * AREA];
    hada_random random;
    hada_pixels pixels;
    hada_random_seed(&random, 4, 0);
    for (int i = 0; i < AREA; i++)
        frame[i] = (float)(0.5 + 0.3 * sin(0.05 * (i % C)) * hada_ref_mosaic_channel("bggr", i / C, i % C) +
                           0.02 * hada_random_normal(&random));
    hada_mosaic_fill(HADA_MOSAIC_BGGR, frame, R, C, filled);
    hada_pixels_planar(&pixels, filled, HADA_PIXEL_F32, 3, R, C);
    const double found = hada_noise_estimate(&pixels, HADA_MOSAIC_BGGR);
    if (fabs(found - 0.02) > 0.002)
        fail_msg("noise 0.02, found %g", found);
    assert_true(hada_noise_estimate(&pixels, HADA_MOSAIC_NONE) < 0.017);
}

typedef struct bench {
    hada_image psf, scene;
    hada_model *model, *plain; /* that knows the pattern, and that does not */
} bench;

static hada_model *model_of(const hada_image *psf, hada_boundary boundary, hada_mosaic mosaic)
{
    const double distance = 100.0;
    DEFAULTS(hada_psf_options, options);
    hada_model *model;
    options.window_rows = options.window_cols = WINDOW;
    options.psf_dark = options.dark = 0;
    options.boundary = boundary;
    options.mosaic = mosaic;
    ASSERT_OK(hada_model_from_psf(&model, context, psf, 1, &distance, &options, err));
    return model;
}

/* Blocks of light in colours. */
static hada_image blocks(uint64_t seed)
{
    hada_random random;
    hada_image scene = small_scene(CHANNELS, WINDOW, WINDOW, 1);
    hada_random_seed(&random, seed, 0);
    for (size_t i = 0; i < hada_image_count(&scene); i++)
        scene.data[i] = 0.15f;
    for (int k = 0; k < 6; k++) {
        const int row = (int)hada_random_below(&random, WINDOW - 9), col = (int)hada_random_below(&random, WINDOW - 9);
        for (int c = 0; c < CHANNELS; c++) {
            const float light = (float)hada_random_range(&random, 0.1, 1.0);
            for (int i = 0; i < 81; i++)
                scene.data[(c * WINDOW + row + i / 9) * WINDOW + col + i % 9] = light;
        }
    }
    return scene;
}

static bench make(hada_boundary boundary)
{
    bench b = {.psf = small_psf(CHANNELS, ROWS, COLS, 30, 3), .scene = blocks(5)};
    /* no spot outshines the others: a pixel of the scene is seen by pixels of all colours */
    for (int c = 0; c < CHANNELS; c++) {
        float *to = b.psf.data + c * PLANE, *axis = to + (ROWS / 2) * COLS + COLS / 2;
        const float rest = 1.0f - 0.95f * *axis;
        *axis *= 0.05f;
        for (int i = 0; i < PLANE; i++)
            to[i] /= rest;
    }
    b.model = model_of(&b.psf, boundary, HADA_MOSAIC_GBRG);
    b.plain = model_of(&b.psf, boundary, HADA_MOSAIC_NONE);
    return b;
}

static void unmake(bench *b)
{
    hada_image_destroy(&b->psf);
    hada_image_destroy(&b->scene);
    hada_model_destroy(&b->model);
    hada_model_destroy(&b->plain);
}

static double unexplained; /* of the last frame */

/* Error of the plane. */
static double solve(const hada_model *model, hada_mosaic mosaic, const hada_image *frame, const hada_image *scene)
{
    DEFAULTS(hada_plan_options, options);
    SCOPED(hada_result) result = {0};
    hada_plan *plan;
    options.mosaic = mosaic;
    options.refine_tv = 1e-3;
    ASSERT_OK(hada_plan_create(&plan, context, model, &options, err));
    ASSERT_OK(hada_plan_run(plan, frame, &result, err));
    unexplained = result.report->residual;
    hada_plan_destroy(&plan);
    return relative_change(result.planes[0].data, scene->data, hada_image_count(scene));
}

/* Nothing is demosaiced: clearly better than a demosaiced frame, if not as good as all colours at all pixels. The model
 * says the pattern, or the option does. */
TEST(planes_beat_demosaiced_frames)
{
    static const hada_boundary boundaries[] = {HADA_BOUNDARY_CIRCULAR, HADA_BOUNDARY_PADDED};
    for (size_t k = 0; k < HADA_COUNT(boundaries); k++) {
        bench b = make(boundaries[k]);
        SCOPED(hada_image)
        colours = small_frame(&b.psf, &b.scene, boundaries[k] == HADA_BOUNDARY_PADDED, 0.001, 5), filled = {0};
        SCOPED(hada_image) mosaic = mosaic_of(&colours, HADA_MOSAIC_GBRG);
        ASSERT_OK(hada_image_create(&filled, CHANNELS, ROWS, COLS, err));
        hada_mosaic_fill(HADA_MOSAIC_GBRG, mosaic.data, ROWS, COLS, filled.data);
        const double all = solve(b.plain, HADA_MOSAIC_AUTO, &colours, &b.scene);
        const double left = unexplained, demosaiced = solve(b.plain, HADA_MOSAIC_AUTO, &filled, &b.scene);
        const double known = solve(b.model, HADA_MOSAIC_AUTO, &mosaic, &b.scene);
        const double told = solve(b.plain, HADA_MOSAIC_GBRG, &mosaic, &b.scene);
        assert_true(known == told);
        if (unexplained < 0.5 * left || unexplained > 2.0 * left)
            fail_msg("boundary %zu: %.3g unexplained, of all colours %.3g", k, unexplained, left);
        if (known > 0.5 * demosaiced || all > known)
            fail_msg("boundary %zu: error %.3g, demosaiced %.3g, all colours %.3g", k, known, demosaiced, all);
        const double other = solve(b.model, HADA_MOSAIC_RGGB, &mosaic, &b.scene);
        if (other < 2.0 * known)
            fail_msg("boundary %zu: error %.3g, with a wrong pattern %.3g", k, known, other);
        unmake(&b);
    }
}

/* A dark frame of one channel, whole numbers, linear filters, queues: the same bits as those of one queue. */
TEST(queues_give_the_same_bits)
{
    enum { FRAMES = 4 };
    bench b = make(HADA_BOUNDARY_PADDED);
    SCOPED(hada_image) dark = {0};
    hada_plan *plan[2];
    uint16_t numbers[FRAMES][PLANE];
    hada_result result[2][FRAMES] = {0};
    hada_job *job[FRAMES];
    DEFAULTS(hada_plan_options, options);
    ASSERT_OK(hada_image_create(&dark, 1, ROWS, COLS, err));
    for (size_t i = 0; i < PLANE; i++)
        dark.data[i] = 0.01f;
    options.dark = HADA_DARK_FRAME;
    options.dark_frame = &dark;
    for (int i = 0; i < FRAMES; i++) {
        SCOPED(hada_image) colours = small_frame(&b.psf, &b.scene, 1, 0.01, (uint64_t)i + 1);
        SCOPED(hada_image) mosaic = mosaic_of(&colours, HADA_MOSAIC_GBRG);
        for (size_t k = 0; k < PLANE; k++)
            numbers[i][k] = (uint16_t)(65535.0f * fminf(fmaxf(mosaic.data[k] + 0.01f, 0.0f), 1.0f));
    }
    for (int p = 0; p < 2; p++) {
        options.queues = p ? 3 : 1;
        ASSERT_OK(hada_plan_create(&plan[p], context, b.model, &options, err));
        for (int i = 0; i < FRAMES; i++) {
            DEFAULTS(hada_pixels, pixels);
            hada_pixels_planar(&pixels, numbers[i], HADA_PIXEL_U16, 1, ROWS, COLS);
            ASSERT_OK(hada_job_submit_pixels(&job[i], plan[p], &pixels, &result[p][i], err));
        }
        for (int i = 0; i < FRAMES; i++) {
            ASSERT_OK(hada_job_wait(job[i], err));
            hada_job_destroy(&job[i]);
        }
    }
    for (int i = 0; i < FRAMES; i++) {
        const hada_image *one = &result[0][i].planes[0], *many = &result[1][i].planes[0];
        assert_memory_equal(one->data, many->data, hada_image_count(one) * sizeof(float));
        assert_true(relative_change(one->data, b.scene.data, hada_image_count(one)) < 0.3);
        hada_result_destroy(&result[0][i]);
        hada_result_destroy(&result[1][i]);
    }
    hada_plan_destroy(&plan[0]);
    hada_plan_destroy(&plan[1]);
    unmake(&b);
}

TEST(what_cannot_be)
{
    bench b = make(HADA_BOUNDARY_CIRCULAR);
    SCOPED(hada_image) grey_psf = small_psf(1, ROWS, COLS, 8, 3);
    SCOPED(hada_image) colours = small_frame(&b.psf, &b.scene, 0, 0.001, 5);
    SCOPED(hada_image) mosaic = mosaic_of(&colours, HADA_MOSAIC_GBRG);
    hada_model *grey = model_of(&grey_psf, HADA_BOUNDARY_CIRCULAR, HADA_MOSAIC_NONE), *none;
    const double distance = 100.0;
    hada_result result = {0};
    hada_plan *plan;
    DEFAULTS(hada_plan_options, options);
    DEFAULTS(hada_psf_options, psf);
    ASSERT_OK(hada_plan_create(&plan, context, b.plain, &options, err));
    ASSERT_FAILS(hada_plan_run(plan, &mosaic, &result, err), HADA_ERROR_MODEL, "options.mosaic");
    hada_plan_destroy(&plan);
    options.mosaic = HADA_MOSAIC_NONE; /* whatever the model says */
    ASSERT_OK(hada_plan_create(&plan, context, b.model, &options, err));
    ASSERT_FAILS(hada_plan_run(plan, &mosaic, &result, err), HADA_ERROR_MODEL, "options.mosaic");
    ASSERT_OK(hada_plan_run(plan, &colours, &result, err));
    hada_plan_destroy(&plan);
    options.mosaic = HADA_MOSAIC_RGGB;
    ASSERT_OK(hada_plan_create(&plan, context, b.model, &options, err));
    ASSERT_FAILS(hada_plan_run(plan, &colours, &result, err), HADA_ERROR_MODEL, "leave options.mosaic out");
    hada_plan_destroy(&plan);
    ASSERT_FAILS(hada_plan_create(&plan, context, grey, &options, err), HADA_ERROR_MODEL, "three channels");
    options.mosaic = (hada_mosaic)9;
    ASSERT_FAILS(hada_plan_create(&plan, context, b.model, &options, err), HADA_ERROR_ARGUMENT, "mosaic");
    psf.mosaic = HADA_MOSAIC_RGGB;
    ASSERT_FAILS(hada_model_from_psf(&none, context, &grey_psf, 1, &distance, &psf, err), HADA_ERROR_MODEL,
                 "three channels");
    hada_result_destroy(&result);
    hada_model_destroy(&grey);
    unmake(&b);
}

/* Pairs of mosaics teach nearly what pairs in full colour do, and the pattern; files keep it. */
TEST(pairs_of_mosaics)
{
    enum { PAIRS = 6 };
    static const hada_boundary boundaries[] = {HADA_BOUNDARY_CIRCULAR, HADA_BOUNDARY_PADDED};
    const double distance = 100.0;
    const int count = PAIRS;
    for (size_t k = 0; k < HADA_COUNT(boundaries); k++) {
        bench b = make(boundaries[k]);
        const int padded = boundaries[k] == HADA_BOUNDARY_PADDED;
        hada_image scenes[PAIRS], frames[2][PAIRS];
        hada_model *learned[2], *loaded;
        double error[2];
        SCOPED(hada_image) colours = small_frame(&b.psf, &b.scene, padded, 0.001, 50);
        SCOPED(hada_image) mosaic = mosaic_of(&colours, HADA_MOSAIC_GBRG);
        for (int i = 0; i < PAIRS; i++) {
            scenes[i] = small_scene(CHANNELS, WINDOW, WINDOW, (uint64_t)i + 20);
            frames[0][i] = small_frame(&b.psf, &scenes[i], padded, 0.001, (uint64_t)i + 20);
            frames[1][i] = mosaic_of(&frames[0][i], HADA_MOSAIC_GBRG);
        }
        for (int kind = 0; kind < 2; kind++) {
            DEFAULTS(hada_dataset_options, scan);
            DEFAULTS(hada_fit_options, fit);
            DEFAULTS(hada_fit_task, task);
            hada_dataset *pairs;
            scan.mosaic = kind ? HADA_MOSAIC_GBRG : HADA_MOSAIC_NONE;
            fit.scene_response = HADA_RESPONSE_LINEAR;
            fit.refine_steps = 40; /* fewer leave colours of a mosaic unsettled */
            fit.refine_tv = 1e-3;
            task.fit = &fit;
            task.boundary = (int)boundaries[k];
            task.exposure = HADA_EXPOSURE_SAME;
            small_pairs of = {frames[kind], scenes};
            ASSERT_OK(hada_dataset_create(&pairs, 1, &distance, &count, small_read_pair, &of, &scan, err));
            ASSERT_OK(hada_fit_run(&learned[kind], NULL, context, pairs, &task, err));
            hada_dataset_destroy(&pairs);
            error[kind] = solve(learned[kind], HADA_MOSAIC_AUTO, kind ? &mosaic : &colours, &b.scene);
        }
        const double exact = solve(b.model, HADA_MOSAIC_AUTO, &mosaic, &b.scene);
        if (error[1] > 1.5 * fmax(error[0], exact))
            fail_msg("boundary %zu: error %.3g; learned and seen in full colour %.3g, with the exact camera %.3g", k,
                     error[1], error[0], exact);
        assert_int_equal(hada_model_get_info(learned[1])->mosaic, HADA_MOSAIC_GBRG);
        assert_int_equal(hada_model_get_info(learned[0])->mosaic, HADA_MOSAIC_NONE);
        char path[64];
        make_path(path);
        ASSERT_OK(hada_model_save(learned[1], path, err));
        ASSERT_OK(hada_model_load(&loaded, path, err));
        remove(path);
        assert_int_equal(hada_model_get_info(loaded)->mosaic, HADA_MOSAIC_GBRG);
        hada_model_destroy(&loaded);
        for (int i = 0; i < PAIRS; i++) {
            hada_image_destroy(&scenes[i]);
            hada_image_destroy(&frames[0][i]);
            hada_image_destroy(&frames[1][i]);
        }
        hada_model_destroy(&learned[0]);
        hada_model_destroy(&learned[1]);
        unmake(&b);
    }
}

FIXTURE(open_device, close_device)
