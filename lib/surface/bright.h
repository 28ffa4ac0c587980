/* The pixels of a point spread function that say how it lies, and how far out its light goes. Internal to lib/surface.
 */
#ifndef HADA_SURFACE_BRIGHT_H
#define HADA_SURFACE_BRIGHT_H

#include "core/error.h"

typedef struct hada_bright_point {
    int y, x; /* from the grid's origin */
    double value;
} hada_bright_point;

typedef struct hada_bright {
    hada_bright_point *point;
    int count;
    double norm; /* root of the sum of squares of the values */
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
