/* Yardsticks of two images of one size, on the host in double precision. */
#include <hadalens/metrics.h>
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"

static hada_status check_pair(const hada_image *a, const hada_image *b, hada_error *err)
{
    if (!a->data || !b->data)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "an image to compare is empty");
    if (a->channels != b->channels || a->rows != b->rows || a->cols != b->cols)
        return hada_fail(
            err, HADA_ERROR_SIZE,
            "images of %d channels, %d x %d and %d channels, %d x %d cannot be compared; crop or resize one",
            a->channels, a->rows, a->cols, b->channels, b->rows, b->cols);
    const size_t bad = hada_image_count_not_finite(a) + hada_image_count_not_finite(b);
    if (bad)
        return hada_fail(err, HADA_ERROR_NOT_FINITE, "the images to compare hold %zu NaN or infinite values", bad);
    return HADA_OK;
}

/* Mean over the masked pixels of |a - b|^power (1 or 2). */
static hada_status mean_difference(const hada_image *a, const hada_image *b, const unsigned char *mask, int power,
                                   double *out, hada_error *err)
{
    hada_status status = check_pair(a, b, err);
    if (status)
        return status;
    const size_t pixels = (size_t)a->rows * (size_t)a->cols;
    double sum = 0.0;
    size_t used = 0;
    for (int c = 0; c < a->channels; c++)
        for (size_t i = 0; i < pixels; i++) {
            if (mask && !mask[i])
                continue;
            const double d = fabs((double)a->data[(size_t)c * pixels + i] - b->data[(size_t)c * pixels + i]);
            sum += power == 2 ? d * d : d;
            used++;
        }
    if (!used)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the mask leaves no pixel to compare");
    *out = sum / (double)used;
    return HADA_OK;
}

hada_status hada_metric_mse(const hada_image *a, const hada_image *b, const unsigned char *mask, double *out,
                            hada_error *err)
{
    return mean_difference(a, b, mask, 2, out, err);
}

hada_status hada_metric_mae(const hada_image *a, const hada_image *b, const unsigned char *mask, double *out,
                            hada_error *err)
{
    return mean_difference(a, b, mask, 1, out, err);
}

hada_status hada_metric_psnr(const hada_image *a, const hada_image *b, double peak, const unsigned char *mask,
                             double *out, hada_error *err)
{
    if (!(peak > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a peak of %g is not possible; it must be above 0", peak);
    double mse = 0.0;
    hada_status status = mean_difference(a, b, mask, 2, &mse, err);
    if (status)
        return status;
    *out = mse > 0.0 ? 10.0 * log10(peak * peak / mse) : INFINITY;
    return HADA_OK;
}

/* Structural similarity (Wang et al. 2004). The Gaussian is cut at 3.5 standard deviations, rounded: 11 x 11. */
#define RADIUS    5
#define DEVIATION 1.5
#define K1        0.01
#define K2        0.03

static void gaussian(double *weight)
{
    double sum = 0.0;
    for (int i = -RADIUS; i <= RADIUS; i++)
        sum += weight[i + RADIUS] = exp(-0.5 * i * i / (DEVIATION * DEVIATION));
    for (int i = 0; i <= 2 * RADIUS; i++)
        weight[i] /= sum;
}

/* The five local means of a column of the window: of x, y, x^2, y^2 and x y. */
enum { MEAN_X, MEAN_Y, MEAN_XX, MEAN_YY, MEAN_XY, MEANS };

/* Sums down the window's columns for output row r, over all columns. */
static void column_means(const float *x, const float *y, int cols, int r, const double *weight, double *means)
{
    for (int k = 0; k < cols; k++) {
        double m[MEANS] = {0};
        for (int i = 0; i <= 2 * RADIUS; i++) {
            const size_t at = (size_t)(r - RADIUS + i) * (size_t)cols + (size_t)k;
            const double a = x[at], b = y[at], w = weight[i];
            m[MEAN_X] += w * a;
            m[MEAN_Y] += w * b;
            m[MEAN_XX] += w * a * a;
            m[MEAN_YY] += w * b * b;
            m[MEAN_XY] += w * a * b;
        }
        for (int q = 0; q < MEANS; q++)
            means[(size_t)k * MEANS + (size_t)q] = m[q];
    }
}

static double similarity(const double *m, double c1, double c2)
{
    const double xx = m[MEAN_X] * m[MEAN_X], yy = m[MEAN_Y] * m[MEAN_Y], xy = m[MEAN_X] * m[MEAN_Y];
    const double vx = m[MEAN_XX] - xx, vy = m[MEAN_YY] - yy, vxy = m[MEAN_XY] - xy;
    return (2.0 * xy + c1) * (2.0 * vxy + c2) / ((xx + yy + c1) * (vx + vy + c2));
}

hada_status hada_metric_ssim(const hada_image *a, const hada_image *b, double peak, const unsigned char *mask,
                             double *out, hada_error *err)
{
    hada_status status = check_pair(a, b, err);
    if (status)
        return status;
    if (!(peak > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a peak of %g is not possible; it must be above 0", peak);
    const int rows = a->rows, cols = a->cols;
    if (rows < 2 * RADIUS + 1 || cols < 2 * RADIUS + 1)
        return hada_fail(err, HADA_ERROR_SIZE, "structural similarity needs images of at least 11 x 11, not %d x %d",
                         rows, cols);
    double *means = NULL, weight[2 * RADIUS + 1], sum = 0.0;
    status = hada_alloc((void **)&means, (size_t)cols * MEANS, sizeof *means, "structural similarity", err);
    if (status)
        return status;
    gaussian(weight);
    size_t used = 0;
    const double c1 = K1 * peak * K1 * peak, c2 = K2 * peak * K2 * peak;
    for (int c = 0; c < a->channels; c++) {
        const size_t plane = (size_t)c * (size_t)rows * (size_t)cols;
        for (int r = RADIUS; r < rows - RADIUS; r++) {
            column_means(a->data + plane, b->data + plane, cols, r, weight, means);
            for (int k = RADIUS; k < cols - RADIUS; k++) {
                if (mask && !mask[(size_t)r * (size_t)cols + (size_t)k])
                    continue;
                double m[MEANS] = {0};
                for (int i = 0; i <= 2 * RADIUS; i++)
                    for (int q = 0; q < MEANS; q++)
                        m[q] += weight[i] * means[(size_t)(k - RADIUS + i) * MEANS + (size_t)q];
                sum += similarity(m, c1, c2);
                used++;
            }
        }
    }
    free(means);
    if (!used)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the mask leaves no pixel to compare");
    *out = sum / (double)used;
    return HADA_OK;
}

/* As the code of Tian and Yang 2022 computes them. */
hada_status hada_metric_authors_psnr(const hada_image *a, const hada_image *b, double peak, const unsigned char *mask,
                                     double *out, hada_error *err)
{
    const double ln_ten = 2.303; /* as their code has it */
    double psnr;
    hada_status status = hada_metric_psnr(a, b, peak, mask, &psnr, err); /* the checks of a pair */
    if (status)
        return status;
    const size_t pixels = (size_t)a->rows * (size_t)a->cols;
    double sum = 0.0;
    size_t used = 0;
    for (size_t i = 0; i < pixels; i++) {
        if (mask && !mask[i])
            continue;
        double error = 0.0;
        for (int c = 0; c < a->channels; c++) {
            const double d = (double)a->data[(size_t)c * pixels + i] - b->data[(size_t)c * pixels + i];
            error += d * d;
        }
        sum += error > 0.0 ? 10.0 * log(peak * peak * a->channels / error) / ln_ten : INFINITY;
        used++;
    }
    *out = sum / (double)used;
    return HADA_OK;
}

hada_status hada_metric_authors_ssim(const hada_image *a, const hada_image *b, double peak, const unsigned char *mask,
                                     double *out, hada_error *err)
{
    return hada_metric_ssim(a, b, 2.0 * peak, mask, out, err);
}

hada_status hada_metric_sharpness(const hada_image *image, const unsigned char *mask, double *out, hada_error *err)
{
    hada_status status = check_pair(image, image, err);
    if (status)
        return status;
    const int rows = image->rows, cols = image->cols;
    double sum = 0.0;
    size_t used = 0;
    for (int c = 0; c < image->channels; c++) {
        const float *x = image->data + (size_t)c * (size_t)rows * (size_t)cols;
        for (int r = 0; r < rows; r++)
            for (int k = 0; k < cols; k++) {
                const size_t i = (size_t)r * (size_t)cols + (size_t)k;
                if (mask && !mask[i])
                    continue;
                const int up = r > 0, down = r + 1 < rows, left = k > 0, right = k + 1 < cols;
                const double dy = up + down ? ((double)x[i + (size_t)(down * cols)] - x[i - (size_t)(up * cols)]) /
                                                  (up + down)
                                            : 0.0,
                             dx = left + right ? ((double)x[i + (size_t)right] - x[i - (size_t)left]) / (left + right)
                                               : 0.0;
                sum += sqrt(dx * dx + dy * dy);
                used++;
            }
    }
    if (!used)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the mask leaves no pixel to measure");
    *out = sum / (double)used;
    return HADA_OK;
}
