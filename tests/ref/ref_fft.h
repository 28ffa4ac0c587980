/* Reference: two-dimensional transforms of real images in double precision, any size. Half spectra are row-major,
 * (rows, cols/2 + 1) pairs (re, im). Forward is unnormalised, inverse divides by rows*cols and ignores the imaginary
 * parts that a real image cannot have. Internal. */
#ifndef HADA_REF_FFT_H
#define HADA_REF_FFT_H

#include "core/base.h"

hada_status hada_ref_fft_forward(const double *image, int rows, int cols, double *spectrum, hada_error *err);
hada_status hada_ref_fft_inverse(const double *spectrum, int rows, int cols, double *image, hada_error *err);

#endif
