/* The light of single lenses, or of patches of a mask without lenses (hada_patch_light): which part of a PSF a lens
 * makes, and through which points it looks. Internal.
 *
 * A point q of the mask that belongs to the lens on p lands at p m + (q - p)(m - d/f), m = 1 + d/z. q is nearer to p
 * than to any other centre, and as long as |m - d/f| <= m, where it lands is nearer to p m than to any other spot. So
 * the PSF is divided exactly by the nearest spot, but for the tails of the blur over the borders of touching lenses;
 * and this holds for PSFs from elsewhere (measured, wave optics, in colour) as well as for those of the geometry. */
#ifndef HADA_OPTICS_OCCLUSION_H
#define HADA_OPTICS_OCCLUSION_H

#include "optics/mask.h"
#include "runtime/slot.h"

/* The places that a camera looks from: lenses and round holes, or square patches of another mask. */
typedef struct hada_lenses {
    int count;
    double *x, *y;           /* centres, mm; one block, freed with x */
    double side;             /* of a patch, mm; 0: lenses */
    int across;              /* patches */
    hada_mask_design design; /* of a mask of patches: where it is open */
} hada_lenses;

/* patch_mm: the largest side of a patch, for masks that are not made of lenses or round holes. */
hada_status hada_lenses_create(hada_lenses *lenses, const hada_camera *camera, double patch_mm,
                               const hada_monitor *monitor, hada_error *err);
void hada_lenses_destroy(hada_lenses *lenses);

/* labels[rows x cols]: the lens whose spot at a distance is nearest to a pixel, with the axis at (axis_row, axis_col).
 * The first of equally near ones. */
void hada_lens_labels(const hada_camera *camera, const hada_lenses *lenses, double distance_mm, int rows, int cols,
                      double axis_row, double axis_col, int *labels);

/* What a lens sees of a plane behind opaque planes. Internal. */

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

/* What patches of a mask without lenses make of a PSF. Internal.
 *
 * A ray through the point q of the mask lands where the mask sends it, so by geometry a patch makes the light of its
 * own rays, and the patches' light adds up to the PSF. `share` is that light over the light of all patches, pixel by
 * pixel; it parts PSFs from elsewhere (measured, wave optics, in colour) in the same way. Where no ray lands, a pixel
 * belongs to the patch that a straight ray to it passes. */

typedef struct hada_patch_light {
    const hada_lenses *patches;
    hada_rays rays;
    double *all; /* of all patches, rows x cols */
    double least;
    int rows, cols;
} hada_patch_light;

#endif
