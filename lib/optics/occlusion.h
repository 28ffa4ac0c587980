/* What a lens sees of a plane behind opaque planes. Internal. */
#ifndef HADA_OPTICS_OCCLUSION_H
#define HADA_OPTICS_OCCLUSION_H

#include "optics/lens_light.h"
#include "runtime/slot.h"

/* Weights over pixels of a nearer plane's opacity that hide pixel (r, c) of a farther plane from one lens:
 * weight[i * cols + j] belongs to opacity (r + row0 + i, c + col0 + j). They sum to 1. */
typedef struct hada_taps {
    int row0, col0, rows, cols;
    float *weight;
} hada_taps;

/* A ray from pixel u (sensor's grid, from the axis) of the plane at `far` through the point q of the lens meets the
 * plane at `near` at u - q d (1/near - 1/far) / pitch. The weights are the mean over the lens's outline, each ray
 * shared out to the four pixels about where it lands (bilinear: the overlap of a pixel of one plane with those of the
 * other).
 */
hada_status hada_taps_create(hada_taps *taps, const hada_camera *camera, const hada_lenses *lenses, int lens,
                             double near_mm, double far_mm, hada_error *err);
void hada_taps_destroy(hada_taps *taps);

/* Enqueues seen = light * max(0, 1 - what the weights make of opacity) for `channels` images of rows x cols; opacity
 * (from `opacity_offset` floats on) is 0 beyond its edges. `seen` may be `light`. `weights` holds taps->weight. */
hada_status hada_optics_hide(hada_slot *slot, cl_mem light, cl_mem seen, size_t seen_offset, cl_mem opacity,
                             size_t opacity_offset, cl_mem weights, const hada_taps *taps, int channels, int rows,
                             int cols, hada_error *err);

#endif
