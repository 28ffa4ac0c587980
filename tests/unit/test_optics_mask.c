/* Masks: positions, what is open, how random surfaces vary, what files keep. */
#include "optics/mask.h"
#include "testing.h"

static hada_camera camera_with(hada_mask mask)
{
    hada_camera camera = {.size = sizeof camera};
    assert_int_equal(hada_camera_preset(&camera, "sim300", NULL), HADA_OK);
    assert_int_equal(hada_camera_set_mask(&camera, mask, NULL), HADA_OK);
    return camera;
}

TEST(grids_are_regular)
{
    const hada_camera camera = camera_with(HADA_MASK_GRID);
    double x[64], y[64], far = 0.0;
    ASSERT_OK(hada_camera_lenses(&camera, x, y, err));
    for (int i = 0; i < camera.lenses; i++) {
        const double across = x[i] / camera.minimum_spacing_mm, down = y[i] / camera.minimum_spacing_mm;
        assert_true(fabs(across - rint(across)) < 1e-12 && fabs(down - rint(down)) < 1e-12);
        far = fmax(far, hypot(x[i], y[i]));
        for (int j = 0; j < i; j++)
            assert_true(hypot(x[i] - x[j], y[i] - y[j]) > 0.999 * camera.minimum_spacing_mm);
    }
    assert_true(x[0] == 0.0 && y[0] == 0.0);
    /* 29 nodes are within 3 periods; the half period round the outermost touches the aperture */
    assert_true(fabs(far - 3.0 * camera.minimum_spacing_mm) < 1e-12);
    assert_true(fabs(far + camera.minimum_spacing_mm / 2.0 - camera.aperture_mm / 2.0) < 1e-12);
    hada_camera wide = camera;
    wide.minimum_spacing_mm *= 1.01;
    assert_int_equal(hada_camera_lenses(&wide, x, y, NULL), HADA_ERROR_ARGUMENT);
}

TEST(spacing_has_two_bounds)
{
    hada_camera camera = camera_with(HADA_MASK_MLA);
    double x[64], y[64];
    camera.maximum_spacing_mm = 1.5;
    for (uint64_t seed = 1; seed < 4; seed++) {
        camera.seed = seed;
        ASSERT_OK(hada_camera_lenses(&camera, x, y, err));
        for (int i = 0; i < camera.lenses; i++) {
            double nearest = HUGE_VAL;
            for (int j = 0; j < camera.lenses; j++)
                if (i != j)
                    nearest = fmin(nearest, hypot(x[i] - x[j], y[i] - y[j]));
            assert_true(nearest >= camera.minimum_spacing_mm && nearest <= 1.5);
        }
    }
    camera.maximum_spacing_mm = camera.minimum_spacing_mm;
    assert_int_equal(hada_camera_check(&camera, NULL), HADA_ERROR_ARGUMENT);
}

TEST(fill_factors)
{
    hada_camera camera = camera_with(HADA_MASK_GRID);
    double fill;
    ASSERT_OK(hada_camera_fill_factor(&camera, &fill, err));
    const double expected = 29.0 * pow(camera.lens_diameter_mm / camera.aperture_mm, 2.0);
    assert_true(fabs(fill - expected) < 0.01 * expected);
    ASSERT_OK(hada_camera_set_fill_factor(&camera, 0.4, err));
    assert_true(fabs(camera.lens_diameter_mm - camera.aperture_mm * sqrt(0.4 / 29.0)) <
                0.005 * camera.lens_diameter_mm);
    assert_int_equal(hada_camera_set_fill_factor(&camera, 1.2, NULL), HADA_ERROR_ARGUMENT);
    hada_camera diffuser = camera_with(HADA_MASK_DIFFUSER);
    ASSERT_OK(hada_camera_fill_factor(&diffuser, &fill, err));
    assert_true(fabs(fill - 1.0) < 1e-12);
    assert_int_equal(hada_camera_set_fill_factor(&diffuser, 0.4, NULL), HADA_ERROR_ARGUMENT);
    hada_camera cells = camera_with(HADA_MASK_APERTURE);
    cells.cell_mm = 0.1;
    cells.open_fraction = 0.25;
    ASSERT_OK(hada_camera_fill_factor(&cells, &fill, err));
    assert_true(fabs(fill - 0.25) < 0.02); /* 11310 cells: 0.004 of a standard deviation */
}

/* The surface by its derivatives, its variance and its autocorrelation. */
TEST(surfaces_vary_as_stated)
{
    hada_surface surface;
    const double half = 20.0, l = 1.0, h = 1e-5;
    double gradient[2], squares = 0.0, products = 0.0, slopes = 0.0;
    ASSERT_OK(hada_surface_make(&surface, 3, l, half, err));
    for (int i = 0; i < 40; i++) {
        const double x = -18.0 + 0.917 * i, y = 17.0 - 0.871 * i;
        hada_surface_at(&surface, x, y, gradient);
        const double dx = hada_surface_at(&surface, x + h, y, NULL) - hada_surface_at(&surface, x - h, y, NULL);
        const double dy = hada_surface_at(&surface, x, y + h, NULL) - hada_surface_at(&surface, x, y - h, NULL);
        assert_true(fabs(dx / (2.0 * h) - gradient[0]) < 1e-6 && fabs(dy / (2.0 * h) - gradient[1]) < 1e-6);
    }
    enum { N = 300 };
    for (int i = 0; i < N * N; i++) {
        const double x = -18.0 + 0.12 * (i % N), y = -18.0 + 0.12 * (i / N);
        const double here = hada_surface_at(&surface, x, y, gradient);
        squares += here * here;
        products +=
            here * 0.5 * (hada_surface_at(&surface, x + l, y, NULL) + hada_surface_at(&surface, x, y + l, NULL));
        slopes += gradient[0] * gradient[0];
    }
    /* about 1600 independent patches: 2.5 % and less of a standard deviation */
    assert_true(fabs(products / squares - exp(-1.0)) < 0.06);
    /* variance of the slope of exp(-r^2 / l^2): 2 / l^2 times the variance */
    assert_true(fabs(slopes / squares - 2.0) < 0.2);
    hada_surface_free(&surface);
}

TEST(diffusers_deflect_as_asked)
{
    hada_camera camera = camera_with(HADA_MASK_DIFFUSER);
    hada_mask_design design;
    camera.deflection_mrad = 7.0;
    ASSERT_OK(hada_mask_make(&design, &camera, err));
    double squares = 0.0;
    enum { N = 400 };
    for (int i = 0; i < N * N; i++) {
        hada_mask_point point;
        hada_mask_at(&design, (i % N - N / 2) * 11.9 / N, (i / N - N / 2) * 11.9 / N, &point);
        squares += 0.5 * (point.slope[0] * point.slope[0] + point.slope[1] * point.slope[1]);
    }
    assert_true(fabs(sqrt(squares / (N * N)) - 7e-3) < 1e-4);
    hada_mask_free(&design);
}

TEST(nearest_sites)
{
    enum { COUNT = 700 };
    double *x = malloc(COUNT * sizeof *x), *y = malloc(COUNT * sizeof *y);
    for (int i = 0; i < COUNT; i++) { /* along a spiral: crowded and empty places */
        x[i] = 4.9 * cos(0.03 * i) * i / COUNT;
        y[i] = 4.9 * sin(0.03 * i) * i / COUNT;
    }
    hada_sites sites;
    ASSERT_OK(hada_sites_make(&sites, x, y, COUNT, 5.0, err));
    for (int k = 0; k < 2000; k++) {
        const double px = -5.0 + 10.0 * ((k * 37) % 2000) / 2000.0, py = -5.0 + 10.0 * ((k * 91) % 2000) / 2000.0;
        double best = HUGE_VAL, square;
        int expected = -1;
        for (int i = 0; i < COUNT; i++) {
            const double away = (px - x[i]) * (px - x[i]) + (py - y[i]) * (py - y[i]);
            if (away < best) {
                best = away;
                expected = i;
            }
        }
        assert_int_equal(hada_sites_nearest(&sites, px, py, &square), expected);
        assert_true(square == best);
    }
    hada_sites_free(&sites);
}

TEST(contours_focus_on_lines)
{
    /* in focus, the light of a contour mask is on the lines: where the landscape is 0, scaled by 1 + d/z */
    hada_camera camera = camera_with(HADA_MASK_CONTOUR);
    const double distance = 1.0 / (1.0 / camera.focal_length_mm - 1.0 / camera.distance_mm);
    const double scale = camera.pixel_pitch_mm / hada_camera_magnification(&camera, distance);
    SCOPED(hada_image) psf;
    hada_surface landscape;
    ASSERT_OK(hada_camera_psf(&camera, distance, 0, 0, &psf, err));
    ASSERT_OK(hada_surface_make(&landscape, camera.seed, camera.correlation_mm, camera.aperture_mm / 2.0, err));
    double all = 0.0, near = 0.0;
    for (int r = 0; r < psf.rows; r++)
        for (int c = 0; c < psf.cols; c++) {
            const double light = psf.data[r * psf.cols + c], x = (c - 200) * scale, y = (r - 150) * scale;
            double gradient[2];
            all += light;
            if (!(light > 0.0) || hypot(x, y) > camera.aperture_mm / 2.0)
                continue;
            const double height = hada_surface_at(&landscape, x, y, gradient);
            if (fabs(height) < 2.0 * scale * hypot(gradient[0], gradient[1]))
                near += light;
        }
    assert_true(fabs(all - 1.0) < 1e-4 && near > 0.93); /* the rest: where lines turn sharply, or end */
    hada_surface_free(&landscape);
}

TEST(holes_cast_shadows)
{
    /* a hole's shadow is as wide as the hole times 1 + d/z, evenly bright, at 1 + d/z times its place */
    hada_camera camera = camera_with(HADA_MASK_APERTURE);
    assert_true(fabs(camera.lens_diameter_mm - sqrt(2.44 * 530e-6 * 30.0)) < 1e-12);
    camera.lenses = 1;
    camera.lens_diameter_mm = 2.0;
    double x, y, squares = 0.0, row = 0.0, col = 0.0;
    ASSERT_OK(hada_camera_lenses(&camera, &x, &y, err));
    SCOPED(hada_image) psf;
    ASSERT_OK(hada_camera_psf(&camera, 60.0, 500, 500, &psf, err));
    for (int r = 0; r < 500; r++)
        for (int c = 0; c < 500; c++) {
            const double light = psf.data[r * 500 + c];
            row += r * light;
            col += c * light;
            squares += (r * r + c * c) * light;
        }
    camera.aperture_mm = 40.0;
    assert_true(fabs(hada_camera_defocus_pixels(&camera, 60.0) - 2.0 * 1.5 / 0.08) < 1e-9);
    const double radius = 1.5 / 0.08; /* disc: mean square R^2 / 2 */
    const double spread = squares - row * row - col * col;
    if (hypot(x, y) + 1.0 <= 6.0) /* the aperture cuts no part of the hole off */
        assert_true(fabs(row - (250 + y * 1.5 / 0.08)) < 0.02 && fabs(spread / (radius * radius / 2.0) - 1.0) < 0.02);
}

TEST(maps)
{
    hada_camera camera = camera_with(HADA_MASK_GRID);
    hada_image thickness, open;
    ASSERT_OK(hada_camera_mask_map(&camera, 301, 301, &thickness, &open, err));
    /* the lens on the axis: r^2 / (2 f (n - 1)) thinner at r, open within its radius */
    const double step = camera.aperture_mm / 301, r = 4.0 * step;
    const double sag = thickness.data[150 * 301 + 150] - thickness.data[150 * 301 + 154];
    assert_true(fabs(sag - r * r / (2.0 * camera.focal_length_mm * (camera.refractive_index - 1.0))) < 1e-6 * sag);
    assert_true(open.data[150 * 301 + 150] == 1.0f && open.data[150 * 301 + 158] == 0.0f && open.data[0] == 0.0f);
    hada_image_destroy(&thickness);
    hada_image_destroy(&open);
    ASSERT_OK(hada_camera_mask_map(&camera, 20, 20, NULL, &open, err));
    hada_image_destroy(&open);
}

TEST(words_and_files)
{
    char path[] = "/tmp/hadalens-mask-XXXXXX";
    const int handle = mkstemp(path);
    assert_true(handle >= 0);
    close(handle);
    for (hada_mask mask = HADA_MASK_MLA; mask <= HADA_MASK_APERTURE; mask++) {
        hada_camera camera = camera_with(mask), back = {.size = sizeof back};
        camera.optics = HADA_OPTICS_WAVE;
        camera.wavelengths_nm[1] = 555.5;
        camera.abbe_number = 0.0;
        camera.cell_mm = mask == HADA_MASK_APERTURE ? 0.25 : 0.0;
        camera.open_fraction = 0.125;
        camera.maximum_spacing_mm = 2.5;
        assert_int_equal((hada_mask)hada_enum_value(HADA_ENUM_MASK, hada_enum_name(HADA_ENUM_MASK, (int)mask)), mask);
        ASSERT_OK(hada_camera_save(&camera, path, err));
        ASSERT_OK(hada_camera_load(&back, path, err));
        assert_true(back.mask == mask && back.optics == HADA_OPTICS_WAVE && back.wavelengths_nm[1] == 555.5);
        assert_true(back.abbe_number == 0.0 && back.cell_mm == camera.cell_mm && back.open_fraction == 0.125);
        assert_true(back.maximum_spacing_mm == 2.5 && fabs(back.correlation_mm - camera.correlation_mm) < 1e-14);
        assert_true(fabs(back.deflection_mrad - camera.deflection_mrad) < 1e-12);
        assert_true(fabs(back.minimum_spacing_mm - camera.minimum_spacing_mm) < 1e-14);
    }
    unlink(path);
    assert_null(hada_enum_name(HADA_ENUM_MASK, 0));
    assert_int_equal(hada_enum_value(HADA_ENUM_MASK, "hole"), -1);
    hada_camera camera = camera_with(HADA_MASK_DIFFUSER);
    assert_int_equal(hada_camera_set_mask(&camera, 9, NULL), HADA_ERROR_UNSUPPORTED);
    assert_int_equal(hada_camera_lenses(&camera, NULL, NULL, NULL), HADA_ERROR_ARGUMENT);
    camera.correlation_mm = 0.001;
    assert_int_equal(hada_camera_check(&camera, NULL), HADA_ERROR_ARGUMENT);
    camera = camera_with(HADA_MASK_APERTURE);
    camera.cell_mm = 0.5;
    camera.open_fraction = 0.0;
    assert_int_equal(hada_camera_check(&camera, NULL), HADA_ERROR_ARGUMENT);
    camera.refractive_index = 1.0;
    assert_int_equal(hada_camera_check(&camera, NULL), HADA_ERROR_ARGUMENT);
}
