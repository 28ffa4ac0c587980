/* PSFs by wave optics against closed forms: Airy pattern, magnification, defocus, energy, colour; against the Fresnel
 * integral summed in double precision; and against geometry. */
#include "device_fixture.h"
#include "optics/mask.h"
#include "ref/ref_optics.h"

/* One lens of 1 mm, f = 20 mm, the axis in its middle or near it, d = 20 mm: in focus at infinity. Fine pixels. */
static hada_camera one_lens(void)
{
    hada_camera camera = {.size = sizeof camera};
    hada_camera_init(&camera);
    camera.channels = 1;
    camera.rows = 161;
    camera.cols = 150;
    camera.window_rows = camera.window_cols = 16;
    camera.pixel_pitch_mm = 0.002;
    camera.distance_mm = camera.focal_length_mm = 20.0;
    camera.abbe_number = 0.0;
    camera.lenses = 1;
    camera.lens_diameter_mm = 1.0;
    camera.aperture_mm = 1.6;
    camera.minimum_spacing_mm = 1.5; /* leaves the centre 0.05 mm to stray, and the outline whole */
    camera.optics = HADA_OPTICS_WAVE;
    return camera;
}

static hada_image wave_psf(const hada_camera *camera, double distance, int coherent)
{
    SCOPED(hada_wave) * wave;
    hada_image psf;
    DEFAULTS(hada_wave_options, options);
    options.coherent = coherent;
    options.stray = 0.01;
    ASSERT_OK(hada_wave_create(&wave, context, camera, &options, err));
    ASSERT_OK(hada_wave_psf(wave, distance, camera->rows, camera->cols, &psf, err));
    return psf;
}

/* Where light of a circle about (x, y) adds up to: its share of all. */
static double encircled(const hada_image *psf, double row, double col, double radius)
{
    double sum = 0.0;
    for (int r = 0; r < psf->rows; r++)
        for (int c = 0; c < psf->cols; c++) {
            const double away = hypot(r - row, c - col);
            sum += psf->data[(size_t)r * (size_t)psf->cols + (size_t)c] * hada_mask_open(radius - away, 1.0);
        }
    return sum;
}

TEST(airy)
{
    const hada_camera camera = one_lens();
    double x, y;
    ASSERT_OK(hada_camera_lenses(&camera, &x, &y, err));
    const double row = 80 + y / camera.pixel_pitch_mm, col = 75 + x / camera.pixel_pitch_mm;
    /* the first zero of the Airy pattern: 1.2197 lambda d / D, in pixels: 6.46 */
    const double scale = 530e-6 * 20.0 / 1.0 / camera.pixel_pitch_mm, zero = 1.21967 * scale;
    for (int coherent = 0; coherent < 2; coherent++) {
        SCOPED(hada_image) psf = wave_psf(&camera, 1e9, coherent);
        /* shares of light inside the first three zeros: 1 - J0^2 - J1^2 = 83.78 %, 90.99 %, 93.78 % */
        assert_true(fabs(encircled(&psf, row, col, zero) - 0.8378) < 0.004);
        assert_true(fabs(encircled(&psf, row, col, 2.23313 * scale) - 0.9099) < 0.004);
        assert_true(fabs(encircled(&psf, row, col, 3.23832 * scale) - 0.9378) < 0.004);
        /* the peak: pi/4 D^2 / (lambda d)^2 a unit of area, the mean over a pixel a little less */
        const double peak = 3.14159265 / 4.0 / (scale * scale);
        double most = 0.0, least = 1.0;
        for (int r = 0; r < psf.rows; r++)
            for (int c = 0; c < psf.cols; c++) {
                const double value = psf.data[r * psf.cols + c], away = hypot(r - row, c - col);
                most = fmax(most, value);
                /* dark at the zero: pixels on it hold less than a hundredth of the peak, the ring beyond it up to
                 * 1.75 % */
                if (fabs(away - zero) < 0.4)
                    assert_true(value < 0.01 * peak);
                if (fabs(away - 1.635 * scale) < 0.4) /* the first ring: 0.0175 */
                    least = fmin(least, value);
            }
        assert_true(most < 1.001 * peak && most > 0.93 * peak);
        assert_true(least > 0.0125 * peak && least < 0.0185 * peak);
    }
}

TEST(integral)
{
    /* pixels here and there, in and out of focus, by the sum of the Fresnel integral */
    const hada_camera camera = one_lens();
    enum { N = 180 };
    const double step = 1.02 / N, lambda = 530e-6, distances[] = {1e9, 400.0};
    double x, y, *field = calloc(2 * N * N, sizeof *field), all = 0.0;
    ASSERT_OK(hada_camera_lenses(&camera, &x, &y, err));
    for (int r = 0; r < N; r++)
        for (int c = 0; c < N; c++) {
            const double u = (c - 0.5 * (N - 1)) * step, v = (r - 0.5 * (N - 1)) * step, square = u * u + v * v;
            const double open = hada_mask_open(0.5 - sqrt(square), step);
            const double angle = -3.14159265358979 * square / (lambda * camera.focal_length_mm);
            field[2 * (r * N + c)] = open * cos(angle);
            field[2 * (r * N + c) + 1] = open * sin(angle);
            all += open * step * step;
        }
    for (int i = 0; i < 2; i++) {
        const double m = hada_camera_magnification(&camera, distances[i]), pitch = camera.pixel_pitch_mm;
        const int row = (int)lrint(80 + y * m / pitch), col = (int)lrint(75 + x * m / pitch);
        const int off[][2] = {{0, 0}, {2, 1}, {-4, 3}, {0, 7}, {9, -9}, {-14, 2}, {3, 15}};
        SCOPED(hada_image) by_lens = wave_psf(&camera, distances[i], 0), whole = wave_psf(&camera, distances[i], 1);
        const double peak = by_lens.data[row * camera.cols + col];
        for (size_t k = 0; k < sizeof off / sizeof *off; k++) {
            const int r = row + off[k][0], c = col + off[k][1];
            const double expected = hada_ref_wave_pixel(field, N, step, x, y, lambda, distances[i], 20.0,
                                                        (c - 75) * pitch, (r - 80) * pitch, pitch, 3) /
                                    all;
            assert_true(fabs(by_lens.data[r * camera.cols + c] - expected) < 0.004 * peak);
            assert_true(fabs(whole.data[r * camera.cols + c] - expected) < 0.02 * peak);
        }
    }
    free(field);
}

TEST(defocus_and_magnification)
{
    hada_camera camera = one_lens();
    camera.pixel_pitch_mm = 0.008;
    double x, y;
    ASSERT_OK(hada_camera_lenses(&camera, &x, &y, err));
    for (int coherent = 0; coherent < 2; coherent++) {
        const double distance = 50.0, m = 1.4; /* blur: 1 mm * 0.4 = 50 pixels */
        SCOPED(hada_image) psf = wave_psf(&camera, distance, coherent);
        double sum = 0.0, row = 0.0, col = 0.0, squares = 0.0;
        for (int r = 0; r < psf.rows; r++)
            for (int c = 0; c < psf.cols; c++) {
                const double value = psf.data[r * psf.cols + c];
                if (hypot(r - 80, c - 75) > 45.0)
                    continue;
                sum += value;
                row += r * value;
                col += c * value;
                squares += (r * r + c * c) * value;
            }
        row /= sum;
        col /= sum;
        assert_true(sum > 0.98 && sum < 1.0); /* 1 % may go astray, by the options, and some leaves the circle */
        assert_true(fabs(row - (80 + y * m / 0.008)) < 0.05);
        assert_true(fabs(col - (75 + x * m / 0.008)) < 0.05);
        /* an even disc of radius R has a mean square of R^2 / 2; diffraction adds little within 45 pixels */
        const double radius = hada_camera_defocus_pixels(&camera, distance) / 2.0;
        assert_true(fabs(radius - 25.0) < 1e-9);
        assert_true(fabs(sqrt(2.0 * (squares / sum - row * row - col * col)) - radius) < 0.5);
    }
}

TEST(colours_focus_apart)
{
    hada_camera camera = one_lens();
    camera.channels = 3;
    camera.abbe_number = 30.0;
    camera.lens_diameter_mm = 1.4;
    const double f[3] = {hada_camera_focal_length(&camera, 610.0), hada_camera_focal_length(&camera, 530.0),
                         hada_camera_focal_length(&camera, 460.0)};
    assert_true(f[0] > f[1] && f[1] > f[2]);
    assert_true(fabs(hada_camera_focal_length(&camera, 587.5618) - camera.focal_length_mm) < 1e-9);
    /* V = (n_d - 1) / (n_F - n_C) */
    const double spread =
        hada_camera_refractive_index(&camera, 486.1327) - hada_camera_refractive_index(&camera, 656.2725);
    assert_true(fabs((camera.refractive_index - 1.0) / spread - 30.0) < 1e-9);
    /* each colour is sharpest where its own focal length says */
    camera.distance_mm = f[0];
    double share[2][3];
    for (int i = 0; i < 2; i++) {
        camera.distance_mm = i ? f[2] : f[0];
        SCOPED(hada_image) psf = wave_psf(&camera, 1e9, 0);
        for (int c = 0; c < 3; c++) {
            share[i][c] = 0.0;
            for (int k = 0; k < psf.rows * psf.cols; k++)
                share[i][c] = fmax(share[i][c], psf.data[c * psf.rows * psf.cols + k]);
        }
    }
    assert_true(share[0][0] > 1.5 * share[1][0]);
    assert_true(share[1][2] > 1.5 * share[0][2]);
}

static hada_camera small(hada_mask mask)
{
    hada_camera camera = {.size = sizeof camera};
    assert_int_equal(hada_camera_preset(&camera, "sim300", NULL), HADA_OK);
    assert_int_equal(hada_camera_resize(&camera, 180, 190, 0, 0, NULL), HADA_OK);
    camera.channels = 1;
    camera.optics = HADA_OPTICS_WAVE;
    camera.aperture_mm = 6.0;
    camera.lenses = 7;
    camera.minimum_spacing_mm = 0.9;
    assert_int_equal(hada_camera_set_mask(&camera, mask, NULL), HADA_OK);
    return camera;
}

static double total(const hada_image *psf)
{
    double sum = 0.0;
    for (size_t i = 0; i < hada_image_count(psf); i++) {
        assert_true(psf->data[i] >= 0.0f);
        sum += psf->data[i];
    }
    return sum;
}

/* Correlation of two PSFs after means over 5 x 5 pixels, which fringes do not survive. */
static double alike(const hada_image *a, const hada_image *b)
{
    double ab = 0.0, aa = 0.0, bb = 0.0;
    for (int r = 0; r + 5 <= a->rows; r += 5)
        for (int c = 0; c + 5 <= a->cols; c += 5) {
            double x = 0.0, y = 0.0;
            for (int i = 0; i < 25; i++) {
                const int at = (r + i / 5) * a->cols + c + i % 5;
                x += a->data[at];
                y += b->data[at];
            }
            ab += x * y;
            aa += x * x;
            bb += y * y;
        }
    return ab / sqrt(aa * bb);
}

TEST(every_mask)
{
    const hada_mask masks[] = {HADA_MASK_MLA, HADA_MASK_GRID, HADA_MASK_DIFFUSER, HADA_MASK_CONTOUR,
                               HADA_MASK_APERTURE};
    for (size_t i = 0; i < 5; i++) {
        const hada_camera camera = small(masks[i]);
        SCOPED(hada_image) rays, psf = wave_psf(&camera, 200.0, 0);
        assert_int_equal(hada_camera_psf(&camera, 200.0, 0, 0, &rays, NULL), HADA_OK);
        /* light is kept, but for what edges scatter: the more, the smaller what is between them */
        assert_true(total(&psf) < 1.0 + 1e-4 && total(&psf) > (masks[i] == HADA_MASK_APERTURE ? 0.94 : 0.98));
        const double same = alike(&psf, &rays);
        assert_true(same > 0.9);
    }
    hada_camera cells = small(HADA_MASK_APERTURE);
    cells.cell_mm = 0.5;
    SCOPED(hada_image) rays, psf = wave_psf(&cells, 200.0, 0);
    assert_int_equal(hada_camera_psf(&cells, 200.0, 0, 0, &rays, NULL), HADA_OK);
    assert_true(total(&psf) > 0.96 && alike(&psf, &rays) > 0.97);
}

TEST(lenses_add_up)
{
    /* lenses apart: intensities add up, since pixels average the fringes between spots */
    const hada_camera camera = small(HADA_MASK_MLA);
    SCOPED(hada_image)
    one = wave_psf(&camera, 150.0, 0), all = wave_psf(&camera, 150.0, 1), again = wave_psf(&camera, 150.0, 0);
    double difference = 0.0, norm = 0.0;
    for (size_t i = 0; i < hada_image_count(&one); i++) {
        difference += pow(one.data[i] - all.data[i], 2.0);
        norm += pow(all.data[i], 2.0);
    }
    assert_true(difference < 0.05 * 0.05 * norm);
    assert_memory_equal(one.data, again.data, hada_image_count(&one) * sizeof(float));
}

TEST(frames)
{
    /* the simulator takes the PSFs of the camera's optics: a point in the middle shows the PSF */
    hada_camera camera = small(HADA_MASK_MLA);
    hada_image stack[HADA_CAMERA_DEPTHS], point, frame;
    hada_simulator *simulator;
    camera.channels = 3;
    ASSERT_OK(hada_camera_set_depths(&camera, 100.0, 200.0, 2, err));
    ASSERT_OK(hada_camera_psf_stack(context, &camera, stack, err));
    assert_int_equal(stack[0].channels, 3);
    ASSERT_OK(hada_simulator_create(&simulator, context, &camera, NULL, err));
    ASSERT_OK(hada_image_create(&point, 1, camera.window_rows, camera.window_cols, err));
    const int row = camera.rows / 2 - hada_window_origin(camera.rows, camera.window_rows),
              col = camera.cols / 2 - hada_window_origin(camera.cols, camera.window_cols);
    point.data[row * point.cols + col] = 1.0f;
    const hada_plane plane = {1, &point};
    ASSERT_OK(hada_simulator_render(simulator, &plane, 1, 0.0, 0, &frame, err));
    double worst = 0.0, most = 0.0;
    for (size_t i = 0; i < hada_image_count(&frame); i++) {
        worst = fmax(worst, fabs((double)frame.data[i] - stack[1].data[i]));
        most = fmax(most, stack[1].data[i]);
    }
    assert_true(worst < 1e-5 * most);
    hada_simulator_destroy(&simulator);
    hada_image_destroy(&point);
    hada_image_destroy(&frame);
    hada_image_destroy(&stack[0]);
    hada_image_destroy(&stack[1]);
    assert_int_equal(hada_camera_psf_stack(NULL, &camera, stack, NULL), HADA_ERROR_ARGUMENT);
    camera.optics = HADA_OPTICS_GEOMETRY;
    ASSERT_OK(hada_camera_psf_stack(NULL, &camera, stack, err));
    assert_int_equal(stack[1].channels, 1);
    hada_image_destroy(&stack[0]);
    hada_image_destroy(&stack[1]);
}

TEST(refusals)
{
    SCOPED(hada_wave) * wave;
    hada_image psf;
    hada_wave_options options = {0};
    hada_camera camera = small(HADA_MASK_DIFFUSER);
    ASSERT_FAILS(hada_wave_create(&wave, context, &camera, &options, err), HADA_ERROR_ARGUMENT, "");
    assert_null(wave);
    hada_wave_options_init(&options);
    options.stray = 0.9;
    ASSERT_FAILS(hada_wave_create(&wave, context, &camera, &options, err), HADA_ERROR_ARGUMENT, "");
    /* too steep for any memory */
    camera.deflection_mrad = 200.0;
    camera.aperture_mm = 60.0;
    camera.correlation_mm = 3.0;
    ASSERT_OK(hada_wave_create(&wave, context, &camera, NULL, err));
    ASSERT_FAILS(hada_wave_psf(wave, 100.0, 10, 10, &psf, err), HADA_ERROR_UNSUPPORTED, "samples");
    assert_null(psf.data);
    ASSERT_FAILS(hada_wave_psf(wave, 0.0, 10, 10, &psf, err), HADA_ERROR_ARGUMENT, "");
    hada_wave_destroy(&wave);
    /* a spot as large as the lens */
    camera = one_lens();
    camera.lens_diameter_mm = camera.aperture_mm = 40.0;
    camera.minimum_spacing_mm = 0.0;
    ASSERT_OK(hada_wave_create(&wave, context, &camera, NULL, err));
    ASSERT_FAILS(hada_wave_psf(wave, 10.0, 10, 10, &psf, err), HADA_ERROR_UNSUPPORTED, "");
}

FIXTURE(open_device, close_device)
