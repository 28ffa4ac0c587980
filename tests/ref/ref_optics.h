/* Reference: wave optics in double precision. Complex values are interleaved (real, imaginary). Internal. */
#ifndef HADA_REF_OPTICS_H
#define HADA_REF_OPTICS_H

#include <stddef.h>

/* The Fresnel integral by its sum, at one point (x, y) of the sensor: light of wavelength lambda from the axis at z
 * through the mask's transmission field, n x n complex samples `step` apart about (middle_x, middle_y), over d:
 *     U = 1 / (lambda d) sum field exp(i pi |q|^2 / lambda z) exp(i pi |s - q|^2 / lambda d) step^2,
 * but for the phase of free space, common to all points. J. W. Goodman, Introduction to Fourier Optics, 3rd ed. (2005),
 * equation 4-14. z may be infinite. */
void hada_ref_fresnel(const double *field, int n, double step, double middle_x, double middle_y, double lambda,
                      double z, double d, double x, double y, double out[2]);

/* Light on the pixel of width `width` about (x, y), from a lens of that field: the mean of `parts` x `parts` points of
 * |U|^2, times the area. */
double hada_ref_wave_pixel(const double *field, int n, double step, double middle_x, double middle_y, double lambda,
                           double z, double d, double x, double y, double width, int parts);

/* What the kernel optics_wave_pupil gives of one lens about (x, y): real parts, imaginary parts, rows `pitch` apart.
 * phase: across, then down, `pitch` complex values each. planes: a, b, c and one more, `plane_count` of them. */
void hada_ref_wave_pupil(const float *phase, double x, double y, const float *planes, int plane_count, int n, int pitch,
                         double step, double radius, double aperture, double *out);

/* Pixels of |A + i B|^2 of two half spectra with columns in blocks of 8: pixels x pixels. */
void hada_ref_wave_spot(const float *a, const float *b, int pixels, int samples, double *out);

/* open exp(2 pi i waves path): real parts, imaginary parts. */
void hada_ref_wave_mask(const float *path, const float *open, size_t count, double waves, double *out);

/* The half spectra of a field's real and imaginary part, row-major within blocks of 8 columns, times across[column]
 * down[row]: the half spectra of the parts of the product field, one after the other. */
void hada_ref_wave_travel(const float *real, const float *imaginary, const float *across, const float *down, int rows,
                          int blocks, double *out);

/* Light of rows x cols samples on pixels, both squares: samples of width 1, pixels of `width`, the first of which
 * begins at (row, col) in samples. */
void hada_ref_wave_sensor(const float *real, const float *imaginary, int rows, int cols, double row, double col,
                          double width, int pixel_rows, int pixel_cols, double *out);

#endif
