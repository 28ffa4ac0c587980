/* Linear intensities to pixels of a screen. Internal. */
#ifndef HADA_PICTURE_TONE_H
#define HADA_PICTURE_TONE_H

#include <hadalens/image.h>

/* The level below which 99.9 % of the finite values of `count` images lie (within 1 %); 1 where nothing is above 0. */
double hada_tone_white(const hada_image *images, int count);

/* The image as width * height pixels 0xRRGGBB of (value / white)^gamma; gamma not above 0: sRGB. Smaller sizes average
 * areas of the image, larger ones interpolate bilinearly. 3 channels are red, green, blue; other numbers are averaged
 * to grey. Values that are not finite count as 0. *pixels is freed with free(). */
hada_status hada_tone_pixels(uint32_t **pixels, int width, int height, const hada_image *image, double white,
                             double gamma, hada_error *err);

/* Colours for distances. Internal. */

/* The colour at 0 (dark purple) to 1 (light yellow) as 0xRRGGBB.
 *
 * A helix in Oklab (B. Ottosson, "A perceptual color space for image processing", 2020): lightness rises evenly from
 * 0.32 (visible on a dark sheet) to 0.93 while the hue turns evenly from 360 to 100 degrees at the chroma 0.115. All
 * change at constant speed, so equal steps in distance are equal steps in colour, and also in grey. It is the longest
 * such helix inside sRGB on a grid of 5 degrees and 0.005 of chroma. */
uint32_t hada_colormap(double at);

/* Images as a stream of pictures for a display. */

typedef struct hada_display {
    int jpeg;     /* 1: JPEG pictures; 0: bytes red, green, blue */
    double white; /* that pictures are shown with; 0: none was shown yet */
    void *jpegs;  /* the encoder's */
    unsigned char *bytes;
    size_t room; /* bytes that are allocated */
} hada_display;

/* Shows linear light in sRGB, or light^gamma if gamma is above 0. White follows the images' 99.9th percentile by a
 * quarter of the difference with each image. *bytes: the picture, which stays until the next call. */
hada_status hada_display_draw(hada_display *display, const hada_image *image, double gamma, const unsigned char **bytes,
                              size_t *count, hada_error *err);
void hada_display_end(hada_display *display);

#endif
