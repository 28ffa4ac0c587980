/* Scenes on surfaces: against PSFs made for every distance that occurs, in double precision. */
#include "forward_fixture.h"

#include "optics/mask.h"
#include "ref/ref_convolve.h"
#include "ref/ref_forward.h"

#define AREA (HIGH * WIDE)

/* A distance for every column, 1/z linear from one end to the other. */
static hada_image slanted(double near_mm, double far_mm)
{
    hada_image map;
    ASSERT_OK(hada_image_create(&map, 1, HIGH, WIDE, err));
    for (int i = 0; i < AREA; i++) {
        const double t = (double)(i % WIDE) / (WIDE - 1);
        map.data[i] = (float)(1.0 / ((1.0 - t) / near_mm + t / far_mm));
    }
    return map;
}

/* One channel of the frame of an image whose columns are at the map's distances. */
static void add_columns(const hada_camera *camera, const hada_image *image, int channel, const hada_image *map,
                        double *out)
{
    static float wide[PIXELS];
    for (int c = 0; c < WIDE; c++) {
        SCOPED(hada_image) psf;
        memset(wide, 0, sizeof wide);
        for (int r = 0; r < HIGH; r++)
            wide[((ROWS - HIGH) / 2 + r) * COLS + (COLS - WIDE) / 2 + c] = image->data[(channel * HIGH + r) * WIDE + c];
        ASSERT_OK(hada_camera_psf(camera, (double)map->data[c], 2 * ROWS, 2 * COLS, &psf, err));
        hada_ref_convolve_crop(ROWS, COLS, wide, 2 * ROWS, 2 * COLS, psf.data, out);
    }
}

/* From before the nearest depth to behind the farthest, on lenses (sharp spots) and a diffuser. Two surfaces add up. */
TEST(every_distance_has_its_psf)
{
    static double expected[PIXELS];
    for (int mask = 0; mask < 2; mask++) {
        hada_camera camera = small_camera(HADA_BOUNDARY_PADDED);
        if (mask)
            ASSERT_OK(hada_camera_set_mask(&camera, HADA_MASK_DIFFUSER, err));
        SCOPED(hada_simulator) *simulator = simulator_of(&camera, 0, 0, 0, 0);
        hada_image map[] = {slanted(80.0, 900.0), slanted(300.0, 120.0)},
                   scene[] = {drawn(3, 3, HIGH, WIDE), drawn(4, 1, HIGH, WIDE)}, raw, again;
        const hada_relief reliefs[] = {{&scene[0], &map[0]}, {&scene[1], &map[1]}};
        ASSERT_OK(hada_simulator_render_reliefs(simulator, reliefs, 2, 0, 0.0, 0, &raw, err));
        memset(expected, 0, sizeof expected);
        add_columns(&camera, &scene[0], 2, &map[0], expected);
        add_columns(&camera, &scene[1], 0, &map[1], expected);
        const double error = relative_error(raw.data + 2 * PIXELS, expected, PIXELS);
        print_message("relative error of the frame, %s: %.1e\n", mask ? "diffuser" : "lenses", error);
        assert_true(error < 3e-3);
        /* what is kept from the first frame changes nothing */
        ASSERT_OK(hada_simulator_render_reliefs(simulator, reliefs, 2, 0, 0.0, 0, &again, err));
        assert_memory_equal(raw.data, again.data, 3 * PIXELS * sizeof(float));
        for (int i = 0; i < 2; i++) {
            hada_image_destroy(&map[i]);
            hada_image_destroy(&scene[i]);
        }
        hada_image_destroy(&raw);
        hada_image_destroy(&again);
    }
}

static double difference(const hada_image *a, const hada_image *b)
{
    static double wide[3 * PIXELS];
    for (int i = 0; i < 3 * PIXELS; i++)
        wide[i] = (double)b->data[i];
    return relative_error(a->data, wide, 3 * PIXELS);
}

/* Opaque: a slope hides nothing of itself; a jump hides what planes hide. */
TEST(opaque_surfaces)
{
    const hada_camera camera = small_camera(HADA_BOUNDARY_PADDED);
    SCOPED(hada_simulator) *simulator = simulator_of(&camera, 0, 0, 0, 0);
    hada_image slope = slanted(100.0, 600.0), jump, scene = drawn(5, 3, HIGH, WIDE), clear, opaque, planes[2], hidden,
               mask;
    hada_relief relief = {&scene, &slope};
    ASSERT_OK(hada_simulator_render_reliefs(simulator, &relief, 1, 0, 0.0, 0, &clear, err));
    ASSERT_OK(hada_simulator_render_reliefs(simulator, &relief, 1, 1, 0.0, 0, &opaque, err));
    assert_true(difference(&opaque, &clear) < 1e-6);
    hada_image_destroy(&clear);
    hada_image_destroy(&opaque);

    ASSERT_OK(hada_image_create(&jump, 1, HIGH, WIDE, err));
    ASSERT_OK(hada_image_create(&mask, 1, HIGH, WIDE, err));
    for (int k = 0; k < 2; k++)
        ASSERT_OK(hada_image_create(&planes[k], 3, HIGH, WIDE, err));
    for (int i = 0; i < 3 * AREA; i++) {
        const int far = i % WIDE / 5 % 2;
        planes[far].data[i] = scene.data[i];
        mask.data[i % AREA] = (float)!far;
        jump.data[i % AREA] = (float)camera.distances_mm[far ? 3 : 0];
    }
    relief.distances_mm = &jump;
    const hada_plane both[] = {{0, &planes[0]}, {3, &planes[1]}};
    const hada_image *const opacity[] = {&mask, NULL};
    ASSERT_OK(hada_simulator_render_occluded(simulator, both, opacity, 2, -1, 0.0, 0, &hidden, err));
    ASSERT_OK(hada_simulator_render_reliefs(simulator, &relief, 1, 0, 0.0, 0, &clear, err));
    ASSERT_OK(hada_simulator_render_reliefs(simulator, &relief, 1, 1, 0.0, 0, &opaque, err));
    assert_true(difference(&clear, &hidden) > 0.1);
    assert_true(difference(&opaque, &hidden) < 3e-3);
    destroy_images(planes, 2);
    hada_image *all[] = {&slope, &jump, &scene, &clear, &opaque, &hidden, &mask};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        hada_image_destroy(all[i]);
}

/* How much of pixel i's light each lens sees past what is nearer by more than a pixel of parallax at the rim of the
 * aperture, each of these pixels at its own distance. Nothing is behind anything else, so shadows add up. */
static void see(const hada_camera *camera, const hada_image *map, int i, const double *x, const double *y, double *seen)
{
    static float opacity[AREA];
    unsigned char done[AREA] = {0};
    for (int l = 0; l < LENSES; l++)
        seen[l] = 1.0;
    for (int j = 0; j < AREA; j++) {
        double cols, rows;
        const double near_mm = (double)map->data[j], far_mm = (double)map->data[i];
        hada_camera_parallax(camera, near_mm, far_mm, camera->aperture_mm / 2.0, 0.0, &cols, &rows);
        if (done[j] || !(cols > 1.0))
            continue;
        for (int k = 0; k < AREA; k++) { /* all pixels at this distance */
            opacity[k] = map->data[k] == map->data[j];
            done[k] |= opacity[k] > 0.0f;
        }
        for (int l = 0; l < LENSES; l++)
            seen[l] -=
                1.0 - hada_ref_clear(camera, opacity, HIGH, WIDE, near_mm, far_mm, x[l], y[l], 4, i / WIDE, i % WIDE);
    }
    for (int l = 0; l < LENSES; l++)
        seen[l] = fmax(seen[l], 0.0);
}

/* One channel of the frame of an opaque surface, pixel by pixel and lens by lens. */
static void add_opaque(const hada_camera *camera, const hada_image *image, int channel, const hada_image *map,
                       double *out)
{
    double x[LENSES], y[LENSES], seen[LENSES];
    const double pitch = camera->pixel_pitch_mm;
    ASSERT_OK(hada_camera_lenses(camera, x, y, err));
    for (int i = 0; i < AREA; i++) {
        SCOPED(hada_image) psf;
        const int row = (ROWS - HIGH) / 2 + i / WIDE, col = (COLS - WIDE) / 2 + i % WIDE;
        see(camera, map, i, x, y, seen);
        ASSERT_OK(hada_camera_psf(camera, (double)map->data[i], 2 * ROWS, 2 * COLS, &psf, err));
        for (int r = 0; r < ROWS; r++)
            for (int c = 0; c < COLS; c++) {
                const float light = psf.data[(r - row + ROWS) * 2 * COLS + (c - col + COLS)];
                if (light > 0.0f)
                    out[r * COLS + c] += (double)light * (double)image->data[channel * AREA + i] *
                                         seen[hada_ref_nearest_spot(camera, x, y, (double)map->data[i],
                                                                    (c - col) * pitch, (r - row) * pitch)];
            }
    }
}

/* A ball before a wall, whose rim falls off steeply: a hard case, with more parallax than the ball has radius. */
TEST(opaque_ball)
{
    static double expected[PIXELS];
    hada_camera camera = small_camera(HADA_BOUNDARY_PADDED);
    camera.pixel_pitch_mm /= 4.0; /* 15 pixels of parallax from the nearest to the farthest depth */
    SCOPED(hada_simulator) *simulator = simulator_of(&camera, 0, 0, 0, 0);
    hada_image raw;
    SCOPED(hada_image) map, scene = drawn(8, 3, HIGH, WIDE);
    ASSERT_OK(hada_scene_relief(&map, HADA_RELIEF_BALL, 0, HIGH, WIDE, err));
    for (int i = 0; i < AREA; i++)
        map.data[i] = (float)(1.0 / (0.01 + ((double)map.data[i]) * (1.0 / 600.0 - 0.01)));
    const hada_relief relief = {&scene, &map};
    memset(expected, 0, sizeof expected);
    add_opaque(&camera, &scene, 1, &map, expected);
    for (int opaque = 0; opaque < 2; opaque++) {
        ASSERT_OK(hada_simulator_render_reliefs(simulator, &relief, 1, opaque, 0.0, 0, &raw, err));
        const double error = relative_error(raw.data + PIXELS, expected, PIXELS);
        print_message("a ball, %s: %.1e from rays\n", opaque ? "opaque" : "clear", error);
        assert_true(opaque ? error < 4e-2 : error > 0.15);
        hada_image_destroy(&raw);
    }
}

/* Where the map is NaN there is nothing; the noise is that of planes. */
TEST(holes_and_noise)
{
    const hada_camera camera = small_camera(HADA_BOUNDARY_PADDED);
    SCOPED(hada_simulator) *simulator = simulator_of(&camera, 0, 0, 0, 0);
    hada_image map = slanted(100.0, 600.0), scene = drawn(6, 3, HIGH, WIDE), dark, holes, noisy;
    hada_relief relief = {&scene, &map};
    ASSERT_OK(hada_image_crop(&dark, &scene, 0, 0, HIGH, WIDE, err));
    for (int i = 0; i < 3 * AREA; i++)
        if (i % 3 == 0)
            dark.data[i] = 0.0f;
    relief.image = &dark;
    ASSERT_OK(hada_simulator_render_reliefs(simulator, &relief, 1, 0, 0.0, 0, &holes, err));
    relief.image = &scene;
    for (int i = 0; i < AREA; i += 3)
        map.data[i] = NAN;
    for (int opaque = 0; opaque < 2; opaque++) {
        ASSERT_OK(hada_simulator_render_reliefs(simulator, &relief, 1, opaque, 0.05, 7, &noisy, err));
        float most = 0.0f;
        double square = 0.0;
        for (int i = 0; i < 3 * PIXELS; i++) {
            most = fmaxf(most, holes.data[i]);
            square += pow((double)(noisy.data[i] - holes.data[i]), 2);
        }
        assert_true(fabs(sqrt(square / (3 * PIXELS)) / (0.05 * (double)most) - 1.0) < 0.03);
        hada_image_destroy(&noisy);
    }
    hada_image *all[] = {&map, &scene, &dark, &holes};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++)
        hada_image_destroy(all[i]);
}

TEST(refusals)
{
    const hada_camera camera = small_camera(HADA_BOUNDARY_CIRCULAR);
    SCOPED(hada_simulator) *simulator = simulator_of(&camera, 0, 0, 0, 0), *given;
    hada_image map = slanted(100.0, 600.0), scene = drawn(7, 3, HIGH, WIDE), psf[4], raw;
    hada_relief relief[] = {{&scene, &map}, {&scene, NULL}};
    hada_error error;
#define REFUSED(count, status, word)                                                                                   \
    do {                                                                                                               \
        assert_int_equal(hada_simulator_render_reliefs(simulator, relief, count, 1, 0.0, 0, &raw, &error), status);    \
        assert_non_null(strstr(error.message, word));                                                                  \
        assert_null(raw.data);                                                                                         \
    } while (0)
    REFUSED(0, HADA_ERROR_ARGUMENT, "0 surfaces");
    REFUSED(2, HADA_ERROR_ARGUMENT, "its distances");
    map.cols--;
    REFUSED(1, HADA_ERROR_SIZE, "24 x 25");
    map.cols++;
    map.data[9] = 0.0f;
    REFUSED(1, HADA_ERROR_ARGUMENT, "0 mm");
    map.data[9] = INFINITY;
    REFUSED(1, HADA_ERROR_ARGUMENT, "inf mm");
    for (int i = 0; i < AREA; i++)
        map.data[i] = NAN;
    REFUSED(1, HADA_ERROR_ARGUMENT, "no pixel");
#undef REFUSED
    for (int z = 0; z < 4; z++)
        ASSERT_OK(hada_camera_psf(&camera, camera.distances_mm[z], 0, 0, &psf[z], err));
    map.data[0] = 200.0f;
    DEFAULTS(hada_simulator_options, with_psf);
    with_psf.psf = psf;
    ASSERT_OK(hada_simulator_create(&given, context, &camera, &with_psf, err));
    assert_int_equal(hada_simulator_render_reliefs(given, relief, 1, 0, 0.0, 0, &raw, &error), HADA_ERROR_UNSUPPORTED);
    destroy_images(psf, 4);
    hada_image_destroy(&map);
    hada_image_destroy(&scene);
}

FIXTURE(open_device, close_device)
