/* Reference: what lenses see of planes behind opaque ones, in double precision. Internal. */
#ifndef HADA_REF_FORWARD_H
#define HADA_REF_FORWARD_H

#include <hadalens/camera.h>

/* The opacity of a plane at a point between its pixels (bilinear), 0 beyond its edges. */
double hada_ref_opacity(const float *opacity, int rows, int cols, double row, double col);

/* seen[c] = light[c] * max(0, 1 - sum of weight[i][j] opacity[r + row0 + i][k + col0 + j]). */
void hada_ref_hide(const double *light, const float *opacity, int channels, int rows, int cols, const float *weight,
                   int row0, int col0, int tap_rows, int tap_cols, double *seen);

/* The share of the light from a pixel (row, col) of a plane at `far_mm` that reaches the lens on (x, y) mm past the
 * opacity of a plane at `near_mm`, both rows x cols about the axis: the mean over the points of a round lens, on a grid
 * of 2 half + 1 across, each by the line from the pixel's place through the point:
 *     X = -(col - axis) pitch far / d,   at the nearer plane X' = q + (X - q) near / far,   col' = axis - X' d / (near
 * pitch)
 */
double hada_ref_clear(const hada_camera *camera, const float *opacity, int rows, int cols, double near_mm,
                      double far_mm, double x, double y, int half, int row, int col);

/* The lens (of camera->lenses centres) whose spot, at a distance, is nearest to a point of the sensor (mm). */
int hada_ref_nearest_spot(const hada_camera *camera, const double *x, const double *y, double distance_mm, double at_x,
                          double at_y);

#endif
