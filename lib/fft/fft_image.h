/* The library's own transforms, an image at a time: both passes of small images in one launch. Internal to lib/fft. */
#ifndef HADA_FFT_IMAGE_H
#define HADA_FFT_IMAGE_H

#include "fft/fft.h"
#include "fft/fft_own.h"

typedef struct hada_own_image {
    const hada_own_pass *rows, *columns;
    size_t local_bytes;
} hada_own_image;

/* Local memory that an image takes, with `between` complex numbers between the passes; 0 where there is not enough, or
 * where a batch is better shared out by rows and columns. */
size_t hada_own_image_bytes(const hada_context *context, const hada_fft_desc *desc, size_t between);

hada_status hada_own_image_forward(const hada_own_image *image, hada_slot *slot, cl_mem in, const hada_fft_real *real,
                                   cl_mem out, const hada_fft_spectra *spectra, hada_error *err);
hada_status hada_own_image_inverse(const hada_own_image *image, hada_slot *slot, cl_mem in,
                                   const hada_fft_columns_in *from, const hada_fft_filter *use, cl_mem out,
                                   const hada_fft_real *real, hada_error *err);

#endif
