/* Yardsticks of two images of one size, on the host in double precision. */
#include <hadalens/metrics.h>
#include <math.h>

#include "core/error.h"
#include "metrics/similarity.h"

/* Mean over the masked pixels of |a - b|^power (1 or 2). */
static hada_status mean_difference(const hada_image *a, const hada_image *b, const unsigned char *mask, int power,
                                   double *out, hada_error *err)
{
    hada_status status = hada_images_check_pair(a, b, err);
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

static hada_status psnr_of(const hada_image *a, const hada_image *b, double peak, const unsigned char *mask,
                           double *out, hada_error *err)
{
    if (!(peak > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a peak of %g is not possible; it must be above 0", peak);
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
    hada_status status = hada_images_check_pair(image, image, err);
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
