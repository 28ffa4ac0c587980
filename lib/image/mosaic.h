/* Colour filter mosaics: frames of one channel whose pixels hold one colour each. Internal. */
#ifndef HADA_IMAGE_MOSAIC_H
#define HADA_IMAGE_MOSAIC_H

#include "image/pixels.h"

/* Colours of a mosaic: red, green, blue. */
enum { HADA_MOSAIC_COLOURS = 3 };

/* Whether a value names a pattern, and one that options may have: a pattern, none or auto. */
static inline int hada_mosaic_is_pattern(int mosaic)
{
    return mosaic >= HADA_MOSAIC_RGGB && mosaic <= HADA_MOSAIC_GBRG;
}
static inline int hada_mosaic_is_known(int mosaic)
{
    return mosaic == HADA_MOSAIC_AUTO || mosaic == HADA_MOSAIC_NONE || hada_mosaic_is_pattern(mosaic);
}

/* What a message adds where a frame of one channel comes with a scene in colour. */
static inline const char *hada_mosaic_hint(int frame, int scene)
{
    return frame == 1 && scene == HADA_MOSAIC_COLOURS
               ? "; if the sensor has a colour filter mosaic, name its pattern with options.mosaic"
               : "";
}

/* The channel of the colour that a pixel holds. */
int hada_mosaic_channel(hada_mosaic mosaic, int row, int col);

/* The three colours of a mosaic of `rows` x `cols` values, 2 x 2 or more, [channel][row][col]: the colour that a pixel
 * lacks is the mean of those pixels of the 3 x 3 around it that hold it (bilinear interpolation). */
void hada_mosaic_fill(hada_mosaic mosaic, const float *values, int rows, int cols, float *colours);

/* The same for an image of one channel, which becomes one of three, created by the call. */
hada_status hada_mosaic_colours(hada_mosaic mosaic, const hada_image *frame, hada_image *colours, hada_error *err);

/* Of images of three channels, the values that a mosaic holds: `values` has the size of a channel. */
void hada_mosaic_take(hada_mosaic mosaic, const float *colours, int rows, int cols, float *values);

/* The values of a channel's own pixels, one after the other, from an image of `rows` x `cols` of that channel, or of
 * the mosaic; `values` may be the image. Returns how many. */
size_t hada_mosaic_own(hada_mosaic mosaic, int channel, const float *image, int rows, int cols, float *values);

/* *count values of a channel: its plane or, of a mosaic of one channel, its own pixels, put into `room`, which holds a
 * value per pixel then. */
const float *hada_mosaic_channel_values(hada_mosaic mosaic, int channel, const hada_image *image, float *room,
                                        size_t *count);

#endif
