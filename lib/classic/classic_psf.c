/* Point spread functions without negative values, which Richardson-Lucy cannot do without: those that were learned from
 * pairs have noise on both sides of zero. */
#include <math.h>
#include <stdlib.h>

#include "classic/classic.h"
#include "core/alloc.h"

/* Values below so many times the noise are taken for noise: of a million normal ones less than one is above. */
static const double noises = 5.0;

/* The noise is what the negative values say; the sum, which is what the frame's brightness fixes best, is kept. */
static void make_positive(float *psf, size_t count)
{
    double square = 0.0, before = 0.0, after = 0.0;
    size_t negative = 0;
    for (size_t i = 0; i < count; i++) {
        before += psf[i];
        if (psf[i] < 0.0f) {
            square += (double)psf[i] * psf[i];
            negative++;
        }
    }
    const double least = negative ? noises * sqrt(square / (double)negative) : 0.0;
    for (size_t i = 0; i < count; i++) {
        if (!(psf[i] > least))
            psf[i] = 0.0f;
        after += psf[i];
    }
    for (size_t i = 0; after > 0.0 && before > 0.0 && i < count; i++)
        psf[i] = (float)(psf[i] * (before / after));
}

hada_status hada_classic_positive(hada_slot *slot, const hada_spectrum_layout *layout, int images, cl_mem otf,
                                  size_t offset, hada_error *err)
{
    const size_t count = (size_t)layout->rows * (size_t)layout->cols;
    hada_fft_desc desc = {.direction = HADA_FFT_INVERSE,
                          .rows = layout->rows,
                          .cols = layout->cols,
                          .batch = 1,
                          .real_rows = layout->rows,
                          .real_cols = layout->cols,
                          .real_pitch = (size_t)layout->cols,
                          .real_distance = count};
    hada_fft *inverse = NULL, *forward = NULL;
    hada_buffer image = {0};
    float *psf = NULL;
    hada_status status = hada_fft_create(&inverse, slot, &desc, err);
    desc.direction = HADA_FFT_FORWARD;
    if (!status)
        status = hada_fft_create(&forward, slot, &desc, err);
    if (!status)
        status = hada_buffer_create(&image, slot->context, count * sizeof(float), "a point spread function", err);
    if (!status)
        status = hada_alloc_raw((void **)&psf, count, sizeof *psf, "a point spread function", err);
    for (int i = 0; !status && i < images; i++) {
        const size_t at = offset + (size_t)i * layout->count;
        status = hada_fft_inverse(inverse, 1, otf, at, image.mem, 0, NULL, err);
        if (!status)
            status = hada_buffer_read(&image, slot, 0, psf, count * sizeof *psf, err);
        if (!status) {
            make_positive(psf, count);
            status = hada_buffer_write(&image, slot, 0, psf, count * sizeof *psf, err);
        }
        if (!status)
            status = hada_fft_forward(forward, 1, image.mem, 0, otf, at, err);
    }
    if (!status)
        status = hada_slot_finish(slot, err);
    else
        hada_slot_finish(slot, NULL);
    hada_fft_destroy(&inverse);
    hada_fft_destroy(&forward);
    hada_buffer_destroy(&image);
    free(psf);
    return status;
}
