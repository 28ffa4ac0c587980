/* The forward model beyond one convolution a depth: sensors off the axis, scenes wider than the window, opaque planes
 * lens by lens. Against convolution by its definition, and rays drawn one by one, in double precision. */
#include <hadalens/scene.h>
#include <hadalens/simulate.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "ref/ref_convolve.h"
#include "ref/ref_forward.h"
#include "testing.h"

enum { ROWS = 60, COLS = 72, PIXELS = ROWS * COLS, HIGH = 24, WIDE = 26, LENSES = 7 };
static hada_context *context;

static int open_device(void **state)
{
    (void)state;
    return hada_context_create(&context, NULL, NULL);
}

static int close_device(void **state)
{
    (void)state;
    assert_int_equal(hada_context_bytes(context), 0);
    hada_context_destroy(&context);
    return 0;
}

static hada_camera small_camera(hada_boundary boundary)
{
    hada_camera camera;
    ASSERT_OK(hada_camera_preset(&camera, "sim300", err));
    ASSERT_OK(hada_camera_resize(&camera, ROWS, COLS, HIGH, WIDE, err));
    camera.boundary = boundary;
    camera.lenses = LENSES;
    return camera;
}

static hada_simulator *simulator_of(const hada_camera *camera, int shift_rows, int shift_cols, int field_rows,
                                    int field_cols)
{
    hada_simulator *simulator;
    hada_simulator_options options;
    hada_simulator_options_init(&options);
    options.shift_rows = shift_rows;
    options.shift_cols = shift_cols;
    options.field_rows = field_rows;
    options.field_cols = field_cols;
    ASSERT_OK(hada_simulator_create_with(&simulator, context, camera, &options, err));
    return simulator;
}

static hada_image drawn(uint64_t seed, int channels, int rows, int cols)
{
    hada_image image;
    ASSERT_OK(hada_scene_procedural(&image, seed, channels, rows, cols, err));
    return image;
}

static double distance(const float *a, const double *b, size_t count)
{
    double error = 0.0, norm = 0.0;
    for (size_t i = 0; i < count; i++) {
        error += (a[i] - b[i]) * (a[i] - b[i]);
        norm += b[i] * b[i];
    }
    return sqrt(error / norm);
}

/* What a sensor off the axis records is the same light, elsewhere. */
static void shift(void **state)
{
    (void)state;
    hada_camera camera = small_camera(HADA_BOUNDARY_PADDED);
    camera.aperture_mm *= 2.0; /* a pattern wider than the sensor */
    const int down = -9, across = 14;
    hada_simulator *straight = simulator_of(&camera, 0, 0, 0, 0), *moved = simulator_of(&camera, down, across, 0, 0);
    hada_image scene = drawn(3, 3, HIGH, WIDE), here, there, psf, psf_there;
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
    /* beyond the edge stands light that the straight sensor never saw */
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
    hada_simulator_options options;
    hada_simulator_options_init(&options);
    options.psf = psfs;
    options.shift_rows = down;
    options.shift_cols = across;
    ASSERT_OK(hada_simulator_create_with(&moved, context, &camera, &options, err));
    hada_image given;
    ASSERT_OK(hada_simulator_psf(moved, 0, &given, err));
    for (int r = 0; r < ROWS; r++)
        for (int c = 0; c < COLS; c++) {
            const int inside = r + down >= 0 && c + across < COLS;
            assert_true(given.data[r * COLS + c] == (inside ? psf.data[(r + down) * COLS + c + across] : 0.0f));
        }
    hada_image_destroy(&given);
    hada_simulator_destroy(&moved);
    hada_image_destroy(&psf);
    hada_image_destroy(&psf_there);
    hada_image_destroy(&scene);
    hada_image_destroy(&here);
    hada_image_destroy(&there);
}

/* A scene that is wider than the window, the sensor even. */
static void field(void **state)
{
    (void)state;
    enum { HIGHER = 71, WIDER = 90, MARGIN = 20, R = ROWS + 2 * MARGIN, C = COLS + 2 * MARGIN };
    static float canvas[R * C];
    static double all[R * C], expected[PIXELS];
    const hada_camera camera = small_camera(HADA_BOUNDARY_PADDED);
    hada_simulator *simulator = simulator_of(&camera, 0, 0, HIGHER, WIDER);
    hada_image scene = drawn(8, 1, HIGHER, WIDER), psf, raw, window, small, again;
    memset(canvas, 0, sizeof canvas);
    memset(all, 0, sizeof all);
    const int row0 = MARGIN + (ROWS - HIGH) / 2 - (HIGHER - HIGH) / 2,
              col0 = MARGIN + (COLS - WIDE) / 2 - (WIDER - WIDE) / 2;
    for (int r = 0; r < HIGHER; r++)
        memcpy(canvas + (row0 + r) * C + col0, scene.data + r * WIDER, WIDER * sizeof(float));
    ASSERT_OK(hada_camera_psf_sized(&camera, camera.distances_mm[2], 2 * R, 2 * C, &psf, err));
    hada_ref_convolve_crop(R, C, canvas, 2 * R, 2 * C, psf.data, all);
    for (int r = 0; r < ROWS; r++)
        memcpy(expected + r * COLS, all + (MARGIN + r) * C + MARGIN, COLS * sizeof(double));
    ASSERT_OK(hada_simulator_render(simulator, &(hada_plane){2, &scene}, 1, 0.0, 0, &raw, err));
    for (int k = 0; k < 3; k++)
        assert_true(distance(raw.data + k * PIXELS, expected, PIXELS) < 5e-7);
    hada_image_destroy(&raw);
    hada_simulator_destroy(&simulator);
    /* a scene of the window's size means the same with a field and without */
    ASSERT_OK(hada_image_crop(&window, &scene, (HIGHER - HIGH) / 2, (WIDER - WIDE) / 2, HIGH, WIDE, err));
    hada_simulator *narrow = simulator_of(&camera, 0, 0, 0, 0), *wide = simulator_of(&camera, 0, 0, HIGHER, WIDER);
    ASSERT_OK(hada_simulator_render(narrow, &(hada_plane){2, &window}, 1, 0.0, 0, &small, err));
    ASSERT_OK(hada_simulator_render(wide, &(hada_plane){2, &window}, 1, 0.0, 0, &again, err));
    for (int i = 0; i < 3 * PIXELS; i++)
        assert_true(fabsf(small.data[i] - again.data[i]) < 3e-7f);
    hada_simulator_destroy(&narrow);
    hada_simulator_destroy(&wide);
    hada_image_destroy(&scene);
    hada_image_destroy(&psf);
    hada_image_destroy(&window);
    hada_image_destroy(&small);
    hada_image_destroy(&again);
}

/* A plane's part of the expected frame, all in one channel: ray by ray through every lens. */
static void add_expected(const hada_camera *camera, const hada_image *image, int channel, int depth,
                         const hada_image *const *blockers, const int *blocker_depths, int count, int lens, double *out)
{
    static float view[PIXELS], part[4 * PIXELS];
    double x[LENSES], y[LENSES];
    hada_image psf;
    const double far_mm = camera->distances_mm[depth], pitch = camera->pixel_pitch_mm;
    ASSERT_OK(hada_camera_lenses(camera, x, y, err));
    ASSERT_OK(hada_camera_psf_sized(camera, far_mm, 2 * ROWS, 2 * COLS, &psf, err));
    for (int l = 0; l < LENSES; l++) {
        if (lens >= 0 && l != lens)
            continue;
        memset(view, 0, sizeof view);
        for (int r = 0; r < HIGH; r++)
            for (int c = 0; c < WIDE; c++) {
                double light = image->data[(channel * HIGH + r) * WIDE + c];
                for (int j = 0; j < count; j++)
                    light *= hada_ref_clear(camera, blockers[j]->data, HIGH, WIDE,
                                            camera->distances_mm[blocker_depths[j]], far_mm, x[l], y[l], 4, r, c);
                view[((ROWS - HIGH) / 2 + r) * COLS + (COLS - WIDE) / 2 + c] = (float)light;
            }
        for (int r = 0; r < 2 * ROWS; r++)
            for (int c = 0; c < 2 * COLS; c++)
                part[r * 2 * COLS + c] =
                    hada_ref_nearest_spot(camera, x, y, far_mm, (c - COLS) * pitch, (r - ROWS) * pitch) == l
                        ? psf.data[r * 2 * COLS + c]
                        : 0.0f;
        hada_ref_convolve_crop(ROWS, COLS, view, 2 * ROWS, 2 * COLS, part, out);
    }
    hada_image_destroy(&psf);
}

/* Three planes, the nearer two opaque in places; and the same through one lens. */
static void occlusion(void **state)
{
    (void)state;
    static double expected[PIXELS];
    const hada_camera camera = small_camera(HADA_BOUNDARY_PADDED);
    hada_simulator *simulator = simulator_of(&camera, 0, 0, 0, 0);
    hada_image scenes[3], opacity[2], raw;
    for (int i = 0; i < 3; i++)
        scenes[i] = drawn(20 + (uint64_t)i, i == 1 ? 1 : 3, HIGH, WIDE);
    for (int i = 0; i < 2; i++) {
        ASSERT_OK(hada_image_create(&opacity[i], 1, HIGH, WIDE, err));
        for (int r = 0; r < HIGH; r++)
            for (int c = 0; c < WIDE; c++)
                opacity[i].data[r * WIDE + c] = i ? (r + c) % 7 / 8.0f : hypot(r - 11, c - 14) < 6.3;
    }
    /* the nearest one is given last: order says nothing, depth does */
    const hada_plane planes[] = {{3, &scenes[0]}, {1, &scenes[1]}, {0, &scenes[2]}};
    const hada_image *const opacities[] = {NULL, &opacity[1], &opacity[0]};
    const hada_image *const blockers[] = {&opacity[1], &opacity[0]};
    const int depths[] = {1, 0};
    for (int lens = -1; lens < LENSES; lens += LENSES - 2) {
        ASSERT_OK(hada_simulator_render_occluded(simulator, planes, opacities, 3, lens, 0.0, 0, &raw, err));
        for (int channel = 0; channel < 3; channel += 2) {
            memset(expected, 0, sizeof expected);
            add_expected(&camera, &scenes[0], channel, 3, blockers, depths, 2, lens, expected);
            add_expected(&camera, &scenes[1], 0, 1, blockers + 1, depths + 1, 1, lens, expected);
            add_expected(&camera, &scenes[2], channel, 0, NULL, NULL, 0, lens, expected);
            assert_true(distance(raw.data + channel * PIXELS, expected, PIXELS) < 1e-6);
        }
        hada_image_destroy(&raw);
    }
    for (int i = 0; i < 3; i++)
        hada_image_destroy(&scenes[i]);
    for (int i = 0; i < 2; i++)
        hada_image_destroy(&opacity[i]);
    hada_simulator_destroy(&simulator);
}

static double largest_difference(const hada_image *a, const hada_image *b)
{
    double most = 0.0;
    for (size_t i = 0; i < hada_image_count(a); i++)
        most = fmax(most, fabs((double)a->data[i] - b->data[i]));
    return most;
}

/* Clear planes change nothing, closed ones leave nothing; the lenses together are the camera. With a sensor off the
 * axis, a wide field and PSFs in colour. */
static void limits_of_occlusion(void **state)
{
    (void)state;
    enum { HIGHER = 40, WIDER = 44 };
    const hada_camera camera = small_camera(HADA_BOUNDARY_CIRCULAR);
    hada_image psf[4], scenes[2], opacity, plain, raw, alone, sum, one;
    for (int z = 0; z < 4; z++) {
        hada_image grey;
        ASSERT_OK(hada_camera_psf(&camera, camera.distances_mm[z], &grey, err));
        ASSERT_OK(hada_image_create(&psf[z], 3, ROWS, COLS, err));
        for (int i = 0; i < 3 * PIXELS; i++)
            psf[z].data[i] = grey.data[i % PIXELS] * (1.0f + 0.5f * (float)(i / PIXELS));
        hada_image_destroy(&grey);
    }
    hada_simulator_options options;
    hada_simulator_options_init(&options);
    options.psf = psf;
    options.shift_rows = -3;
    options.shift_cols = 5;
    options.field_rows = HIGHER;
    options.field_cols = WIDER;
    hada_simulator *simulator;
    ASSERT_OK(hada_simulator_create_with(&simulator, context, &camera, &options, err));
    scenes[0] = drawn(31, 3, HIGHER, WIDER);
    scenes[1] = drawn(32, 3, HIGHER, WIDER);
    ASSERT_OK(hada_image_create(&opacity, 1, HIGHER, WIDER, err));
    const hada_plane planes[] = {{0, &scenes[0]}, {2, &scenes[1]}};
    const hada_image *const opacities[] = {&opacity, NULL};
    ASSERT_OK(hada_simulator_render(simulator, planes, 2, 0.0, 0, &plain, err));
    ASSERT_OK(hada_simulator_render_occluded(simulator, planes, opacities, 2, -1, 0.0, 0, &raw, err));
    assert_true(largest_difference(&plain, &raw) < 1e-6);
    hada_image_destroy(&raw);
    /* twice the same bits, and noise as without occlusion */
    ASSERT_OK(hada_simulator_render_occluded(simulator, planes, opacities, 2, -1, 0.02, 9, &raw, err));
    ASSERT_OK(hada_simulator_render_occluded(simulator, planes, opacities, 2, -1, 0.02, 9, &one, err));
    assert_memory_equal(raw.data, one.data, 3 * PIXELS * sizeof(float));
    assert_true(largest_difference(&plain, &raw) > 0.02 * 0.3);
    hada_image_destroy(&raw);
    hada_image_destroy(&one);
    ASSERT_OK(hada_image_create(&sum, 3, ROWS, COLS, err));
    for (int lens = 0; lens < LENSES; lens++) {
        ASSERT_OK(hada_simulator_render_occluded(simulator, planes, NULL, 2, lens, 0.0, 0, &one, err));
        for (int i = 0; i < 3 * PIXELS; i++)
            sum.data[i] += one.data[i];
        hada_image_destroy(&one);
    }
    assert_true(largest_difference(&plain, &sum) < 2e-6);
    for (int i = 0; i < HIGHER * WIDER; i++)
        opacity.data[i] = 1.0f;
    /* the far plane shows beyond the near one's edges only: here in a window that no lens sees past */
    hada_image inner, cut;
    ASSERT_OK(hada_image_crop(&inner, &scenes[1], 12, 13, 16, 18, err));
    ASSERT_OK(hada_image_create(&cut, 3, HIGHER, WIDER, err));
    for (int c = 0; c < 3; c++)
        for (int r = 0; r < 16; r++)
            memcpy(cut.data + (c * HIGHER + 12 + r) * WIDER + 13, inner.data + (c * 16 + r) * 18, 18 * sizeof(float));
    const hada_plane behind[] = {{0, &scenes[0]}, {2, &cut}};
    ASSERT_OK(hada_simulator_render(simulator, planes, 1, 0.0, 0, &alone, err));
    ASSERT_OK(hada_simulator_render_occluded(simulator, behind, opacities, 2, -1, 0.0, 0, &raw, err));
    assert_true(largest_difference(&alone, &raw) < 1e-6);
    hada_image *all[] = {&psf[0], &psf[1], &psf[2], &psf[3], &scenes[0], &scenes[1], &opacity,
                         &plain,  &raw,    &alone,  &sum,    &inner,     &cut};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        hada_image_destroy(all[i]);
    hada_simulator_destroy(&simulator);
}

/* p d (1/near - 1/far) / pitch */
static void parallax(void **state)
{
    (void)state;
    const hada_camera camera = small_camera(HADA_BOUNDARY_CIRCULAR);
    double cols, rows;
    hada_camera_parallax(&camera, 100.0, 600.0, 2.0, -4.0, &cols, &rows);
    assert_true(fabs(cols - 2.0 * 30.0 * (1.0 / 100.0 - 1.0 / 600.0) / camera.pixel_pitch_mm) < 1e-12);
    assert_true(fabs(rows + 2.0 * cols) < 1e-12);
}

static void white_exposure(void **state)
{
    (void)state;
    const hada_camera camera = small_camera(HADA_BOUNDARY_CIRCULAR);
    hada_simulator *simulator = simulator_of(&camera, 0, 0, 0, 0);
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
    hada_simulator_destroy(&simulator);
}

static void refusals(void **state)
{
    (void)state;
    const hada_camera camera = small_camera(HADA_BOUNDARY_CIRCULAR);
    hada_simulator *simulator;
    hada_simulator_options options;
    hada_error error;
    hada_image scene = drawn(1, 3, HIGH, WIDE), opacity, raw;
    hada_simulator_options_init(&options);
    options.field_rows = ROWS + 1;
    options.field_cols = COLS;
    assert_int_equal(hada_simulator_create_with(&simulator, context, &camera, &options, &error), HADA_ERROR_SIZE);
    assert_non_null(strstr(error.message, "padded"));
    options.field_rows = HIGH - 1;
    assert_int_equal(hada_simulator_create_with(&simulator, context, &camera, &options, &error), HADA_ERROR_SIZE);
    options.field_rows = 0;
    assert_int_equal(hada_simulator_create_with(&simulator, context, &camera, &options, &error), HADA_ERROR_SIZE);
    hada_simulator_options_init(&options);
    options.shift_rows = 1 << 20;
    assert_int_equal(hada_simulator_create_with(&simulator, context, &camera, &options, &error), HADA_ERROR_ARGUMENT);
    options.size = 0;
    assert_int_equal(hada_simulator_create_with(&simulator, context, &camera, &options, &error), HADA_ERROR_ARGUMENT);
    assert_null(simulator);

    simulator = simulator_of(&camera, 0, 0, 0, 0);
    ASSERT_OK(hada_image_create(&opacity, 1, HIGH, WIDE, err));
    const hada_plane planes[] = {{0, &scene}, {2, &scene}};
    const hada_image *const opacities[] = {&opacity, NULL};
    opacity.data[4] = 1.5f;
    assert_int_equal(hada_simulator_render_occluded(simulator, planes, opacities, 2, -1, 0.0, 0, &raw, &error),
                     HADA_ERROR_ARGUMENT);
    opacity.data[4] = NAN;
    assert_int_equal(hada_simulator_render_occluded(simulator, planes, opacities, 2, -1, 0.0, 0, &raw, &error),
                     HADA_ERROR_ARGUMENT);
    opacity.cols--;
    assert_int_equal(hada_simulator_render_occluded(simulator, planes, opacities, 2, -1, 0.0, 0, &raw, &error),
                     HADA_ERROR_SIZE);
    assert_int_equal(hada_simulator_render_occluded(simulator, planes, NULL, 2, LENSES, 0.0, 0, &raw, &error),
                     HADA_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "7 lenses"));
    assert_null(raw.data);
    hada_image_destroy(&scene);
    hada_image_destroy(&opacity);
    hada_simulator_destroy(&simulator);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(shift),     cmocka_unit_test(field),
                                       cmocka_unit_test(occlusion), cmocka_unit_test(limits_of_occlusion),
                                       cmocka_unit_test(parallax),  cmocka_unit_test(white_exposure),
                                       cmocka_unit_test(refusals)};
    return cmocka_run_group_tests(tests, open_device, close_device);
}
