/* Linear intensities to pixels of a screen. Internal. */
#ifndef HADA_IO_TONE_H
#define HADA_IO_TONE_H

#include <hadalens/image.h>

#include "io/canvas.h"

/* The level below which 99.9 % of the finite values of `count` images lie (within 1 %); 1 where nothing is above 0. */
double hada_tone_white(const hada_image *images, int count);

/* Draws the image into a rectangle of the canvas as (value / white)^gamma. Smaller rectangles average areas of the
 * image, larger ones interpolate bilinearly. 3 channels are red, green, blue; other numbers are averaged to grey.
 * Values that are not finite count as 0. */
hada_status hada_tone_draw(hada_canvas *canvas, int x, int y, int width, int height, const hada_image *image,
                           double white, double gamma, hada_error *err);

#endif
