#include <hadalens/metrics.h>
#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"

#define RADIUS 5 /* the Gaussian is cut at 3.5 standard deviations, rounded: 11 x 11 */

static void gaussian(double *weight)
{
    double sum = 0.0;
    for (int i = -RADIUS; i <= RADIUS; i++)
        sum += weight[i + RADIUS] = exp(-0.5 * i * i / (1.5 * 1.5));
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
    double equal = 0.0;
    hada_status status = hada_metric_mse(a, b, NULL, &equal, err); /* the checks of a pair */
    if (status)
        return status;
    if (!(peak > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a peak of %g is not possible; it must be above 0", peak);
    const int rows = a->rows, cols = a->cols;
    if (rows < 2 * RADIUS + 1 || cols < 2 * RADIUS + 1)
        return hada_fail(err, HADA_ERROR_SIZE, "structural similarity needs images of at least 11 x 11, not %d x %d",
                         rows, cols);
    void *memory;
    if ((status = hada_alloc(&memory, (size_t)cols * MEANS, sizeof(double), "structural similarity", err)))
        return status;
    double *means = memory, weight[2 * RADIUS + 1], sum = 0.0;
    gaussian(weight);
    size_t used = 0;
    const double c1 = 0.01 * peak * 0.01 * peak, c2 = 0.03 * peak * 0.03 * peak;
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
    free(memory);
    if (!used)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the mask leaves no pixel to compare");
    *out = sum / (double)used;
    return HADA_OK;
}
