/* Reading point spread functions between pixels, and their brightest pixels. Internal to lib/surface. */
#ifndef HADA_SURFACE_SPLINE_H
#define HADA_SURFACE_SPLINE_H

#include "core/base.h"
#include "kernels/shared_surface.h"

/* Interpolation by quintic splines (M. Unser, A. Aldroubi and M. Eden, IEEE Transactions on Signal Processing 41(2),
 * 821 (1993)): coefficients come from an image by a division in the frequency domain, and six of them along each axis
 * make a value. Cubic splines leave 3.5 % of spots of 0.8 pixels (standard deviation), quintic ones 2.5 %, of which
 * aliasing alone makes most. Internal to lib/surface. */

/* The coefficients of an image have its spectrum divided by gain(ky, rows) gain(kx, cols). */
double hada_spline_gain(int k, int n);

/* Of the coefficients at base - 2 ... base + 3 for a value at base + fraction. */
void hada_spline_weights(double fraction, double weights[HADA_SPLINE_TAPS]);

/* The tables that sample a periodic axis of n points, with its origin at point 0, at (i - offset) / scale for all of
 * its points i; points from n/2 on, rounded up, count as i - n. base[i]: first of the taps, 0 <= base < n; weights[k *
 * n + i]: of the taps, times factor; 0 where a point lies outside -n/2 ... n/2. n is at least HADA_SPLINE_TAPS. */
void hada_spline_axis(int n, double scale, double offset, double factor, int *base, float *weights);

/* The value at (y, x) of a periodic image with these coefficients, its origin at pixel (0, 0); 0 outside it. */
double hada_spline_value(const float *coefficients, int rows, int cols, double y, double x);

/* The pixels of a point spread function that say how it lies, and how far out its light goes. Internal to lib/surface.
 */

typedef struct hada_bright_point {
    int y, x; /* from the grid's origin */
    double value;
} hada_bright_point;

typedef struct hada_bright {
    hada_bright_point *point;
    int count;
    double norm;      /* root of the sum of squares of the values */
    double centre[2]; /* row and column of the PSF's energy, of which haze has little */
} hada_bright;

/* Of PSFs by their spline coefficients, [depths][rows][cols], origin at pixel (0, 0): the radius within which 0.9 of
 * their energy lies, without that of noise; 1 at least; and *spread, the root of the mean square of its distance
 * within. */
hada_status hada_bright_edge(const float *coefficients, int depths, int rows, int cols, double *edge, double *spread,
                             hada_error *err);

/* A PSF's bright pixels, those far out before others: the farther out, the more they move. */
hada_status hada_bright_find(hada_bright *out, const float *coefficients, int rows, int cols, double edge,
                             hada_error *err);

#endif
