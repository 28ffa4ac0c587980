/* The forward model beyond one convolution a depth: sensors off the axis, scenes wider than the window. Against
 * convolution by its definition, in double precision. */
#include "forward_fixture.h"

#include "optics/mask.h"
#include "ref/ref_convolve.h"

/* What a sensor off the axis records is the same light, elsewhere. */
TEST(shift)
{
    hada_camera camera = small_camera(HADA_BOUNDARY_PADDED);
    camera.aperture_mm *= 2.0; /* a pattern wider than the sensor */
    const int down = -9, across = 14;
    hada_simulator *straight = simulator_of(&camera, 0, 0, 0, 0), *moved = simulator_of(&camera, down, across, 0, 0);
    SCOPED(hada_image) scene = drawn(3, 3, HIGH, WIDE), here, there, psf, psf_there;
    const hada_plane plane = {1, &scene};
    ASSERT_OK(hada_simulator_render(straight, &plane, 1, 0.0, 0, &here, err));
    ASSERT_OK(hada_simulator_render(moved, &plane, 1, 0.0, 0, &there, err));
    ASSERT_OK(hada_simulator_psf(straight, 1, &psf, err));
    ASSERT_OK(hada_simulator_psf(moved, 1, &psf_there, err));
    for (int r = -down; r < ROWS; r++)
        for (int c = 0; c < COLS - across; c++) {
            for (int k = 0; k < 3; k++)
                assert_true(fabsf(there.data[k * PIXELS + r * COLS + c] -
                                  here.data[k * PIXELS + (r + down) * COLS + c + across]) < 2e-7f);
            assert_true(fabsf(psf_there.data[r * COLS + c] - psf.data[(r + down) * COLS + c + across]) < 1e-8f);
        }
    /* beyond the edge is light that the straight sensor never saw */
    double beyond = 0.0;
    double all = 0.0;
    for (int i = 0; i < PIXELS; i++) {
        all += there.data[i];
        if (i / COLS < -down || i % COLS >= COLS - across)
            beyond += there.data[i];
    }
    assert_true(beyond > 1e-3 * all);
    hada_simulator_destroy(&straight);
    hada_simulator_destroy(&moved);
    /* given PSFs move as well, and light beyond them is dark */
    hada_image psfs[4];
    for (int z = 0; z < 4; z++)
        psfs[z] = psf;
    DEFAULTS(hada_simulator_options, options);
    options.psf = psfs;
    options.shift_rows = down;
    options.shift_cols = across;
    ASSERT_OK(hada_simulator_create(&moved, context, &camera, &options, err));
    SCOPED(hada_image) given;
    ASSERT_OK(hada_simulator_psf(moved, 0, &given, err));
    for (int r = 0; r < ROWS; r++)
        for (int c = 0; c < COLS; c++) {
            const int inside = r + down >= 0 && c + across < COLS;
            assert_true(given.data[r * COLS + c] == (inside ? psf.data[(r + down) * COLS + c + across] : 0.0f));
        }
    hada_simulator_destroy(&moved);
}

/* A scene that is wider than the window, the sensor even. */
TEST(field)
{
    enum { HIGHER = 71, WIDER = 90, MARGIN = 20, R = ROWS + 2 * MARGIN, C = COLS + 2 * MARGIN };
    static float canvas[R * C];
    static double all[R * C], expected[PIXELS];
    const hada_camera camera = small_camera(HADA_BOUNDARY_PADDED);
    hada_simulator *simulator = simulator_of(&camera, 0, 0, HIGHER, WIDER);
    SCOPED(hada_image) raw;
    SCOPED(hada_image) scene = drawn(8, 1, HIGHER, WIDER), psf, window, small, again;
    memset(canvas, 0, sizeof canvas);
    memset(all, 0, sizeof all);
    const int row0 = MARGIN + (ROWS - HIGH) / 2 - (HIGHER - HIGH) / 2,
              col0 = MARGIN + (COLS - WIDE) / 2 - (WIDER - WIDE) / 2;
    for (int r = 0; r < HIGHER; r++)
        memcpy(canvas + (row0 + r) * C + col0, scene.data + r * WIDER, WIDER * sizeof(float));
    ASSERT_OK(hada_camera_psf(&camera, camera.distances_mm[2], 2 * R, 2 * C, &psf, err));
    hada_ref_convolve_crop(R, C, canvas, 2 * R, 2 * C, psf.data, all);
    for (int r = 0; r < ROWS; r++)
        memcpy(expected + r * COLS, all + (MARGIN + r) * C + MARGIN, COLS * sizeof(double));
    ASSERT_OK(hada_simulator_render(simulator, &(hada_plane){2, &scene}, 1, 0.0, 0, &raw, err));
    for (int k = 0; k < 3; k++)
        assert_true(relative_error(raw.data + k * PIXELS, expected, PIXELS) < 5e-7);
    hada_simulator_destroy(&simulator);
    /* a scene of the window's size means the same with a field and without */
    ASSERT_OK(hada_image_crop(&window, &scene, (HIGHER - HIGH) / 2, (WIDER - WIDE) / 2, HIGH, WIDE, err));
    SCOPED(hada_simulator) *narrow = simulator_of(&camera, 0, 0, 0, 0),
                           *wide = simulator_of(&camera, 0, 0, HIGHER, WIDER);
    ASSERT_OK(hada_simulator_render(narrow, &(hada_plane){2, &window}, 1, 0.0, 0, &small, err));
    ASSERT_OK(hada_simulator_render(wide, &(hada_plane){2, &window}, 1, 0.0, 0, &again, err));
    for (int i = 0; i < 3 * PIXELS; i++)
        assert_true(fabsf(small.data[i] - again.data[i]) < 3e-7f);
}

/* p d (1/near - 1/far) / pitch */
TEST(parallax)
{
    const hada_camera camera = small_camera(HADA_BOUNDARY_CIRCULAR);
    double cols, rows;
    hada_camera_parallax(&camera, 100.0, 600.0, 2.0, -4.0, &cols, &rows);
    assert_true(fabs(cols - 2.0 * 30.0 * (1.0 / 100.0 - 1.0 / 600.0) / camera.pixel_pitch_mm) < 1e-12);
    assert_true(fabs(rows + 2.0 * cols) < 1e-12);
}

TEST(white_exposure)
{
    const hada_camera camera = small_camera(HADA_BOUNDARY_CIRCULAR);
    SCOPED(hada_simulator) *simulator = simulator_of(&camera, 0, 0, 0, 0);
    double exposure, most = 0.0;
    ASSERT_OK(hada_simulator_white_exposure(simulator, 0.75, &exposure, err));
    hada_image white, raw;
    ASSERT_OK(hada_image_create(&white, 1, HIGH, WIDE, err));
    for (int i = 0; i < HIGH * WIDE; i++)
        white.data[i] = 1.0f;
    for (int z = 0; z < camera.depths; z++) {
        ASSERT_OK(hada_simulator_render(simulator, &(hada_plane){z, &white}, 1, 0.0, 0, &raw, err));
        for (int i = 0; i < PIXELS; i++)
            most = fmax(most, raw.data[i]);
        hada_image_destroy(&raw);
    }
    assert_true(fabs(exposure * most - 0.75) < 1e-6);
    hada_image_destroy(&white);
}

TEST(refusals)
{
    const hada_camera camera = small_camera(HADA_BOUNDARY_CIRCULAR);
    hada_simulator *simulator;
    DEFAULTS(hada_simulator_options, options);
    options.field_rows = ROWS + 1;
    options.field_cols = COLS;
    ASSERT_FAILS(hada_simulator_create(&simulator, context, &camera, &options, err), HADA_ERROR_SIZE, "padded");
    options.field_rows = HIGH - 1;
    ASSERT_FAILS(hada_simulator_create(&simulator, context, &camera, &options, err), HADA_ERROR_SIZE, "");
    options.field_rows = 0;
    ASSERT_FAILS(hada_simulator_create(&simulator, context, &camera, &options, err), HADA_ERROR_SIZE, "");
    hada_simulator_options_init(&options);
    options.shift_rows = 1 << 20;
    ASSERT_FAILS(hada_simulator_create(&simulator, context, &camera, &options, err), HADA_ERROR_ARGUMENT, "");
    options.size = 0;
    ASSERT_FAILS(hada_simulator_create(&simulator, context, &camera, &options, err), HADA_ERROR_ARGUMENT, "");
    assert_null(simulator);
}

FIXTURE(open_device, close_device)
