/* Small transforms on the host: complex, square, a power of two a side. Internal. */
#ifndef HADA_IMAGE_SMALL_FFT_H
#define HADA_IMAGE_SMALL_FFT_H

#include <hadalens/image.h>

#include "core/base.h"

typedef struct hada_small_fft {
    int size;
    float *twiddles; /* size / 2 complex numbers exp(-2 pi i k / size) */
    int *order;      /* bits reversed */
} hada_small_fft;

/* Destroyed by the caller, also where this failed. */
hada_status hada_small_fft_create(hada_small_fft *fft, int size, hada_error *err);
void hada_small_fft_destroy(hada_small_fft *fft);

/* In place on size x size complex numbers (re, im), unnormalised. The result is transposed: row and column frequencies
 * are exchanged, [kx][ky]. Twice gives the image mirrored in both directions, times size * size. */
void hada_small_fft_run(const hada_small_fft *fft, float *data);

/* Spectra of real images: half of one, [kx][ky] with kx from 0 to size / 2. Two images go through one transform, one of
 * them in the real parts of `work`, the other in the imaginary parts: their spectra after it; and what has to be
 * transformed to have both images, times size * size, the second one with the opposite sign. */
void hada_small_fft_part(const hada_small_fft *fft, const float *work, float *first, float *second);
void hada_small_fft_join(const hada_small_fft *fft, const float *first, const float *second, float *work);

/* Transforms an image of one channel less its mean, with zeros beyond it; returns its energy. */
double hada_small_fft_put(const hada_small_fft *fft, const hada_image *image, float *to);

/* Cross-correlates two images by their transforms, `work` (overwritten) and `other`. Returns the largest value; *row
 * and *col say how far the first image has to be moved for it, in pixels. */
double hada_small_fft_match(const hada_small_fft *fft, float *work, const float *other, double *row, double *col);

#endif
