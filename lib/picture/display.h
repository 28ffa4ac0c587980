/* Images as a stream of pictures for a display. Internal. */
#ifndef HADA_PICTURE_DISPLAY_H
#define HADA_PICTURE_DISPLAY_H

#include <hadalens/image.h>

#include "core/base.h"

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
