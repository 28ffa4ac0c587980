/* Reading the point spread functions of a model, one at a time. Internal to lib/classic. */
#ifndef HADA_CLASSIC_PSF_H
#define HADA_CLASSIC_PSF_H

#include <hadalens/model.h>

#include "fft/fft.h"

typedef struct hada_psf_reader {
    hada_slot *slot; /* its own */
    const hada_model *model;
    int positive; /* without negative values and what is taken for noise, of the same sum: for Richardson-Lucy */
    hada_spectrum_layout layout;
    size_t pixels; /* of the grid */
    hada_fft *inverse, *forward;
    hada_buffer image, spectrum;
    float *psf;     /* the last one that was read, [grid rows][grid cols], about the top left pixel, round the edges */
    float *values;  /* room for a spectrum */
    double largest; /* |OTF| of the last one that was read */
} hada_psf_reader;

hada_status hada_psf_reader_open(hada_psf_reader *reader, hada_context *context, const hada_model *model, int positive,
                                 hada_error *err);
void hada_psf_reader_close(hada_psf_reader *reader);

/* HADA_ERROR_MODEL where the model holds values that are not finite. */
hada_status hada_psf_read(hada_psf_reader *reader, int depth, int channel, hada_error *err);

/* The largest absolute value of the transform of reader->psf, as it is now. */
hada_status hada_psf_largest(hada_psf_reader *reader, double *largest, hada_error *err);

#endif
