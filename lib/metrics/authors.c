/* PSNR and SSIM as the code of Tian and Yang 2022 computes them. */
#include <hadalens/metrics.h>
#include <math.h>

#include "core/error.h"

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
