/* Reference of the linear path in double precision: frame to spectrum, filter, window. Internal. */
#ifndef HADA_REF_FILTER_H
#define HADA_REF_FILTER_H

#include "core/base.h"

/* Sizes and positions on the grid, as in <hadalens/model.h>. */
typedef struct hada_ref_grid {
    int rows, cols;                                       /* of the grid */
    int raw_row, raw_col, raw_rows, raw_cols;             /* the frame on it */
    int window_row, window_col, window_rows, window_cols; /* the window on it */
} hada_ref_grid;

/* Spectrum of an image at (row, col) on the grid and is zero elsewhere; row-major half spectrum, re and im
 * interleaved. */
hada_status hada_ref_grid_forward(const hada_ref_grid *grid, const float *image, int row, int col, int rows, int cols,
                                  double *spectrum, hada_error *err);

/* The window of inverse(spectrum * filter); split: Re*re + i*Im*im. */
hada_status hada_ref_hadamard(const hada_ref_grid *grid, const double *spectrum, const float *filter, int split,
                              double *window, hada_error *err);

#endif
