/* Inside the search for a surface: depth maps on the host, levels of resolution. Internal. */
#ifndef HADA_SURFACE_LEVEL_H
#define HADA_SURFACE_LEVEL_H

#include "surface/magnification.h"
#include "surface/surface.h"

/* Depth maps on the host: from the light of planes, from a level of resolution to the next, smoothed, trusted. Internal
 * to lib/surface.
 *
 * Maps count depth in planes or in depths of the camera, as the caller does. Arithmetic is double, in a fixed order. */

typedef struct hada_map_size {
    int rows, cols;
} hada_map_size;

/* Where the pixel (y, x) of a map lies in another: row + y * down, col + x * along, in its pixels. */
typedef struct hada_map_place {
    double row, col, down, along;
} hada_map_place;

/* The centre of mass over planes of their light, [planes][channels][rows][cols], summed over channels and smoothed over
 * pixels by a Gaussian of `blur` pixels: depth, in planes, and light, [rows][cols]. The middle of the planes where
 * there is no light. */
hada_status hada_map_centre(const float *light, int planes, int channels, hada_map_size size, double blur, float *depth,
                            float *sum, hada_error *err);

/* Planes that a level may fill by a map of another: allowed[planes][to] is 1 from `margin` below the least to `margin`
 * above the most of the 3 x 3 pixels round the one where it lies, whole planes outwards, else 0. `scale` planes are one
 * of the map's units. */
hada_status hada_map_band(const float *depth, hada_map_size from, double scale, double margin, int planes,
                          hada_map_size to, const hada_map_place *place, float *allowed, hada_error *err);

/* Linear between the pixels of `in`, which go on outside as they are at its edge. */
void hada_map_resample(const float *in, hada_map_size from, float *out, hada_map_size to, const hada_map_place *place);

/* In place: where depths of the 3 x 3 pixels round one are further apart than `jump`, their median by light. A pixel
 * that stands on a jump has the light of both sides, and none of their depths. */
hada_status hada_map_sharpen(float *depth, const float *light, hada_map_size size, double jump, hada_error *err);

/* In place, towards the minimum over depths of  sum 1/2 light (d - depth)^2 + weight sum edge |grad d|,  light in units
 * of its mean times `data`, edge = exp(-|grad texture| / (tolerance mean texture)), |grad texture| over all channels: a
 * fixed number of primal-dual steps (A. Chambolle and T. Pock, Journal of Mathematical Imaging and Vision 40(1), 120
 * (2011)).
 */
typedef struct hada_map_rule {
    double weight, data, tolerance;
    int steps;
} hada_map_rule;
void hada_map_rule_init(hada_map_rule *rule);
hada_status hada_map_smooth(float *depth, const float *light, const float *texture, int channels, hada_map_size size,
                            const hada_map_rule *rule, hada_error *err);

/* How sure the depth of a pixel is: 1 / (1 + (s / 0.5)^2), s^2 the sum of the squares of two deviations in depths of
 * the camera: noise / (shift * root of the sum of |grad texture|^2 over channels and (2 radius + 1)^2 pixels); and
 * twice the rms distance of the depths of 7 x 7 pixels from the plane through them, which is large at jumps, where a
 * pixel's depth is that of one side or the other. noise: of the gradient by which the texture was found; shift: rms, of
 * the PSF's light from a depth to the next, in pixels, at each depth of the camera; depth in depths of the camera. */
hada_status hada_map_confidence(const float *texture, int channels, const float *depth, hada_map_size size,
                                double noise, const double *shift, int depths, int radius, float *confidence,
                                hada_error *err);

/* The levels of resolution at which a surface is looked for: their grids, their planes, their camera and frame.
 * Internal to lib/surface. */

typedef struct hada_surface_plan {
    double shrink; /* whole grid over this one */
    int steps;     /* planes from a depth of the camera to the next */
    int before;    /* depths before the camera's nearest one that its planes begin with: 0, or 1 where optics are known
                      there */
    int whole;     /* the camera's own grid, and its frames as they are */
    hada_volume_shape shape;
    hada_spectrum_layout layout;
} hada_surface_plan;

/* The levels of a camera, from coarse to fine; the last, on the camera's grid, is that of the texture. Returns how
 * many.
 */
int hada_surface_levels(const hada_context *context, const hada_surface_camera *camera, const hada_surface_shape *shape,
                        const hada_magnification *magnification, hada_surface_plan *plans);

/* Where the window's pixels of a level lie in the window of another. */
hada_map_place hada_surface_level_place(const hada_surface_plan *of, const hada_surface_plan *in);

#endif
