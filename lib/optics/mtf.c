#include "optics/mtf.h"

#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"

hada_status hada_mtf_create(hada_mtf *mtf, hada_context *context, int rows, int cols, hada_error *err)
{
    *mtf = (hada_mtf){.rows = rows, .cols = cols};
    hada_fft_desc desc = {.direction = HADA_FFT_FORWARD,
                          .rows = hada_fft_good_size(2 * rows),
                          .cols = hada_fft_good_size(2 * cols),
                          .batch = 1,
                          .real_rows = rows,
                          .real_cols = cols,
                          .real_pitch = (size_t)cols,
                          .real_distance = (size_t)rows * (size_t)cols};
    void *values = NULL;
    HADA_TRY(hada_slot_create(&mtf->slot, context, err));
    HADA_TRY(hada_fft_create(&mtf->forward, mtf->slot, &desc, err));
    desc.direction = HADA_FFT_INVERSE;
    desc.real_rows = desc.rows;
    desc.real_cols = desc.cols;
    desc.real_pitch = (size_t)desc.cols;
    desc.real_distance = (size_t)desc.rows * (size_t)desc.cols;
    HADA_TRY(hada_fft_create(&mtf->inverse, mtf->slot, &desc, err));
    mtf->layout = *hada_fft_plan_layout(mtf->forward);
    const size_t spectrum = 2 * mtf->layout.count;
    const size_t floats = spectrum > desc.real_distance ? spectrum : desc.real_distance;
    HADA_TRY(hada_allocated(values = hada_alloc(floats, sizeof(float), "a spectrum", err)));
    mtf->values = values;
    HADA_TRY(hada_buffer_create(&mtf->real, context, desc.real_distance * sizeof(float), "an image", err));
    return hada_buffer_create(&mtf->spectrum, context, spectrum * sizeof(float), "a spectrum", err);
}

void hada_mtf_destroy(hada_mtf *mtf)
{
    if (mtf->slot)
        hada_slot_finish(mtf->slot, NULL);
    hada_fft_destroy(&mtf->forward);
    hada_fft_destroy(&mtf->inverse);
    hada_buffer_destroy(&mtf->real);
    hada_buffer_destroy(&mtf->spectrum);
    hada_slot_destroy(&mtf->slot);
    free(mtf->values);
    *mtf = (hada_mtf){0};
}

/* Every frequency once: those of the half spectrum that have a mirror image count twice. */
static double rings_of(hada_mtf *mtf, double threshold, int rings, double *mean, double *weight)
{
    const int rows = mtf->layout.rows, cols = mtf->layout.cols;
    const double whole = hypot(mtf->values[0], mtf->values[1]);
    double reached = 0.0;
    for (int i = 0; i < rings; i++)
        mean[i] = weight[i] = 0.0;
    for (int ky = 0; ky < rows; ky++)
        for (int kx = 0; kx <= cols / 2; kx++) {
            float *at = mtf->values + 2 * hada_spectrum_index(&mtf->layout, ky, kx);
            const double square = (double)at[0] * at[0] + (double)at[1] * at[1], gain = sqrt(square) / whole;
            const double fy = (double)(ky <= rows / 2 ? ky : ky - rows) / rows, fx = (double)kx / cols;
            const double count = kx && 2 * kx != cols ? 2.0 : 1.0;
            const int ring = (int)(2.0 * rings * sqrt(fx * fx + fy * fy));
            if (ring < rings) {
                mean[ring] += count * gain;
                weight[ring] += count;
            }
            reached += gain >= threshold ? count : 0.0;
            at[0] = (float)square;
            at[1] = 0.0f;
        }
    for (int i = 0; i < rings; i++)
        mean[i] = weight[i] > 0.0 ? mean[i] / weight[i] : NAN;
    return reached / ((double)rows * cols);
}

hada_status hada_mtf_measure(hada_mtf *mtf, const hada_image *image, double threshold, int rings, double *mean,
                             double *support, hada_error *err)
{
    const size_t pixels = (size_t)mtf->rows * (size_t)mtf->cols * sizeof(float);
    const size_t spectrum = 2 * mtf->layout.count * sizeof(float);
    const size_t grid = (size_t)mtf->layout.rows * (size_t)mtf->layout.cols * sizeof(float);
    void *weight = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(weight = hada_alloc((size_t)rings, sizeof(double), "rings", err)));
    HADA_TRY_OR_DONE(hada_buffer_write(&mtf->real, mtf->slot, 0, image->data, pixels, err));
    HADA_TRY_OR_DONE(hada_fft_forward(mtf->forward, 1, mtf->real.mem, 0, mtf->spectrum.mem, 0, err));
    HADA_TRY_OR_DONE(hada_buffer_read(&mtf->spectrum, mtf->slot, 0, mtf->values, spectrum, err));
    *support = rings_of(mtf, threshold, rings, mean, weight);
    HADA_TRY_OR_DONE(hada_buffer_write(&mtf->spectrum, mtf->slot, 0, mtf->values, spectrum, err));
    HADA_TRY_OR_DONE(hada_fft_inverse(mtf->inverse, 1, mtf->spectrum.mem, 0, mtf->real.mem, 0, NULL, err));
    HADA_TRY_OR_DONE(hada_buffer_read(&mtf->real, mtf->slot, 0, mtf->values, grid, err));
done:
    free(weight);
    return status;
}

double hada_mtf_self(const hada_mtf *mtf, int row, int col)
{
    const int rows = mtf->layout.rows, cols = mtf->layout.cols;
    const size_t at = (size_t)((row + rows) % rows) * (size_t)cols + (size_t)((col + cols) % cols);
    return (double)mtf->values[at] / mtf->values[0];
}
