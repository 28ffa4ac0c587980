/* What reports say of PSFs whose transforms are known. */
#include "device_fixture.h"

static hada_camera camera_of(int rows, int cols, int depths)
{
    DEFAULTS(hada_camera, camera);
    camera.rows = rows;
    camera.cols = cols;
    camera.channels = 1;
    camera.window_rows = camera.window_cols = 20;
    camera.lenses = 4;
    assert_int_equal(hada_camera_set_depths(&camera, 100.0, 400.0, depths, NULL), HADA_OK);
    return camera;
}

/* Gaussians of standard deviation `sigma`: one, or two of `apart` pixels. */
static hada_image spots(const hada_camera *camera, double sigma, int apart)
{
    hada_image psf;
    ASSERT_OK(hada_image_create(&psf, 1, camera->rows, camera->cols, err));
    for (int r = 0; r < psf.rows; r++)
        for (int c = 0; c < psf.cols; c++) {
            const double y = r - psf.rows / 2, x = c - psf.cols / 2, s = 2.0 * sigma * sigma, n = 3.14159265 * s;
            psf.data[r * psf.cols + c] =
                (float)(apart ? 0.5 * (exp(-(y * y + x * x) / s) + exp(-(y * y + (x - apart) * (x - apart)) / s)) / n
                              : exp(-(y * y + x * x) / s) / n);
        }
    return psf;
}

TEST(gaussians)
{
    const hada_camera camera = camera_of(90, 101, 3);
    SCOPED(hada_optics_report) * report;
    ASSERT_OK(hada_optics_report_create(&report, context, &camera, 0.1, err));
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    const double sigma[] = {1.0, 2.0, 3.0};
    for (int z = 0; z < 3; z++) {
        SCOPED(hada_image) psf = spots(&camera, sigma[z], 0);
        ASSERT_OK(hada_optics_report_add(report, &psf, err));
    }
    for (int z = 0; z < 3; z++) {
        const hada_optics_row *row = hada_optics_report_row(report, z);
        const double s = sigma[z];
        /* MTF exp(-2 pi^2 s^2 f^2); it reaches 0.1 on a disc of radius f0 */
        for (int i = 0; i < curves->frequencies; i += 5) {
            const double f = (i + 0.5) / (2.0 * curves->frequencies),
                         expected = exp(-2.0 * pow(3.14159265 * s * f, 2.0));
            assert_true(fabs(curves->mtf[z * curves->frequencies + i] - expected) < 0.012);
        }
        const double f0 = sqrt(log(10.0) / 2.0) / (3.14159265 * s);
        assert_true(fabs(row->cutoff - f0) < 0.004);
        assert_true(fabs(row->support / (3.14159265 * f0 * f0) - 1.0) < 0.02);
        /* the self-correlation is a Gaussian of sqrt(2) s; its width over sqrt(2) is that of the spot */
        assert_true(fabs(row->spot_pixels / (2.354820045 * s) - 1.0) < 0.02);
        /* the largest of those that round to 4 pixels: from there to 3.5 */
        const double self = curves->self[z * curves->lags + 4] * (1.0 + 1e-4);
        assert_true(self > exp(-16.0 / (4.0 * s * s)) && self < exp(-12.25 / (4.0 * s * s)));
        assert_true(row->sidelobe < 0.01 && fabs(row->light - 1.0) < 1e-4);
        assert_true(fabs(row->lateral_mm - row->spot_pixels * camera.pixel_pitch_mm * row->distance_mm / 30.0) < 1e-12);
        /* <a, b> / |a||b| = 2 s t / (s^2 + t^2) */
        for (int i = 0; i < 3; i++)
            assert_true(fabs(curves->correlation[z * 3 + i] - 2.0 * s * sigma[i] / (s * s + sigma[i] * sigma[i])) <
                        1e-4);
    }
    /* correlations 1, 0.8, 0.6: never one half */
    assert_true(isnan(hada_optics_report_row(report, 0)->axial_mm));
    /* N R M^2 with 4 lenses, 20 x 20 of 90 x 101 */
    assert_true(fabs(hada_optics_report_row(report, 0)->occupancy - 4.0 * 400.0 / 9090.0) < 1e-12);
    assert_true(fabs(hada_optics_report_row(report, 2)->occupancy - 4.0 * 400.0 / 9090.0 / 16.0) < 1e-12);
    assert_true(fabs(hada_optics_report_row(report, 1)->magnification - (1.0 + 30.0 / 160.0)) < 1e-12);
    SCOPED(hada_image) psf = spots(&camera, 1.0, 0);
    assert_int_equal(hada_optics_report_add(report, &psf, NULL), HADA_ERROR_ARGUMENT);
}

TEST(twins)
{
    /* two equal spots `apart`: the self-correlation has side peaks of one half there; and depths are told apart by
     * where the second one stands */
    const hada_camera camera = camera_of(64, 120, 3);
    SCOPED(hada_optics_report) * report;
    ASSERT_OK(hada_optics_report_create(&report, context, &camera, HADA_AUTO, err));
    const hada_optics_curves *curves = hada_optics_report_curves(report);
    assert_true(curves->threshold == 0.05);
    const int apart[] = {20, 21, 30};
    for (int z = 0; z < 3; z++) {
        SCOPED(hada_image) psf = spots(&camera, 1.5, apart[z]);
        ASSERT_OK(hada_optics_report_add(report, &psf, err));
    }
    for (int z = 0; z < 3; z++) {
        assert_true(fabs(hada_optics_report_row(report, z)->sidelobe - 0.5) < 1e-3);
        assert_true(fabs(curves->self[z * curves->lags + apart[z]] - 0.5) < 1e-3);
    }
    /* one spot of two in common, and the other shifted by 1 (exp(-1 / 4 s^2)) or by 10 and 9: 1/2 */
    const double near = 0.5 + 0.5 * exp(-1.0 / 9.0);
    assert_true(fabs(curves->correlation[1] - near) < 1e-3 && fabs(curves->correlation[2] - 0.5) < 1e-3);
    hada_optics_report_destroy(&report);
    /* axial: correlation falls from 1 to 0 between neighbours, so one half is half way in 1/z */
    const hada_camera two = camera_of(64, 120, 2);
    ASSERT_OK(hada_optics_report_create(&report, context, &two, HADA_AUTO, err));
    SCOPED(hada_image) psf = spots(&two, 1.5, 0);
    ASSERT_OK(hada_optics_report_add(report, &psf, err));
    memmove(psf.data + 20 * 120, psf.data, 44 * 120 * sizeof(float));
    memset(psf.data, 0, 20 * 120 * sizeof(float));
    ASSERT_OK(hada_optics_report_add(report, &psf, err));
    assert_true(fabs(hada_optics_report_row(report, 0)->axial_mm - (1.0 / (0.5 / 100.0 + 0.5 / 400.0) - 100.0)) < 1e-3);
    assert_true(fabs(hada_optics_report_row(report, 1)->axial_mm - (400.0 - 1.0 / (0.5 / 100.0 + 0.5 / 400.0))) < 1e-2);
}

TEST(refusals)
{
    const hada_camera camera = camera_of(40, 40, 2);
    SCOPED(hada_optics_report) * report;
    ASSERT_OK(hada_optics_report_create(&report, context, &camera, HADA_AUTO, err));
    SCOPED(hada_image) wrong, dark;
    ASSERT_OK(hada_image_create(&wrong, 1, 41, 40, err));
    ASSERT_OK(hada_image_create(&dark, 1, 40, 40, err));
    assert_int_equal(hada_optics_report_add(report, &wrong, NULL), HADA_ERROR_SIZE);
    assert_int_equal(hada_optics_report_add(report, &dark, NULL), HADA_ERROR_ARGUMENT);
    dark.data[7] = NAN;
    assert_int_equal(hada_optics_report_add(report, &dark, NULL), HADA_ERROR_NOT_FINITE);
    hada_optics_report_destroy(&report);
    hada_camera broken = camera;
    broken.size = 1;
    assert_int_equal(hada_optics_report_create(&report, context, &broken, HADA_AUTO, NULL), HADA_ERROR_ARGUMENT);
}

FIXTURE(open_device, close_device)
