/* Linear intensities to pixels of a screen. Internal. */
#ifndef HADA_PICTURE_TONE_H
#define HADA_PICTURE_TONE_H

#include <hadalens/image.h>
#include <stdint.h>

#include "core/error.h"

/* The level below which 99.9 % of the finite values of `count` images lie (within 1 %); 1 where nothing is above 0. */
double hada_tone_white(const hada_image *images, int count);

/* The image as width * height pixels 0xRRGGBB of (value / white)^gamma; gamma not above 0: sRGB. Smaller sizes average
 * areas of the image, larger ones interpolate bilinearly. 3 channels are red, green, blue; other numbers are averaged
 * to grey. Values that are not finite count as 0. *pixels is freed with free(). */
hada_status hada_tone_pixels(uint32_t **pixels, int width, int height, const hada_image *image, double white,
                             double gamma, hada_error *err);

#endif
