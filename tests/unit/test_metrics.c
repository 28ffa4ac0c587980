/* Metrics against scikit-image (golden numbers made by tests/golden/make_metrics_golden.py) and by hand. */
#include "testing.h"

/* The same formulas as in the script: exact in float32. */
static float value_a(int c, int r, int k)
{
    return (float)((r * 37 + k * 91 + c * 53 + (r * k) % 17 * 5) % 256) / 256.0f;
}

static float value_b(int c, int r, int k)
{
    return (float)(0.75 * value_a(c, r, k) + ((r * 13 + k * 7 + c * 29) % 64) / 512.0);
}

static hada_image fill(int channels, int rows, int cols, float (*value)(int, int, int))
{
    hada_image image;
    assert_int_equal(hada_image_create(&image, channels, rows, cols, NULL), HADA_OK);
    for (int c = 0; c < channels; c++)
        for (int r = 0; r < rows; r++)
            for (int k = 0; k < cols; k++)
                image.data[((size_t)c * (size_t)rows + (size_t)r) * (size_t)cols + (size_t)k] = value(c, r, k);
    return image;
}

static void close_to(double value, double expected, double tolerance)
{
    if (value != expected && !(fabs(value - expected) <= tolerance))
        fail_msg("%.12g is not within %g of %.12g", value, tolerance, expected);
}

TEST(golden)
{
    FILE *file = fopen(HADALENS_SOURCE_DIR "/tests/golden/metrics.txt", "r");
    assert_non_null(file);
    char line[256];
    int cases = 0;
    while (fgets(line, sizeof line, file)) {
        int channels, rows, cols;
        double mse, mae, psnr, ssim, sharpness, authors_psnr, authors_ssim, value;
        if (line[0] == '#')
            continue;
        assert_int_equal(sscanf(line, "%d %d %d %lf %lf %lf %lf %lf %lf %lf", &channels, &rows, &cols, &mse, &mae,
                                &psnr, &ssim, &sharpness, &authors_psnr, &authors_ssim),
                         10);
        SCOPED(hada_image) a = fill(channels, rows, cols, value_a), b = fill(channels, rows, cols, value_b);
        assert_int_equal(hada_metric_compare(HADA_METRIC_MSE, &a, &b, 1.0, NULL, &value, NULL), HADA_OK);
        close_to(value, mse, 1e-9);
        assert_int_equal(hada_metric_compare(HADA_METRIC_MAE, &a, &b, 1.0, NULL, &value, NULL), HADA_OK);
        close_to(value, mae, 1e-9);
        assert_int_equal(hada_metric_compare(HADA_METRIC_PSNR, &a, &b, 1.0, NULL, &value, NULL), HADA_OK);
        close_to(value, psnr, 1e-6);
        assert_int_equal(hada_metric_compare(HADA_METRIC_SSIM, &a, &b, 1.0, NULL, &value, NULL), HADA_OK);
        close_to(value, ssim, 1e-6);
        assert_int_equal(hada_metric_sharpness(&a, NULL, &value, NULL), HADA_OK);
        close_to(value, sharpness, 1e-7);
        assert_int_equal(hada_metric_compare(HADA_METRIC_AUTHORS_PSNR, &a, &b, 1.0, NULL, &value, NULL), HADA_OK);
        close_to(value, authors_psnr, 1e-6);
        assert_int_equal(hada_metric_compare(HADA_METRIC_AUTHORS_SSIM, &a, &b, 1.0, NULL, &value, NULL), HADA_OK);
        close_to(value, authors_ssim, 1e-6);
        cases++;
    }
    fclose(file);
    assert_true(cases >= 4);
}

TEST(masks)
{
    SCOPED(hada_image) a = fill(1, 16, 16, value_a), b = fill(1, 16, 16, value_a);
    unsigned char mask[256];
    memset(mask, 1, sizeof mask);
    double value;
    b.data[3] += 0.5f;
    assert_int_equal(hada_metric_compare(HADA_METRIC_MSE, &a, &b, 1.0, mask, &value, NULL), HADA_OK);
    close_to(value, 0.25 / 256.0, 1e-9);
    mask[3] = 0;
    assert_int_equal(hada_metric_compare(HADA_METRIC_MSE, &a, &b, 1.0, mask, &value, NULL), HADA_OK);
    assert_true(value == 0.0);
    assert_int_equal(hada_metric_compare(HADA_METRIC_PSNR, &a, &b, 1.0, mask, &value, NULL), HADA_OK);
    assert_true(isinf(value));
    assert_int_equal(hada_metric_compare(HADA_METRIC_SSIM, &a, &a, 1.0, mask, &value, NULL), HADA_OK);
    close_to(value, 1.0, 1e-12);
    memset(mask, 0, sizeof mask);
    hada_error err;
    assert_int_equal(hada_metric_compare(HADA_METRIC_MAE, &a, &b, 1.0, mask, &value, &err), HADA_ERROR_ARGUMENT);
    assert_int_equal(hada_metric_compare(HADA_METRIC_SSIM, &a, &b, 1.0, mask, &value, &err), HADA_ERROR_ARGUMENT);
    assert_int_equal(hada_metric_sharpness(&a, mask, &value, &err), HADA_ERROR_ARGUMENT);
}

/* By hand: the mean of two pixels' PSNR, one channel off by 0.1 and by 0.01; an exact pixel makes it infinite. */
TEST(authors)
{
    SCOPED(hada_image) a, b;
    unsigned char mask[3] = {1, 1, 0};
    double value;
    assert_int_equal(hada_image_create(&a, 1, 1, 3, NULL), HADA_OK);
    assert_int_equal(hada_image_create(&b, 1, 1, 3, NULL), HADA_OK);
    b.data[0] = 0.1f;
    b.data[1] = 0.01f;
    assert_int_equal(hada_metric_compare(HADA_METRIC_AUTHORS_PSNR, &a, &b, 1.0, mask, &value, NULL), HADA_OK);
    close_to(value, 30.0 * log(10.0) / 2.303, 1e-5);
    assert_int_equal(hada_metric_compare(HADA_METRIC_AUTHORS_PSNR, &a, &b, 1.0, NULL, &value, NULL), HADA_OK);
    assert_true(isinf(value));
    memset(mask, 0, sizeof mask);
    ASSERT_FAILS(hada_metric_compare(HADA_METRIC_AUTHORS_PSNR, &a, &b, 1.0, mask, &value, err), HADA_ERROR_ARGUMENT,
                 "");
    ASSERT_FAILS(hada_metric_compare(HADA_METRIC_AUTHORS_PSNR, &a, &b, -1.0, NULL, &value, err), HADA_ERROR_ARGUMENT,
                 "");
}

TEST(refusals)
{
    SCOPED(hada_image)
    a = fill(1, 12, 12, value_a), b = fill(1, 12, 13, value_a), c = fill(1, 12, 12, value_b),
    small = fill(1, 10, 12, value_a);
    double value;
    ASSERT_FAILS(hada_metric_compare(HADA_METRIC_MSE, &a, &b, 1.0, NULL, &value, err), HADA_ERROR_SIZE, "12 x 13");
    c.data[7] = NAN;
    ASSERT_FAILS(hada_metric_compare(HADA_METRIC_PSNR, &a, &c, 1.0, NULL, &value, err), HADA_ERROR_NOT_FINITE, "");
    ASSERT_FAILS(hada_metric_compare(HADA_METRIC_PSNR, &a, &a, 0.0, NULL, &value, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_metric_compare(HADA_METRIC_SSIM, &a, &a, INFINITY, NULL, &value, err), HADA_ERROR_ARGUMENT,
                 "inf");
    ASSERT_FAILS(hada_metric_compare(HADA_METRIC_SSIM, &small, &small, 1.0, NULL, &value, err), HADA_ERROR_SIZE, "");
}

TEST(depth_index)
{
    const double list[] = {100.0, 150.0, 300.0};
    for (int i = 0; i < 3; i++)
        close_to(hada_depth_index(list, 3, list[i]), i, 1e-12);
    close_to(hada_depth_index(list, 3, 120.0), 0.5, 1e-12); /* 1/120 is the middle of 1/100 and 1/150 */
    close_to(hada_depth_index(list, 3, 200.0), 1.5, 1e-12);
    close_to(hada_depth_index(list, 3, 600.0), 2.5, 1e-12); /* beyond the end, the same slope */
    for (double i = -0.5; i < 2.9; i += 0.25)
        close_to(hada_depth_index(list, 3, hada_depth_distance(list, 3, i)), i, 1e-12);
    close_to(hada_depth_distance(list, 1, 4.0), 100.0, 0.0);
}

TEST(depth_score)
{
    const double list[] = {100.0, 150.0, 300.0};
    const float truth[] = {100, 100, 150, 150, 300, NAN, 300, 100}, map[] = {100, 119, 150, 210, 300, 100, NAN, 150};
    unsigned char mask[8] = {1, 1, 1, 1, 1, 1, 1, 1};
    hada_image a = {1, 2, 4, (float *)(uintptr_t)map}, b = {1, 2, 4, (float *)(uintptr_t)truth};
    hada_depth_score score = {.size = sizeof score};
    assert_int_equal(hada_metric_depth(&a, &b, list, 3, 0.5, mask, &score, NULL), HADA_OK);
    assert_int_equal(score.pixels, 7);
    close_to(score.coverage, 6.0 / 7.0, 1e-12);
    close_to(score.within, 4.0 / 6.0, 1e-12); /* 119 is within half a step, 210 and 150 for 100 are not */
    close_to(score.mean_error_mm, (0 + 19 + 0 + 60 + 0 + 50) / 6.0, 1e-9);
    assert_int_equal(hada_metric_depth(&a, &b, NULL, 0, 20.0, mask, &score, NULL), HADA_OK);
    close_to(score.within, 4.0 / 6.0, 1e-12);
    mask[3] = mask[7] = 0;
    assert_int_equal(hada_metric_depth(&a, &b, list, 3, 0.5, mask, &score, NULL), HADA_OK);
    close_to(score.within, 1.0, 0.0);
    memset(mask, 0, sizeof mask);
    assert_int_equal(hada_metric_depth(&a, &b, list, 3, 0.5, mask, &score, NULL), HADA_ERROR_ARGUMENT);
    assert_int_equal(hada_metric_depth(&a, &b, list, 1, 0.5, NULL, &score, NULL), HADA_ERROR_ARGUMENT);
}
