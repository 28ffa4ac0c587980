/* Pixels of callers as images. Internal. */
#ifndef HADA_IMAGE_PIXELS_H
#define HADA_IMAGE_PIXELS_H

#include <hadalens/pixels.h>

/* A caller's pixels, which may be of another version, taken over and checked. */
hada_status hada_pixels_take(hada_pixels *own, const hada_pixels *callers, hada_error *err);

/* The floats of checked pixels: pixels that are an image's already are looked at where they stand (*view, which owns
 * nothing); others are converted into *own, which has the memory of an earlier call or none. */
hada_status hada_pixels_view(const hada_pixels *pixels, hada_image *own, hada_image *view, hada_error *err);

#endif
