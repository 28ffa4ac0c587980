/* What patches of a mask without lenses make of a PSF. Internal.
 *
 * A ray through the point q of the mask lands where the mask sends it, so by geometry a patch makes the light of its
 * own rays, and the patches' light adds up to the PSF. `share` is that light over the light of all patches, pixel by
 * pixel; it parts PSFs from elsewhere (measured, wave optics, in colour) in the same way. Where no ray lands, a pixel
 * belongs to the patch that a straight ray to it passes. */
#ifndef HADA_OPTICS_PATCH_LIGHT_H
#define HADA_OPTICS_PATCH_LIGHT_H

#include "optics/lens_light.h"
#include "optics/psf_rays.h"

typedef struct hada_patch_light {
    const hada_lenses *patches;
    hada_rays rays;
    double *all; /* of all patches, rows x cols */
    double least;
    int rows, cols;
} hada_patch_light;

/* Of rows x cols pixels with the axis at (axis_row, axis_col). The patches must outlive it. */
hada_status hada_patch_light_make(hada_patch_light *light, const hada_lenses *patches, double distance_mm, int rows,
                                  int cols, double axis_row, double axis_col, hada_error *err);
void hada_patch_light_free(hada_patch_light *light);

/* The share of a patch; labels: hada_lens_labels() of the patches on the same grid. */
hada_status hada_patch_light_share(hada_patch_light *light, int patch, const int *labels, float *share,
                                   hada_error *err);

#endif
