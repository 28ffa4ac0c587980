/* Repairing a raw frame. Internal. */
#ifndef HADA_ENGINE_REPAIR_H
#define HADA_ENGINE_REPAIR_H

#include <hadalens/image.h>

#include "core/error.h"

/* Whether single precision holds a frame whose brightest pixel has the size `largest`, its spectrum on a grid of
 * `points` points and the squares of both: sizes from 2^-40 to 2^63 / points do. HADA_ERROR_NUMERIC. */
hada_status hada_frame_check_range(float largest, double points, hada_error *err);

/* Replaces NaN and infinite pixels of a plane by the median of the finite pixels in the smallest square around them (up
 * to 15 x 15, else the plane's median, else 0), judged on the frame as it came. Returns how many. */
hada_status hada_frame_repair(hada_image *frame, size_t *repaired, hada_error *err);

#endif
