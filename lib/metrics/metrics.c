/* Measures of two images of one size, on the host in double precision. Structural similarity (Wang et al. 2004): the
 * Gaussian is cut at 3.5 standard deviations, rounded: 11 x 11. */
#include "metrics/metrics.h"

#include <hadalens/metrics.h>

#include "core/callers.h"

enum { RADIUS = 5, TAPS = 2 * RADIUS + 1 };
#define DEVIATION 1.5
#define K1        0.01
#define K2        0.03

/* The local means: of x, y, x^2, y^2 and x y. */
enum { MEAN_X, MEAN_Y, MEAN_XX, MEAN_YY, MEAN_XY, MEANS };

/* Pixels that are computed together, which compilers make vectors of; at most the least number of columns. */
enum { LANES = 4 };

/* That two images can be compared: of one shape, and finite. */
static hada_status images_check_pair(const hada_image *a, const hada_image *b, hada_error *err)
{
    HADA_TRY(hada_image_check(a, NULL, "a comparison", "one of its images", err));
    HADA_TRY(hada_image_check(b, NULL, "a comparison", "one of its images", err));
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

static void gaussian(double weight[TAPS])
{
    double sum = 0.0;
    for (int i = -RADIUS; i <= RADIUS; i++)
        sum += weight[i + RADIUS] = exp(-0.5 * i * i / (DEVIATION * DEVIATION));
    for (int i = 0; i < TAPS; i++)
        weight[i] /= sum;
}

/* Sums down a window of rows, over all columns: [mean][stride]. x, y: its first row. Where the number of columns does
 * not fit, the last LANES are computed again. */
static void down(const float *x, const float *y, size_t cols, const double weight[TAPS], double *means, size_t stride)
{
    for (size_t k = 0; k < cols; k += LANES) {
        const size_t at = k + LANES <= cols ? k : cols - LANES;
        double m[MEANS][LANES] = {{0}};
        for (size_t i = 0; i < TAPS; i++)
            for (size_t l = 0; l < LANES; l++) {
                const double a = x[i * cols + at + l], b = y[i * cols + at + l], wa = weight[i] * a, wb = weight[i] * b;
                m[MEAN_X][l] += wa;
                m[MEAN_Y][l] += wb;
                m[MEAN_XX][l] += wa * a;
                m[MEAN_YY][l] += wb * b;
                m[MEAN_XY][l] += wa * b;
            }
        for (size_t q = 0; q < MEANS; q++)
            memcpy(means + q * stride + at, m[q], sizeof m[q]);
    }
}

/* Then along the row, in place, where the window lies inside; up to LANES - 1 values behind that mean nothing. */
static void along(double *means, size_t stride, size_t inner, const double weight[TAPS])
{
    for (size_t q = 0; q < MEANS; q++)
        for (size_t k = 0; k < inner; k += LANES) {
            double *at = means + q * stride + k, m[LANES] = {0};
            for (size_t i = 0; i < TAPS; i++)
                for (size_t l = 0; l < LANES; l++)
                    m[l] += weight[i] * at[i + l];
            memcpy(at, m, sizeof m);
        }
}

/* Adds a row's similarities to a judgement; mask: of its first inner pixel. */
static void add_row(hada_similarity *to, const double *means, size_t stride, size_t inner, const unsigned char *mask,
                    double *row)
{
    const double c1 = K1 * to->peak * K1 * to->peak, c2 = K2 * to->peak * K2 * to->peak;
    const double *x = means + MEAN_X * stride, *y = means + MEAN_Y * stride, *x2 = means + MEAN_XX * stride,
                 *y2 = means + MEAN_YY * stride, *xy = means + MEAN_XY * stride;
    for (size_t k = 0; k < inner; k++) {
        const double mx = x[k] * x[k], my = y[k] * y[k], mxy = x[k] * y[k];
        row[k] = (2.0 * mxy + c1) * (2.0 * (xy[k] - mxy) + c2) / ((mx + my + c1) * (x2[k] - mx + (y2[k] - my) + c2));
    }
    for (size_t k = 0; k < inner; k++)
        if (!mask || mask[k]) {
            to->mean += row[k];
            to->pixels++;
        }
}

hada_status hada_similarities(const hada_image *a, const hada_image *b, hada_similarity *list, int count,
                              hada_error *err)
{
    double *means = NULL, weight[TAPS];
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(images_check_pair(a, b, err));
    for (int n = 0; n < count; n++) {
        if (!(list[n].peak > 0.0 && isfinite(list[n].peak)))
            return hada_fail(err, HADA_ERROR_ARGUMENT, "a peak of %g is not possible; it must be above 0, and finite",
                             list[n].peak);
        list[n].mean = 0.0;
        list[n].pixels = 0;
    }
    if (a->rows < TAPS || a->cols < TAPS)
        return hada_fail(err, HADA_ERROR_SIZE, "structural similarity needs images of at least 11 x 11, not %d x %d",
                         a->rows, a->cols);
    const size_t rows = (size_t)a->rows, cols = (size_t)a->cols, inner = cols - 2 * RADIUS, stride = cols + LANES;
    HADA_TRY_OR_DONE(HADA_NEW(means, stride * (MEANS + 1), "structural similarity", err));
    double *row = means + MEANS * stride;
    gaussian(weight);
    for (size_t c = 0; c < (size_t)a->channels; c++)
        for (size_t r = 0; r + TAPS <= rows; r++) {
            const size_t first = (c * rows + r) * cols;
            down(a->data + first, b->data + first, cols, weight, means, stride);
            along(means, stride, inner, weight);
            for (int n = 0; n < count; n++)
                add_row(&list[n], means, stride, inner,
                        list[n].mask ? list[n].mask + (r + RADIUS) * cols + RADIUS : NULL, row);
        }
    for (int n = 0; n < count; n++)
        list[n].mean /= (double)list[n].pixels;
done:
    free(means);
    return status;
}

/* Differences and sharpness. */

/* Mean over the masked pixels of |a - b|^power (1 or 2). */
static hada_status mean_difference(const hada_image *a, const hada_image *b, const unsigned char *mask, int power,
                                   double *out, hada_error *err)
{
    HADA_TRY(images_check_pair(a, b, err));
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

static hada_status psnr_of(const hada_image *a, const hada_image *b, double peak, const unsigned char *mask,
                           double *out, hada_error *err)
{
    if (!(peak > 0.0 && isfinite(peak)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a peak of %g is not possible; it must be above 0, and finite",
                         peak);
    double mse = 0.0;
    HADA_TRY(mean_difference(a, b, mask, 2, &mse, err));
    *out = mse > 0.0 ? 10.0 * log10(peak * peak / mse) : INFINITY;
    return HADA_OK;
}

/* As the code of Tian and Yang 2022 computes it. */
static hada_status authors_psnr(const hada_image *a, const hada_image *b, double peak, const unsigned char *mask,
                                double *out, hada_error *err)
{
    const double ln_ten = 2.303; /* as their code has it */
    double psnr;
    hada_status status = psnr_of(a, b, peak, mask, &psnr, err); /* the checks of a pair */
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

static hada_status ssim(const hada_image *a, const hada_image *b, double peak, const unsigned char *mask, double *out,
                        hada_error *err)
{
    hada_similarity one = {.peak = peak, .mask = mask};
    HADA_TRY(hada_similarities(a, b, &one, 1, err));
    if (!one.pixels)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the mask leaves no pixel to compare");
    *out = one.mean;
    return HADA_OK;
}

hada_status hada_metric_compare(hada_metric metric, const hada_image *a, const hada_image *b, double peak,
                                const unsigned char *mask, double *out, hada_error *err)
{
    HADA_NEED(a && b && out, err);
    switch (metric) {
    case HADA_METRIC_MSE: return mean_difference(a, b, mask, 2, out, err);
    case HADA_METRIC_MAE: return mean_difference(a, b, mask, 1, out, err);
    case HADA_METRIC_PSNR: return psnr_of(a, b, peak, mask, out, err);
    case HADA_METRIC_SSIM: return ssim(a, b, peak, mask, out, err);
    case HADA_METRIC_AUTHORS_PSNR: return authors_psnr(a, b, peak, mask, out, err);
    case HADA_METRIC_AUTHORS_SSIM: return ssim(a, b, HADA_AUTHORS_RANGE * peak, mask, out, err);
    }
    return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no metric %d", (int)metric);
}

hada_status hada_metric_sharpness(const hada_image *image, const unsigned char *mask, double *out, hada_error *err)
{
    HADA_NEED(image && out, err);
    HADA_TRY(images_check_pair(image, image, err));
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
