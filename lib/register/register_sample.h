/* Images looked at through an affine map, without aliasing. Internal. */
#ifndef HADA_REGISTER_REGISTER_SAMPLE_H
#define HADA_REGISTER_REGISTER_SAMPLE_H

#include <hadalens/register.h>

#include "core/error.h"

enum { HADA_REGISTER_HALVINGS = 12 };

/* One plane at full size and halved again and again (means of 2 x 2). */
typedef struct hada_register_plane {
    int levels;
    int rows[HADA_REGISTER_HALVINGS], cols[HADA_REGISTER_HALVINGS];
    float *data[HADA_REGISTER_HALVINGS];
} hada_register_plane;

hada_status hada_register_plane_create(hada_register_plane *plane, const float *data, int rows, int cols,
                                       hada_error *err);
void hada_register_plane_destroy(hada_register_plane *plane);

/* A plane as it is sampled every `step` of its pixels (1 or less: as it is): a halved copy, smoothed by a Gaussian that
 * makes pixels of one into pixels of the step. */
typedef struct hada_register_view {
    int rows, cols;
    double scale;            /* its pixels per pixel of the plane */
    double mid_row, mid_col; /* the middle of the plane, in its pixels */
    float *data;
    float *room; /* NULL where data is the plane's own */
} hada_register_view;
hada_status hada_register_view_create(hada_register_view *view, const hada_register_plane *plane, double step,
                                      hada_error *err);
void hada_register_view_destroy(hada_register_view *view);

/* The matrix of a registration without its offset: from the scene to the sensor, (row, column). */
void hada_register_matrix(const hada_registration *registration, double matrix[2][2]);

/* out[r * out_pitch + c * out_step] for r < rows, c < cols is what the plane holds at inverse * p, with p = (row,
 * column) from the middle of rows x cols less (row, col), times `pitch`; both middles are those of the images, between
 * pixels where a size is even. Zero outside. Cubic interpolation (Keys 1981, a = -1/2). */
void hada_register_sample(const hada_register_view *view, double inverse[2][2], double pitch, double row, double col,
                          int rows, int cols, float *out, int out_pitch, int out_step);

/* The inverse of a matrix that is not singular. */
void hada_register_invert(double matrix[2][2], double inverse[2][2]);

#endif
