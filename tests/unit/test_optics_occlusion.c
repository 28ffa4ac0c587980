/* Opaque planes, lens by lens, or patch by patch of a mask without lenses. Against rays drawn one by one in double
 * precision. */
#include "forward_fixture.h"

#include "optics/mask.h"
#include "optics/simulator.h"
#include "ref/ref_convolve.h"
#include "ref/ref_forward.h"

/* A plane's part of the expected frame, all in one channel: ray by ray through every lens. */
static void add_expected(const hada_camera *camera, const hada_image *image, int channel, int depth,
                         const hada_image *const *blockers, const int *blocker_depths, int count, int lens, double *out)
{
    static float view[PIXELS], part[4 * PIXELS];
    double x[LENSES], y[LENSES];
    SCOPED(hada_image) psf;
    const double far_mm = camera->distances_mm[depth], pitch = camera->pixel_pitch_mm;
    ASSERT_OK(hada_camera_lenses(camera, x, y, err));
    ASSERT_OK(hada_camera_psf(camera, far_mm, 2 * ROWS, 2 * COLS, &psf, err));
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
}

/* Three planes, the nearer two opaque in places; and the same through one lens. */
TEST(occlusion)
{
    static double expected[PIXELS];
    const hada_camera camera = small_camera(HADA_BOUNDARY_PADDED);
    SCOPED(hada_simulator) *simulator = simulator_of(&camera, 0, 0, 0, 0);
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
            assert_true(relative_error(raw.data + channel * PIXELS, expected, PIXELS) < 1e-6);
        }
        hada_image_destroy(&raw);
    }
    destroy_images(scenes, 3);
    destroy_images(opacity, 2);
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
TEST(limits_of_occlusion)
{
    enum { HIGHER = 40, WIDER = 44 };
    const hada_camera camera = small_camera(HADA_BOUNDARY_CIRCULAR);
    hada_image psf[4], scenes[2], opacity, plain, raw, alone, sum, one;
    for (int z = 0; z < 4; z++) {
        SCOPED(hada_image) grey;
        ASSERT_OK(hada_camera_psf(&camera, camera.distances_mm[z], 0, 0, &grey, err));
        ASSERT_OK(hada_image_create(&psf[z], 3, ROWS, COLS, err));
        for (int i = 0; i < 3 * PIXELS; i++)
            psf[z].data[i] = grey.data[i % PIXELS] * (1.0f + 0.5f * (float)(i / PIXELS));
    }
    DEFAULTS(hada_simulator_options, options);
    options.psf = psf;
    options.shift_rows = -3;
    options.shift_cols = 5;
    options.field_rows = HIGHER;
    options.field_cols = WIDER;
    SCOPED(hada_simulator) * simulator;
    ASSERT_OK(hada_simulator_create(&simulator, context, &camera, &options, err));
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
}

static double distance_of(const hada_image *a, const hada_image *b)
{
    double error = 0.0, norm = 0.0;
    for (size_t i = 0; i < hada_image_count(a); i++) {
        error += ((double)a->data[i] - b->data[i]) * ((double)a->data[i] - b->data[i]);
        norm += (double)b->data[i] * b->data[i];
    }
    return sqrt(error / norm);
}

/* A mask without lenses on a coarse sensor; rays land on pixels as in the reference, without a blur of their own. */
static hada_camera plain_mask(hada_mask mask)
{
    hada_camera camera = small_camera(HADA_BOUNDARY_PADDED);
    ASSERT_OK(hada_camera_set_mask(&camera, mask, err));
    if (mask == HADA_MASK_APERTURE) {
        camera.cell_mm = camera.aperture_mm / 9.0;
        camera.open_fraction = 0.5;
    }
    camera.blur_pixels = sqrt(1.0 / 12.0);
    return camera;
}

/* The frame of a plane behind another, ray by ray: every ray with its own parallax. */
static void add_rays(const hada_camera *camera, const hada_image *image, int depth, const hada_image *blocker,
                     int blocker_depth, double *out)
{
    enum { HALF = 140, LOW = 4 };
    hada_mask_design design;
    ASSERT_OK(hada_mask_make(&design, camera, err));
    const double far_mm = camera->distances_mm[depth], step = camera->aperture_mm / 2.0 / HALF,
                 pitch = camera->pixel_pitch_mm, d = camera->distance_mm, m = 1.0 + d / far_mm;
    static double part[PIXELS];
    double all = 0.0;
    memset(part, 0, sizeof part);
    for (int i = -HALF; i <= HALF; i++)
        for (int j = -HALF; j <= HALF; j++) {
            hada_mask_point point;
            double cols = 0.0, rows = 0.0;
            hada_mask_at(&design, j * step, i * step, &point);
            const double light = hada_mask_open(point.edge, step);
            if (!(light > 0.0))
                continue;
            all += light;
            if (blocker)
                hada_camera_parallax(camera, camera->distances_mm[blocker_depth], far_mm, j * step, i * step, &cols,
                                     &rows);
            const double across = (j * step * m + d * point.slope[0]) / pitch,
                         down = (i * step * m + d * point.slope[1]) / pitch;
            for (int r = 0; r < HIGH; r++)
                for (int c = 0; c < WIDE; c++) {
                    const double clear =
                        blocker ? 1.0 - hada_ref_opacity(blocker->data, HIGH, WIDE, r - rows, c - cols) : 1.0;
                    const double y = (ROWS - HIGH) / 2 + r + down, x = (COLS - WIDE) / 2 + c + across;
                    const int top = (int)floor(y), left = (int)floor(x);
                    for (int k = 0; k < LOW; k++) {
                        const int at_r = top + k / 2, at_c = left + k % 2;
                        const double share = (1.0 - fabs(y - at_r)) * (1.0 - fabs(x - at_c));
                        if (at_r >= 0 && at_r < ROWS && at_c >= 0 && at_c < COLS)
                            part[at_r * COLS + at_c] += light * clear * share * image->data[r * WIDE + c];
                    }
                }
        }
    for (int i = 0; i < PIXELS; i++)
        out[i] += part[i] / all;
    hada_mask_free(&design);
}

/* Masks without lenses, patch by patch: nearer to the rays the smaller the patches are. */
TEST(patches)
{
    static const hada_mask masks[] = {HADA_MASK_DIFFUSER, HADA_MASK_CONTOUR, HADA_MASK_APERTURE};
    static double expected[PIXELS];
    hada_image scenes[2], opacity, raw;
    for (int i = 0; i < 2; i++)
        scenes[i] = drawn(50 + (uint64_t)i, 1, HIGH, WIDE);
    ASSERT_OK(hada_image_create(&opacity, 1, HIGH, WIDE, err));
    for (int r = 0; r < HIGH; r++)
        for (int c = 0; c < WIDE; c++)
            opacity.data[r * WIDE + c] = hypot(r - 11, c - 14) < 6.3;
    const hada_plane planes[] = {{0, &scenes[0]}, {3, &scenes[1]}};
    const hada_image *const opacities[] = {&opacity, NULL};
    for (int k = 0; k < 3; k++) {
        const hada_camera camera = plain_mask(masks[k]);
        SCOPED(hada_simulator) *simulator = simulator_of(&camera, 0, 0, 0, 0);
        memset(expected, 0, sizeof expected);
        add_rays(&camera, &scenes[1], 3, &opacity, 0, expected);
        add_rays(&camera, &scenes[0], 0, NULL, 0, expected);
        double before = HUGE_VAL, first = 0.0;
        for (double pixels = 4.0; pixels > 0.4; pixels /= 2.0) {
            simulator->patch_pixels = pixels;
            ASSERT_OK(hada_simulator_render_occluded(simulator, planes, opacities, 2, -1, 0.0, 0, &raw, err));
            const double error = relative_error(raw.data, expected, PIXELS);
            hada_image_destroy(&raw);
            print_message("mask %d, patches of %g pixels of parallax: %.2e\n", (int)masks[k], pixels, error);
            assert_true(error < before);
            before = error;
            first = first > 0.0 ? first : error;
        }
        assert_true(first < 0.03 && before < 0.1 * first);
    }
    hada_image_destroy(&scenes[0]);
    hada_image_destroy(&scenes[1]);
    hada_image_destroy(&opacity);
}

/* The patches together are the camera, whatever made the PSF; a closed plane leaves nothing. */
TEST(all_patches)
{
    hada_image scenes[2], opacity, raw, plain, psf[4];
    const hada_camera camera = plain_mask(HADA_MASK_CONTOUR);
    hada_simulator *simulators[2] = {simulator_of(&camera, -3, 5, 0, 0)};
    DEFAULTS(hada_simulator_options, options);
    for (int z = 0; z < 4; z++) /* light everywhere, also where no ray of the mask goes */
        psf[z] = drawn(70 + (uint64_t)z, 3, ROWS, COLS);
    options.psf = psf;
    ASSERT_OK(hada_simulator_create(&simulators[1], context, &camera, &options, err));
    for (int i = 0; i < 2; i++)
        scenes[i] = drawn(60 + (uint64_t)i, 3, HIGH, WIDE);
    ASSERT_OK(hada_image_create(&opacity, 1, HIGH, WIDE, err));
    const hada_plane planes[] = {{0, &scenes[0]}, {3, &scenes[1]}};
    const hada_image *const opacities[] = {&opacity, NULL};
    for (int k = 0; k < 2; k++) {
        ASSERT_OK(hada_simulator_render(simulators[k], planes, 2, 0.0, 0, &plain, err));
        ASSERT_OK(hada_simulator_render_occluded(simulators[k], planes, opacities, 2, -1, 0.0, 0, &raw, err));
        assert_true(distance_of(&raw, &plain) < 1e-6);
        hada_image_destroy(&plain);
        hada_image_destroy(&raw);
    }
    ASSERT_FAILS(hada_simulator_render_occluded(simulators[0], planes, opacities, 2, 0, 0.0, 0, &raw, err),
                 HADA_ERROR_ARGUMENT, "whole mask");
    for (int k = 0; k < 2; k++)
        hada_simulator_destroy(&simulators[k]);
    destroy_images(psf, 4);
    destroy_images(scenes, 2);
    hada_image_destroy(&opacity);
}

TEST(refusals)
{
    const hada_camera camera = small_camera(HADA_BOUNDARY_CIRCULAR);
    SCOPED(hada_simulator) * simulator;
    hada_image raw;
    SCOPED(hada_image) scene = drawn(1, 3, HIGH, WIDE), opacity;
    simulator = simulator_of(&camera, 0, 0, 0, 0);
    ASSERT_OK(hada_image_create(&opacity, 1, HIGH, WIDE, err));
    const hada_plane planes[] = {{0, &scene}, {2, &scene}};
    const hada_image *const opacities[] = {&opacity, NULL};
    opacity.data[4] = 1.5f;
    ASSERT_FAILS(hada_simulator_render_occluded(simulator, planes, opacities, 2, -1, 0.0, 0, &raw, err),
                 HADA_ERROR_ARGUMENT, "");
    opacity.data[4] = NAN;
    ASSERT_FAILS(hada_simulator_render_occluded(simulator, planes, opacities, 2, -1, 0.0, 0, &raw, err),
                 HADA_ERROR_ARGUMENT, "");
    opacity.cols--;
    ASSERT_FAILS(hada_simulator_render_occluded(simulator, planes, opacities, 2, -1, 0.0, 0, &raw, err),
                 HADA_ERROR_SIZE, "");
    ASSERT_FAILS(hada_simulator_render_occluded(simulator, planes, NULL, 2, LENSES, 0.0, 0, &raw, err),
                 HADA_ERROR_ARGUMENT, "7 lenses");
    assert_null(raw.data);
}

FIXTURE(open_device, close_device)
