/* Reference of the forward model: circular convolution by its definition, in double precision. Internal. */
#ifndef HADA_REF_REF_CONVOLVE_H
#define HADA_REF_REF_CONVOLVE_H

#include <stddef.h>

/* out[r][c] += sum of scene[i][j] psf[(r - i + rows/2) mod rows][(c - j + cols/2) mod cols], with the axis of the PSF
 * at (rows/2, cols/2). Zero scene pixels cost nothing. All arrays hold rows * cols values. */
void hada_ref_convolve(int rows, int cols, const float *scene, const float *psf, double *out);

/* As hada_ref_convolve without wrapping: light that leaves the frame is lost. `psf` stands on a grid of psf_rows x
 * psf_cols (axis at its middle, rounding down) and is zero beyond it. */
void hada_ref_convolve_crop(int rows, int cols, const float *scene, int psf_rows, int psf_cols, const float *psf,
                            double *out);

#endif
