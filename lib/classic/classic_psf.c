/* Point spread functions, as a method takes them: from the model's transfer functions by an inverse transform. */
#include "classic/classic_psf.h"

#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "filter/layout.h"
#include "model/model.h"

static const char what[] = "a point spread function";

/* Values below so many times the noise are taken for noise: of a million normal ones less than one is above. */
static const double noises = 5.0;

/* Richardson-Lucy cannot do with negative values; functions that were learned from pairs have noise on both sides of
 * zero. The noise is what the negative values say; the sum, which is what the frame's brightness fixes best, is kept.
 */
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

static hada_fft_desc describe(const hada_psf_reader *reader, hada_fft_direction direction)
{
    const int rows = reader->layout.rows, cols = reader->layout.cols;
    return (hada_fft_desc){.direction = direction,
                           .rows = rows,
                           .cols = cols,
                           .batch = 1,
                           .real_rows = rows,
                           .real_cols = cols,
                           .real_pitch = (size_t)cols,
                           .real_distance = reader->pixels};
}

hada_status hada_psf_reader_open(hada_psf_reader *reader, hada_context *context, const hada_model *model, int positive,
                                 hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    *reader = (hada_psf_reader){.model = model, .positive = positive};
    reader->layout = hada_fft_layout(context, info->grid_rows, info->grid_cols, HADA_FFT_AUTO);
    reader->pixels = (size_t)info->grid_rows * (size_t)info->grid_cols;
    const hada_fft_desc inverse = describe(reader, HADA_FFT_INVERSE), forward = describe(reader, HADA_FFT_FORWARD);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_slot_create(&reader->slot, context, err));
    HADA_TRY_OR_DONE(hada_fft_create(&reader->inverse, reader->slot, &inverse, err));
    HADA_TRY_OR_DONE(hada_fft_create(&reader->forward, reader->slot, &forward, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&reader->image, context, reader->pixels * sizeof(float), what, err));
    HADA_TRY_OR_DONE(
        hada_buffer_create(&reader->spectrum, context, reader->layout.count * 2 * sizeof(float), what, err));
    HADA_TRY_OR_DONE(hada_allocated(reader->psf = hada_alloc_raw(reader->pixels, sizeof(float), what, err)));
    HADA_TRY_OR_DONE(
        hada_allocated(reader->values = hada_alloc_raw(reader->layout.count, 2 * sizeof(float), what, err)));
done:
    if (status)
        hada_psf_reader_close(reader);
    return status;
}

void hada_psf_reader_close(hada_psf_reader *reader)
{
    if (reader->slot)
        hada_slot_finish(reader->slot, NULL);
    hada_fft_destroy(&reader->inverse);
    hada_fft_destroy(&reader->forward);
    hada_buffer_destroy(&reader->image);
    hada_buffer_destroy(&reader->spectrum);
    hada_slot_destroy(&reader->slot);
    free(reader->psf);
    free(reader->values);
    *reader = (hada_psf_reader){0};
}

static double square_of(const float *value)
{
    return (double)value[0] * value[0] + (double)value[1] * value[1];
}

/* Whether all values are finite: x - x is 0 for finite x alone. */
static int is_finite(const float *values, size_t count)
{
    float sum = 0.0f;
    for (size_t i = 0; i < count; i++)
        sum += values[i] - values[i];
    return sum == 0.0f;
}

hada_status hada_psf_read(hada_psf_reader *reader, int depth, int channel, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(reader->model);
    const size_t plane = hada_model_plane(reader->model);
    const float *otf = reader->model->otf + ((size_t)depth * (size_t)info->channels + (size_t)channel) * plane * 2;
    if (!is_finite(otf, 2 * plane))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "%s: the transfer function of depth %d holds values that are not finite; the model is "
                         "damaged, make it again",
                         *info->name ? info->name : "the model", depth);
    reader->largest = 0.0;
    for (size_t i = 0; i < plane; i++)
        reader->largest = fmax(reader->largest, square_of(otf + 2 * i));
    reader->largest = sqrt(reader->largest);
    hada_layout_pack(&reader->layout, otf, reader->values);
    HADA_TRY(hada_buffer_write(&reader->spectrum, reader->slot, 0, reader->values, reader->spectrum.bytes, err));
    HADA_TRY(hada_fft_inverse(reader->inverse, 1, reader->spectrum.mem, 0, reader->image.mem, 0, NULL, err));
    HADA_TRY(hada_buffer_read(&reader->image, reader->slot, 0, reader->psf, reader->image.bytes, err));
    if (reader->positive)
        make_positive(reader->psf, reader->pixels);
    return HADA_OK;
}

hada_status hada_psf_largest(hada_psf_reader *reader, double *largest, hada_error *err)
{
    const hada_spectrum_layout *layout = &reader->layout;
    *largest = 0.0;
    HADA_TRY(hada_buffer_write(&reader->image, reader->slot, 0, reader->psf, reader->image.bytes, err));
    HADA_TRY(hada_fft_forward(reader->forward, 1, reader->image.mem, 0, reader->spectrum.mem, 0, err));
    HADA_TRY(hada_buffer_read(&reader->spectrum, reader->slot, 0, reader->values, reader->spectrum.bytes, err));
    for (int ky = 0; ky < layout->rows; ky++)
        for (int kx = 0; kx <= layout->cols / 2; kx++)
            *largest = fmax(*largest, square_of(reader->values + 2 * hada_spectrum_index(layout, ky, kx)));
    *largest = sqrt(*largest);
    return HADA_OK;
}
