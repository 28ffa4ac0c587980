/* References of surfaces: optics between depths, in double precision. Internal. */
#ifndef HADA_REF_SURFACE_H
#define HADA_REF_SURFACE_H

#include "core/base.h"

/* The B-spline of degree 5 (I. J. Schoenberg, 1946), by its definition. */
double hada_ref_b_spline(double x);

/* The coefficients of the quintic spline through an image, which is periodic, by its half spectrum (rows x (cols/2 + 1)
 * complex numbers). */
hada_status hada_ref_spline(const double *spectrum, int rows, int cols, double *coefficients, hada_error *err);

/* out += weight / scale^2 times the spline at ((y - row) / scale, (x - col) / scale), pixels from the middle of the
 * grid on counting as those before its origin, (0, 0); nothing where that lies outside the image. */
void hada_ref_magnify(const double *coefficients, int rows, int cols, double scale, double row, double col,
                      double weight, double *out);

#endif
