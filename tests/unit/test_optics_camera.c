/* Cameras and their point spread functions against the closed forms of geometric optics. */
#include "testing.h"

#include "optics/mask.h"

static const char *const presets[] = {"sim512", "sim300", "crop300", "paper2022"};

static hada_camera preset(const char *name)
{
    hada_camera camera = {.size = sizeof camera};
    assert_int_equal(hada_camera_preset(&camera, name, NULL), HADA_OK);
    return camera;
}

typedef struct moments {
    double sum, row, col, spread; /* spread: variance along rows and columns, summed */
} moments;

static moments measure(const hada_image *psf)
{
    moments m = {0};
    double rr = 0.0, cc = 0.0;
    for (int r = 0; r < psf->rows; r++)
        for (int k = 0; k < psf->cols; k++) {
            const double v = psf->data[(size_t)r * (size_t)psf->cols + (size_t)k];
            m.sum += v;
            m.row += v * r;
            m.col += v * k;
            rr += v * r * r;
            cc += v * k * k;
        }
    m.row /= m.sum;
    m.col /= m.sum;
    m.spread = rr / m.sum - m.row * m.row + cc / m.sum - m.col * m.col;
    return m;
}

/* One lens alone, so that its spot can be measured. */
static hada_camera single_lens(void)
{
    hada_camera camera = preset("sim512");
    camera.lenses = 1;
    camera.blur_pixels = 0.8; /* so wide that moments of pixels are those of the light */
    camera.rows = 301;
    camera.cols = 280;
    camera.window_rows = camera.window_cols = 64;
    camera.minimum_spacing_mm = 10.0; /* keeps the whole outline inside the aperture */
    return camera;
}

TEST(presets_hold_together)
{
    for (size_t p = 0; p < sizeof presets / sizeof *presets; p++) {
        const hada_camera camera = preset(presets[p]);
        hada_error err;
        assert_int_equal(hada_camera_check(&camera, &err), HADA_OK);
        assert_true(camera.distances_mm[0] == 100.0 && camera.distances_mm[camera.depths - 1] == 600.0);
        double x[64], y[64], widest = 0.0;
        assert_int_equal(hada_camera_lenses(&camera, x, y, &err), HADA_OK);
        for (int i = 0; i < camera.lenses; i++) {
            widest = fmax(widest, fmax(fabs(x[i]), fabs(y[i])));
            assert_true(hypot(x[i], y[i]) <= camera.aperture_mm / 2.0);
            for (int j = 0; j < i; j++)
                assert_true(hypot(x[i] - x[j], y[i] - y[j]) >= camera.minimum_spacing_mm);
        }
        /* the pattern of a full window fits on the sensor at the nearest depth, or is made not to */
        const int crops = !strcmp(presets[p], "crop300");
        const double reach = widest * hada_camera_magnification(&camera, 100.0) / camera.pixel_pitch_mm +
                             camera.window_rows / 2.0 + hada_camera_defocus_pixels(&camera, 100.0) / 2.0;
        assert_true(crops == (reach > camera.rows / 2.0) && crops == (camera.boundary == HADA_BOUNDARY_PADDED));
        /* and the outermost spots move visibly from one depth to the next */
        for (int i = 1; i < camera.depths; i++) {
            const double move = widest / camera.pixel_pitch_mm *
                                (hada_camera_magnification(&camera, camera.distances_mm[i - 1]) -
                                 hada_camera_magnification(&camera, camera.distances_mm[i]));
            assert_true(move >= (crops ? 1.0 : 2.0));
        }
    }
}

TEST(light_sums_to_one)
{
    hada_camera camera = preset("sim300");
    for (int i = 0; i < camera.depths; i++) {
        SCOPED(hada_image) psf;
        assert_int_equal(hada_camera_psf(&camera, camera.distances_mm[i], 0, 0, &psf, NULL), HADA_OK);
        const moments m = measure(&psf);
        assert_true(fabs(m.sum - 1.0) < 1e-6);
    }
    /* a sensor that is too small loses light, and holds exactly the middle of the larger image */
    SCOPED(hada_image) whole, part, cut;
    assert_int_equal(hada_camera_psf(&camera, 100.0, 0, 0, &whole, NULL), HADA_OK);
    assert_int_equal(hada_camera_psf(&camera, 100.0, 101, 90, &part, NULL), HADA_OK);
    assert_int_equal(hada_image_crop(&cut, &whole, 150 - 50, 200 - 45, 101, 90, NULL), HADA_OK);
    assert_true(measure(&part).sum < 0.9);
    assert_memory_equal(part.data, cut.data, hada_image_count(&cut) * sizeof(float));
}

TEST(spots_are_where_rays_meet)
{
    const hada_camera camera = single_lens();
    double x, y;
    assert_int_equal(hada_camera_lenses(&camera, &x, &y, NULL), HADA_OK);
    assert_true(hypot(x, y) > 0.1);
    const double distances[] = {60.0, 100.0, 170.0, 400.0, 1e9};
    for (size_t i = 0; i < sizeof distances / sizeof *distances; i++) {
        SCOPED(hada_image) psf;
        assert_int_equal(hada_camera_psf(&camera, distances[i], 0, 0, &psf, NULL), HADA_OK);
        const moments m = measure(&psf);
        const double magnification = 1.0 + camera.distance_mm / distances[i];
        assert_true(fabs(m.row - (150 + y * magnification / camera.pixel_pitch_mm)) < 2e-3);
        assert_true(fabs(m.col - (140 + x * magnification / camera.pixel_pitch_mm)) < 2e-3);
        /* variance: a disc of radius R has R^2/4 a side, a pixel 1/12 a side, the Gaussian its own */
        const double radius = hada_camera_defocus_pixels(&camera, distances[i]) / 2.0;
        const double expected = 2.0 * (radius * radius / 4.0 + camera.blur_pixels * camera.blur_pixels + 1.0 / 12.0);
        assert_true(fabs(m.spread - expected) < 0.02 * expected);
    }
}

TEST(focus_is_sharpest)
{
    const hada_camera camera = single_lens();
    /* 1/z = 1/f - 1/d */
    const double focus = 1.0 / (1.0 / camera.focal_length_mm - 1.0 / camera.distance_mm);
    assert_true(fabs(focus - 170.0) < 1e-9);
    assert_true(hada_camera_defocus_pixels(&camera, focus) < 1e-9);
    const double distances[] = {focus, 0.8 * focus, 1.25 * focus, 0.5 * focus, 3.0 * focus};
    double spread[5];
    for (int i = 0; i < 5; i++) {
        SCOPED(hada_image) psf;
        assert_int_equal(hada_camera_psf(&camera, distances[i], 0, 0, &psf, NULL), HADA_OK);
        spread[i] = measure(&psf).spread;
    }
    assert_true(spread[0] < spread[1] && spread[0] < spread[2] && spread[1] < spread[3] && spread[2] < spread[4]);
}

TEST(overlapping_lenses_share_the_ground)
{
    /* Two lenses so large that the line between their centres parts the aperture: out of focus, each image is its part
     * of the aperture, so at d = f and z -> 0 distance the pattern's area is that of the aperture, not twice. */
    hada_camera camera = preset("paper2022");
    hada_camera small = camera;
    small.lens_diameter_mm = 1.2; /* no overlap at a spacing of 1.2 mm */
    SCOPED(hada_image) shared, apart;
    assert_int_equal(hada_camera_psf(&camera, 100.0, 800, 800, &shared, NULL), HADA_OK);
    assert_int_equal(hada_camera_psf(&small, 100.0, 800, 800, &apart, NULL), HADA_OK);
    assert_true(fabs(measure(&shared).sum - 1.0) < 1e-5);
    assert_true(fabs(measure(&apart).sum - 1.0) < 1e-5);
    double peak_shared = 0.0, peak_apart = 0.0;
    for (size_t i = 0; i < hada_image_count(&shared); i++) {
        peak_shared = fmax(peak_shared, shared.data[i]);
        peak_apart = fmax(peak_apart, apart.data[i]);
    }
    /* one spot is the scaled ground of its lens, evenly bright: 1 / (all ground in pixels). Unshared 3 mm lenses would
     * overlap on the sensor at 0.15 scale only at spacings below 0.45 mm, so brightness tells the total ground. */
    const double pixels = 0.15 * 0.15 / (camera.pixel_pitch_mm * camera.pixel_pitch_mm);
    const double ground_apart = 37.0 * 3.14159265 * 0.36;
    assert_true(fabs(peak_apart * pixels * ground_apart - 1.0) < 0.05);
    const double ground = 1.0 / (peak_shared * pixels);
    assert_true(ground < 3.14159265 * 36.0 && ground > 0.7 * 3.14159265 * 36.0);
}

TEST(same_seed_same_mask)
{
    hada_camera camera = preset("sim300");
    double x[2][29], y[2][29];
    assert_int_equal(hada_camera_lenses(&camera, x[0], y[0], NULL), HADA_OK);
    assert_int_equal(hada_camera_lenses(&camera, x[1], y[1], NULL), HADA_OK);
    assert_memory_equal(x[0], x[1], sizeof x[0]);
    camera.seed++;
    assert_int_equal(hada_camera_lenses(&camera, x[1], y[1], NULL), HADA_OK);
    assert_true(memcmp(x[0], x[1], sizeof x[0]) != 0);
}

TEST(files)
{
    hada_camera camera = preset("paper2022"), back = {.size = sizeof back};
    camera.seed = UINT64_MAX - 5;
    camera.boundary = HADA_BOUNDARY_PADDED;
    char path[] = "/tmp/hadalens-camera-XXXXXX";
    const int handle = mkstemp(path);
    assert_true(handle >= 0);
    close(handle);
    ASSERT_OK(hada_camera_save(&camera, path, err));
    ASSERT_OK(hada_camera_load(&back, path, err));
    assert_true(back.seed == camera.seed && back.boundary == camera.boundary && back.depths == camera.depths);
    assert_true(back.rows == 1376 && back.cols == 2064 && back.window_rows == 383);
    assert_true(fabs(back.pixel_pitch_mm / camera.pixel_pitch_mm - 1.0) < 1e-14);
    for (int i = 0; i < camera.depths; i++)
        assert_true(fabs(back.distances_mm[i] / camera.distances_mm[i] - 1.0) < 1e-14);
    /* a file of a few hundred bytes is no reason for gigabytes, but where it is trusted */
    camera.rows = camera.cols = 4000;
    DEFAULTS(hada_limits, limits);
    ASSERT_OK(hada_camera_save(&camera, path, err));
    ASSERT_FAILS(hada_camera_load(&back, path, err), HADA_ERROR_FILE_FORMAT, "options.limits pixels=6000001");
    ASSERT_OK(hada_limits_parse(&limits, "pixels=6000001", err));
    ASSERT_OK(hada_limits_set(&limits, err));
    ASSERT_OK(hada_camera_load(&back, path, err));
    ASSERT_OK(hada_limits_set(NULL, err));
    const char *const bad[] = {"{",
                               "[1]",
                               "{\"rows\": \"many\"}",
                               "{\"rows\": 100}",
                               "{\"distances_mm\": [3, 2]}",
                               "{\"mask\": \"hole\"}",
                               "{\"mask\": null}",
                               "{\"boundary\": 1}",
                               "{\"optics\": [\"wave\"]}",
                               "{\"seed\": [1]}",
                               "{\"seed\": 1.5}",
                               "{\"seed\": -5}",
                               "{\"seed\": \"-5\"}",
                               "{\"seed\": \" 5\"}",
                               "{\"seed\": \"5x\"}",
                               "{\"seed\": \"\"}",
                               "{\"seed\": \"18446744073709551616\"}"};
    const hada_status why[] = {HADA_ERROR_FILE_FORMAT, HADA_ERROR_FILE_FORMAT, HADA_ERROR_FILE_FORMAT, HADA_ERROR_SIZE,
                               HADA_ERROR_FILE_FORMAT, HADA_ERROR_FILE_FORMAT, HADA_ERROR_FILE_FORMAT};
    for (int i = 0; i < (int)(sizeof bad / sizeof *bad); i++) {
        FILE *file = fopen(path, "w");
        fputs(bad[i], file);
        fclose(file);
        ASSERT_FAILS(hada_camera_load(&back, path, err), why[i < 6 ? i : 6], path);
    }
    unlink(path);
    ASSERT_FAILS(hada_camera_load(&back, path, err), HADA_ERROR_FILE_OPEN, "");
    ASSERT_FAILS(hada_camera_save(&camera, "/nonexistent/folder/camera.json", err), HADA_ERROR_FILE_WRITE, "");
}

TEST(refusals)
{
    hada_camera camera = {.size = sizeof camera};
    ASSERT_FAILS(hada_camera_preset(&camera, "sim9", err), HADA_ERROR_ARGUMENT, "paper2022");
    camera = preset("sim300");
    ASSERT_FAILS(hada_camera_set_depths(&camera, 600.0, 100.0, 4, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_camera_set_depths(&camera, 100.0, 600.0, 0, err), HADA_ERROR_ARGUMENT, "");
    camera.window_rows = 301;
    ASSERT_FAILS(hada_camera_check(&camera, err), HADA_ERROR_SIZE, "");
    camera = preset("sim300");
    camera.minimum_spacing_mm = 4.0;
    double x[29], y[29];
    ASSERT_FAILS(hada_camera_lenses(&camera, x, y, err), HADA_ERROR_ARGUMENT, "29 lenses");
    camera = preset("sim300");
    /* lengths that each are possible, and no light that arrives */
    hada_image psf;
    camera.aperture_mm = 1e6;
    ASSERT_FAILS(hada_camera_psf(&camera, 100.0, 0, 0, &psf, err), HADA_ERROR_ARGUMENT,
                 "no light of a point at 100 mm");
    assert_null(psf.data);
    camera = preset("sim300");
    camera.size = 4;
    ASSERT_FAILS(hada_camera_check(&camera, err), HADA_ERROR_ARGUMENT, "");
}

TEST(resizing_keeps_the_pattern)
{
    hada_camera camera = preset("sim512");
    assert_int_equal(hada_camera_resize(&camera, 128, 160, 0, 0, NULL), HADA_OK);
    assert_int_equal(camera.window_rows, 48);
    assert_int_equal(camera.window_cols, 48);
    assert_true(fabs(camera.pixel_pitch_mm * 128 - 0.07 * 512) < 1e-12);
    assert_int_equal(hada_camera_resize(&camera, 128, 160, 129, 40, NULL), HADA_ERROR_SIZE);
}
