/* Simulated frames: against convolution by its definition in double precision, and by what light does. */
#include "device_fixture.h"
#include "ref/ref_convolve.h"

static hada_camera small_camera(hada_boundary boundary)
{
    hada_camera camera = {.size = sizeof camera};
    ASSERT_OK(hada_camera_preset(&camera, "sim300", err));
    ASSERT_OK(hada_camera_resize(&camera, 60, 72, 25, 24, err));
    camera.boundary = boundary;
    camera.lenses = 9;
    return camera;
}

/* A point of light at depth z gives the PSF, moved. */
TEST(a_point_gives_the_psf)
{
    const hada_camera camera = small_camera(HADA_BOUNDARY_CIRCULAR);
    hada_simulator *simulator;
    ASSERT_OK(hada_simulator_create(&simulator, context, &camera, NULL, err));
    for (int depth = 0; depth < camera.depths; depth++) {
        SCOPED(hada_image) scene, psf, raw;
        ASSERT_OK(hada_image_create(&scene, 1, camera.window_rows, camera.window_cols, err));
        const int row = 3 + depth, col = 20 - depth;
        scene.data[row * camera.window_cols + col] = 2.0f;
        const hada_plane plane = {depth, &scene};
        ASSERT_OK(hada_simulator_render(simulator, &plane, 1, 0.0, 0, &raw, err));
        ASSERT_OK(hada_simulator_psf(simulator, depth, &psf, err));
        assert_int_equal(raw.channels, 3);
        const int down = (60 - 25) / 2 + row - 30, right = (72 - 24) / 2 + col - 36;
        for (int c = 0; c < 3; c++)
            for (int r = 0; r < 60; r++)
                for (int k = 0; k < 72; k++) {
                    const float expected = 2.0f * psf.data[(r - down + 120) % 60 * 72 + (k - right + 144) % 72];
                    assert_true(fabsf(raw.data[(c * 60 + r) * 72 + k] - expected) < 1e-7f);
                }
    }
    hada_simulator_destroy(&simulator);
    assert_null(simulator);
}

/* Three planes in colour, two of them at one depth. */
TEST(frames_equal_the_reference)
{
    enum { PIXELS = 60 * 72 };
    static float wide[PIXELS];
    static double expected[3][PIXELS];
    const hada_boundary boundaries[] = {HADA_BOUNDARY_CIRCULAR, HADA_BOUNDARY_PADDED};
    for (int b = 0; b < 2; b++) {
        hada_camera camera = small_camera(boundaries[b]);
        if (b) /* a pattern wider than the sensor */
            camera.distance_mm *= 2.0;
        SCOPED(hada_simulator) * simulator;
        ASSERT_OK(hada_simulator_create(&simulator, context, &camera, NULL, err));
        hada_image scenes[3], raw;
        const int depths[] = {0, 3, 0};
        hada_plane planes[3];
        memset(expected, 0, sizeof expected);
        for (int i = 0; i < 3; i++) {
            SCOPED(hada_image) psf;
            ASSERT_OK(hada_scene_procedural(&scenes[i], (uint64_t)i, i == 1 ? 1 : 3, 25, 24, err));
            planes[i] = (hada_plane){depths[i], &scenes[i]};
            const double z = camera.distances_mm[depths[i]];
            ASSERT_OK(hada_camera_psf(&camera, z, b ? 120 : 60, b ? 144 : 72, &psf, err));
            for (int c = 0; c < 3; c++) {
                memset(wide, 0, sizeof wide);
                for (int r = 0; r < 25; r++)
                    memcpy(wide + (17 + r) * 72 + 24, scenes[i].data + ((i == 1 ? 0 : c) * 25 + r) * 24,
                           24 * sizeof(float));
                if (b)
                    hada_ref_convolve_crop(60, 72, wide, 120, 144, psf.data, expected[c]);
                else
                    hada_ref_convolve(60, 72, wide, psf.data, expected[c]);
            }
        }
        ASSERT_OK(hada_simulator_render(simulator, planes, 3, 0.0, 0, &raw, err));
        for (int c = 0; c < 3; c++)
            assert_true(relative_error(raw.data + c * PIXELS, expected[c], PIXELS) < 5e-7);
        /* noise: of the stated size, and the same for the same seed */
        SCOPED(hada_image) noisy, again;
        float most = 0.0f;
        double mse;
        for (int i = 0; i < 3 * PIXELS; i++)
            most = fmaxf(most, raw.data[i]);
        ASSERT_OK(hada_simulator_render(simulator, planes, 3, 0.05, 7, &noisy, err));
        ASSERT_OK(hada_simulator_render(simulator, planes, 3, 0.05, 7, &again, err));
        assert_memory_equal(noisy.data, again.data, sizeof(float) * 3 * PIXELS);
        ASSERT_OK(hada_metric_compare(HADA_METRIC_MSE, &raw, &noisy, 1.0, NULL, &mse, err));
        assert_true(fabs(sqrt(mse) / (0.05 * most) - 1.0) < 0.03);
        destroy_images(scenes, 3);
        hada_image_destroy(&raw);
    }
}

/* Circular: the frame holds as much light as the scene. Cropped: less, where the pattern is wider than the sensor. */
TEST(light_is_kept_or_lost)
{
    for (int b = 0; b < 2; b++) {
        hada_camera camera = small_camera(b ? HADA_BOUNDARY_PADDED : HADA_BOUNDARY_CIRCULAR);
        camera.rows = 44;
        camera.cols = 40;
        SCOPED(hada_simulator) * simulator;
        SCOPED(hada_image) scene, raw;
        ASSERT_OK(hada_simulator_create(&simulator, context, &camera, NULL, err));
        ASSERT_OK(hada_scene_procedural(&scene, 4, 1, 25, 24, err));
        const hada_plane plane = {0, &scene};
        ASSERT_OK(hada_simulator_render(simulator, &plane, 1, 0.0, 0, &raw, err));
        double light = 0.0, caught = 0.0;
        for (int i = 0; i < 25 * 24; i++)
            light += scene.data[i];
        for (int i = 0; i < 44 * 40; i++)
            caught += raw.data[i];
        /* the PSF itself loses what falls beyond the sensor in the circular model */
        SCOPED(hada_image) psf;
        double kept = 0.0;
        ASSERT_OK(hada_simulator_psf(simulator, 0, &psf, err));
        for (int i = 0; i < 44 * 40; i++)
            kept += psf.data[i];
        if (b)
            assert_true(caught > 0.5 * light && caught < 0.95 * light);
        else
            assert_true(fabs(caught / (light * kept) - 1.0) < 1e-5);
    }
}

TEST(given_psfs)
{
    hada_camera camera = small_camera(HADA_BOUNDARY_CIRCULAR);
    camera.depths = 2;
    hada_image psf[2];
    SCOPED(hada_image) scene, raw, back;
    for (int i = 0; i < 2; i++) {
        ASSERT_OK(hada_image_create(&psf[i], 3, 60, 72, err));
        for (int c = 0; c < 3; c++) /* each channel moves by its own distance */
            psf[i].data[(c * 60 + 30 + i) * 72 + 36 + c] = 1.0f;
    }
    hada_simulator *simulator;
    DEFAULTS(hada_simulator_options, with_psf);
    with_psf.psf = psf;
    ASSERT_OK(hada_simulator_create(&simulator, context, &camera, &with_psf, err));
    ASSERT_OK(hada_scene_procedural(&scene, 4, 3, 25, 24, err));
    const hada_plane plane = {1, &scene};
    ASSERT_OK(hada_simulator_render(simulator, &plane, 1, 0.0, 0, &raw, err));
    for (int c = 0; c < 3; c++)
        for (int r = 0; r < 25; r++)
            for (int k = 0; k < 24; k++)
                assert_true(fabsf(raw.data[(c * 60 + 17 + r + 1) * 72 + 24 + k + c] -
                                  scene.data[(c * 25 + r) * 24 + k]) < 1e-6f);
    ASSERT_OK(hada_simulator_psf(simulator, 1, &back, err));
    assert_memory_equal(back.data, psf[1].data, 3 * 60 * 72 * sizeof(float));
    hada_simulator_destroy(&simulator);
    psf[1].channels = 2;
    ASSERT_FAILS(hada_simulator_create(&simulator, context, &camera, &with_psf, err), HADA_ERROR_SIZE, "");
    assert_null(simulator);
    destroy_images(psf, 2);
}

TEST(refusals)
{
    const hada_camera camera = small_camera(HADA_BOUNDARY_CIRCULAR);
    const uint64_t before = hada_context_bytes(context);
    hada_simulator *simulator;
    hada_image scene, raw;
    ASSERT_OK(hada_simulator_create(&simulator, context, &camera, NULL, err));
    ASSERT_OK(hada_image_create(&scene, 3, 25, 25, err));
    hada_plane plane = {0, &scene};
    ASSERT_FAILS(hada_simulator_render(simulator, &plane, 1, 0.0, 0, &raw, err), HADA_ERROR_SIZE, "25 x 25");
    plane.depth = 4;
    ASSERT_FAILS(hada_simulator_render(simulator, &plane, 1, 0.0, 0, &raw, err), HADA_ERROR_ARGUMENT, "");
    plane.depth = 0;
    scene.cols = 24;
    scene.data[5] = NAN;
    ASSERT_FAILS(hada_simulator_render(simulator, &plane, 1, 0.0, 0, &raw, err), HADA_ERROR_NOT_FINITE, "");
    ASSERT_FAILS(hada_simulator_render(simulator, &plane, 0, 0.0, 0, &raw, err), HADA_ERROR_ARGUMENT, "");
    assert_null(raw.data);
    hada_image_destroy(&scene);
    hada_simulator_destroy(&simulator);
    assert_true(hada_context_bytes(context) == before); /* nothing stays on the device */
}

FIXTURE(open_device, close_device)
