/* Modulation transfer and self-correlation of PSFs, on a device. Internal. */
#ifndef HADA_OPTICS_MTF_H
#define HADA_OPTICS_MTF_H

#include <hadalens/image.h>

#include "fft/fft.h"

typedef struct hada_mtf {
    hada_slot *slot;
    hada_fft *forward, *inverse;
    hada_spectrum_layout layout; /* of a grid twice the image: correlations do not wrap round */
    hada_buffer real, spectrum;
    float *values; /* a spectrum, or an image, on the host */
    int rows, cols;
} hada_mtf;

hada_status hada_mtf_create(hada_mtf *mtf, hada_context *context, int rows, int cols, hada_error *err);
void hada_mtf_destroy(hada_mtf *mtf);

/* Of an image of one channel: means of the MTF over `rings` rings up to 0.5 cycles per pixel, and the share of the
 * frequencies, corners too, where it reaches a threshold. The self-correlation stands in the object afterwards. */
hada_status hada_mtf_measure(hada_mtf *mtf, const hada_image *image, double threshold, int rings, double *mean,
                             double *support, hada_error *err);

/* The self-correlation at a lag, |row| < rows, |col| < cols, relative to lag 0. */
double hada_mtf_self(const hada_mtf *mtf, int row, int col);

#endif
