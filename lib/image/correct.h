/* Corrections of a frame as its sensor gave it: pixels that are not finite, and pixels that see more or less light than
 * others. Internal. */
#ifndef HADA_IMAGE_CORRECT_H
#define HADA_IMAGE_CORRECT_H

#include "image/mosaic.h"

/* Replaces pixels that are not finite by the median of the finite pixels in the smallest square around them (up to
 * 15 x 15, else the plane's median, else 0), of the frame as it came. mosaic: of one channel, pixels of the same place
 * in the pattern count, in squares of these. *repaired: how many. */
hada_status hada_frame_repair(hada_image *frame, hada_mosaic mosaic, size_t *repaired, hada_error *err);

/* What each pixel makes of the same light, from a flat frame (an evenly lit sensor without optics) above its dark
 * level, over the mean of its colour: [channels][rows][cols], which it has or, where it has one channel, which are
 * alike; of a mosaic of one channel filled in as frames are. 0: less than a twentieth of the mean, or not finite;
 * *unlit: how many. `dark`: subtracted from the flat frame, as `dark_frame` is, which may be NULL and has as many
 * channels as the result. HADA_ERROR_SIZE, HADA_ERROR_ARGUMENT where a flat frame is not brighter than its dark level.
 */
hada_status hada_flat_sensitivity(hada_image *out, const hada_image *flat, int channels, hada_mosaic mosaic,
                                  double dark, const float *dark_frame, size_t *unlit, hada_error *err);

/* The values of a row of pixels as if all were equally sensitive: what is above the dark level is divided; a pixel that
 * is hardly lit stays. dark_frame: subtracted as well; NULL: none. */
void hada_flat_divide(float *values, const float *sensitivity, size_t count, double dark, const float *dark_frame);

#endif
