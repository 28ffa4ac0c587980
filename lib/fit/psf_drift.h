/* How far the point spread functions of a stack wander from depth to depth. Internal. */
#ifndef HADA_FIT_PSF_DRIFT_H
#define HADA_FIT_PSF_DRIFT_H

#include "fit/psf_depths.h"

/* out[k]: how many rows and columns depth k is off the place that the law of magnification gives it. The axis may be
 * anywhere, so this is the drift of the bead or the stage. Four depths or more. */
hada_status hada_psf_drift(double (*out)[2], const hada_psfs *psfs, hada_error *err);

/* How much two point spread functions of one size are alike, 0 to 1, where one of them is moved so that they are most
 * alike; *moved: by so many pixels. */
hada_status hada_psf_alike(double *alike, double *moved, const hada_image *one, const hada_image *other,
                           hada_error *err);

#endif
