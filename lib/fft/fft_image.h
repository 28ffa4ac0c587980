/* The library's own transforms, an image at a time: both passes of small images in one launch. Internal to lib/fft. */
#ifndef HADA_FFT_IMAGE_H
#define HADA_FFT_IMAGE_H

#include "fft/fft.h"
#include "fft/fft_own.h"

typedef struct hada_own_image {
    const hada_own_pass *rows, *columns;
    size_t local_bytes;
} hada_own_image;

/* The images 0..images-1 of a batch. Offsets as in hada_fft_forward() and _inverse(); the filter, its count of spectra
 * and the program's options are for inverse transforms. */
typedef struct hada_own_io {
    cl_mem in, out, filter;
    size_t in_offset, out_offset, filter_offset;
    size_t spectrum_distance;
    int in_count, images;
    int stride, band_rows, band_cols; /* inverse: as hada_fft_resolve() gives them */
    const char *options;
} hada_own_io;

/* Local memory that an image takes, with `between` complex numbers between the passes; 0 where there is not enough, or
 * where a batch is better shared out by rows and columns. */
size_t hada_own_image_bytes(const hada_context *context, const hada_fft_desc *desc, size_t between);

hada_status hada_own_image_forward(const hada_own_image *image, hada_slot *slot, const hada_fft_desc *desc,
                                   const hada_own_io *io, hada_error *err);
hada_status hada_own_image_inverse(const hada_own_image *image, hada_slot *slot, const hada_fft_desc *desc,
                                   const hada_own_io *io, hada_error *err);

/* What an inverse transform multiplies by. */
static inline float hada_own_scale(const hada_fft_desc *desc)
{
    return (float)(1.0 / ((double)desc->rows * (double)desc->cols));
}

#endif
