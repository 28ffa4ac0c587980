/* Corrections of a frame as its sensor gave it: pixels that are not finite, pixels that see more or less light than
 * others, or something else, and smooth light that is not the scene's. Internal. */
#ifndef HADA_IMAGE_CORRECT_H
#define HADA_IMAGE_CORRECT_H

#include "image/mosaic.h"
#include "image/pixels.h"

/* Replaces pixels that are not finite by the median of the finite pixels in the smallest square around them (up to
 * 15 x 15, else the plane's median; HADA_ERROR_NOT_FINITE where the plane has none), of the frame as it came. mosaic:
 * of one channel, pixels of the same place in the pattern count, in squares of these. *repaired: how many. */
hada_status hada_frame_repair(hada_image *frame, hada_mosaic mosaic, size_t *repaired, hada_error *err);

/* A dark frame of all channels: one channel is repeated, a mosaic's filled in as frames are. channels: of the frames;
 * 0: those of the dark frame. HADA_ERROR_NOT_FINITE; HADA_ERROR_SIZE where a mosaic has less than 2 x 2 pixels. */
hada_status hada_dark_of_sensor(hada_image *out, const hada_image *dark, int channels, hada_mosaic mosaic,
                                hada_error *err);

/* What each pixel makes of the same light, from a flat frame (an evenly lit sensor without optics, its dark level taken
 * off), over the mean of its colour: `channels` planes, which it has or, where it has one, which are alike; of a mosaic
 * of one channel filled in as frames are. 0: less than a twentieth of the mean, or not finite. The same again of what
 * this gives. HADA_ERROR_SIZE; HADA_ERROR_NUMERIC where the flat frame holds no light. */
hada_status hada_flat_sensitivity(hada_image *out, const hada_image *flat, int channels, hada_mosaic mosaic,
                                  hada_error *err);

/* A value as a pixel of the mean sensitivity would have it: what is above the dark level is divided. A pixel that sees
 * hardly any light stays as it is. */
static inline float hada_flat_value(float value, float sensitivity, double dark)
{
    return sensitivity > 0.0f ? (float)(dark + (value - dark) / sensitivity) : value;
}

/* All values of a frame; mosaic: of one channel. sensitivity: of all channels or one for all; levels: the dark level of
 * each channel; dark_frame: subtracted as well, [channel][row][col]; NULL: none. */
void hada_flat_apply(hada_image *frame, hada_mosaic mosaic, const hada_image *sensitivity, const double *levels,
                     const float *dark_frame);

/* Subtracts a dark frame of all channels. mosaic: of one channel. */
void hada_dark_subtract(hada_image *frame, hada_mosaic mosaic, const hada_image *dark);

/* Whether a flat or dark frame, or NULL, is of all channels and of the size of a frame. */
int hada_dark_fits(const hada_image *dark, const hada_image *frame, hada_mosaic mosaic);

/* Repairs the pixels of sensitivity 0, and those that are not finite. */
hada_status hada_flat_repair(hada_image *frame, hada_mosaic mosaic, const hada_image *sensitivity, hada_error *err);

/* Divides a frame by the flat frame, above the dark level `dark`; HADA_AUTO: above each channel's own, estimated.
 * Pixels that see hardly any light are repaired, unless the frame has values that are not finite, which stay.
 * HADA_ERROR_SIZE. */
hada_status hada_flat_correct(hada_image *frame, hada_mosaic mosaic, const hada_image *sensitivity, double dark,
                              hada_error *err);

/* Bad pixels of one frame: values that lie far beyond those around them of the same colour. A point of light is none
 * where the point spread function is as wide as a Gaussian with a standard deviation of 0.6 pixels. alone: 1: only
 * bright ones about which there is hardly any light, as there is about the sharpest spots. list: indices
 * [channel][row][col], ascending, for free(); *count 0, and no list, where there are none, too many, or (unless alone)
 * so few that noise is far stronger. */
hada_status hada_bad_pixels_find(const hada_pixels *frame, hada_mosaic mosaic, int alone, size_t **list, size_t *count,
                                 hada_error *err);

/* Smooth surfaces over a sensor: polynomials of the second order of each channel. */
enum { HADA_SMOOTH_TERMS = 6 };

/* Where a point lies that is `at` pixels from the border of `count` pixels: from -1 to 1. */
static inline double hada_smooth_place(double at, int count)
{
    return 2.0 * at / count - 1.0;
}

/* Term k, the constant first, at a place of the sensor. */
static inline double hada_smooth_term(int k, double y, double x)
{
    const double terms[HADA_SMOOTH_TERMS] = {1.0, y, x, y * y, x * x, y * x};
    return terms[k];
}

/* The mean of a surface of so many weights over the whole sensor. */
static inline double hada_smooth_mean(const double *weight)
{
    return weight[0] + (weight[3] + weight[4]) / 3.0;
}

/* The surface at a pixel of rows x cols. */
double hada_smooth_at(const double *weight, int row, int col, int rows, int cols);

/* Adds the surfaces of all channels, weight[channel][HADA_SMOOTH_TERMS], so many times to an image. */
void hada_smooth_add(const double *weight, double times, hada_image *image);

/* The surface that is nearest to a channel in least squares, all 0 on a sensor that is too small for one. Its energy.
 * known: pixels of 0 there do not count; NULL: all do. */
double hada_smooth_nearest(const float *channel, const float *known, int rows, int cols, double *weight);

#endif
