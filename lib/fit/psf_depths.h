/* Point spread functions of several depths: those between and beyond what was measured, and how far these wander from
 * depth to depth. Internal. */
#ifndef HADA_FIT_PSF_DEPTHS_H
#define HADA_FIT_PSF_DEPTHS_H

#include <hadalens/device.h>
#include <hadalens/image.h>

/* What was measured: clean point spread functions of one size, axis in the middle, distances rising from above 0. */
typedef struct hada_psfs {
    const hada_image *image;
    const double *distances_mm;
    int count;
} hada_psfs;

/* out[count], created by the call: the pattern of a mask at *mask_mm from the sensor is 1 + mask / distance times as
 * large on it. Of two neighbours that were measured each is magnified, and they are blended, linear in 1 / distance;
 * beyond the first and the last of them these are magnified alone. *mask_mm 0: found, with the axis, from `psfs`, at
 * least two; *left: the share of one that the law leaves unexplained by the others (magnification.h), if it is found.
 * HADA_ERROR_NUMERIC where they do not follow the law. */
hada_status hada_psf_depths(hada_image *out, const double *distances_mm, int count, const hada_psfs *psfs,
                            double *mask_mm, double *left, hada_context *context, hada_error *err);

/* out[k]: how many rows and columns depth k is off the place that the law of magnification gives it. The axis may be
 * anywhere, so this is the drift of the bead or the stage. Four depths or more. */
hada_status hada_psf_drift(double (*out)[2], const hada_psfs *psfs, hada_error *err);

/* How much two point spread functions of one size are alike, 0 to 1, where one of them is moved so that they are most
 * alike; *moved: by so many pixels. */
hada_status hada_psf_alike(double *alike, double *moved, const hada_image *one, const hada_image *other,
                           hada_error *err);

#endif
