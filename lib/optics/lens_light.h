/* The light of single lenses, or of patches of a mask without lenses (patch_light.h): which part of a PSF a lens makes,
 * and through which points it looks. Internal.
 *
 * A point q of the mask that belongs to the lens on p lands at p m + (q - p)(m - d/f), m = 1 + d/z. q is nearer to p
 * than to any other centre, and as long as |m - d/f| <= m, where it lands is nearer to p m than to any other spot. So
 * the PSF is parted exactly by the nearest spot, but for the tails of the blur over the borders of touching lenses; and
 * this holds for PSFs from elsewhere (measured, wave optics, in colour) as well as for those of the geometry. */
#ifndef HADA_OPTICS_LENS_LIGHT_H
#define HADA_OPTICS_LENS_LIGHT_H

#include "core/error.h"
#include "optics/mask.h"

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

/* Points of a lens's outline relative to its centre (mm), on a square grid of 2 half + 1 across its diameter: those
 * that are in the aperture and nearer to no other centre. Of a patch: those where the mask is open. `x` and `y` hold (2
 * half + 1)^2; returns how many. */
int hada_lens_outline(const hada_camera *camera, const hada_lenses *lenses, int lens, int half, double *x, double *y);

#endif
