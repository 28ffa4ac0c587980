/* Pixels in the form in which callers, cameras and files have them. Internal. */
#ifndef HADA_IMAGE_PIXELS_H
#define HADA_IMAGE_PIXELS_H

#include <hadalens/pixels.h>

#include "kernels/shared_pixels.h"

/* A copy of the caller's description, which may be of another version, checked. */
hada_status hada_pixels_take(hada_pixels *own, const hada_pixels *callers, hada_error *err);

/* 1: floats, planar and without gaps, as in an image. */
int hada_pixels_is_image(const hada_pixels *pixels);

/* Pixels first ... first + count - 1 of a channel, counted row by row, as floats: where they are if the pixels are an
 * image, else converted into `room` (count floats). */
const float *hada_pixels_floats(const hada_pixels *pixels, int channel, size_t first, size_t count, float *room);

/* An image of checked pixels; created by the call. */
hada_status hada_pixels_copy(const hada_pixels *pixels, hada_image *image, hada_error *err);

/* The memory that holds all samples, from the lowest address on, and where they are in it. */
typedef struct hada_stored {
    const void *data;
    size_t bytes;
    int dense; /* 1: planar and without gaps */
    hada_stored_form form;
} hada_stored;
hada_stored hada_pixels_stored(const hada_pixels *pixels);

/* 1: the device makes the same floats of these samples as the host does, from no more bytes than the floats have. Whole
 * numbers need a whole scale up to 65535: kernels/filter_unpack.cl was held against the host for all of these. */
int hada_pixels_uploads(const hada_pixels *pixels);

/* Creates the image where it is empty or has another shape; what it held is undefined then. */
hada_status hada_image_ensure(hada_image *image, int channels, int rows, int cols, hada_error *err);

/* An image magnified about its axis, pixel (rows / 2, cols / 2), and moved by row and col: out(x) = image((x - place) /
 * scale) / scale^2 with x from either's axis. The light stays. Created by the call. */
hada_status hada_image_magnify(hada_image *out, const hada_image *image, double scale, double row, double col, int rows,
                               int cols, hada_error *err);

/* A copy with so many channels: those of the image, or each as its only one. */
hada_status hada_image_repeat(hada_image *out, const hada_image *image, int channels, hada_error *err);

/* hada_image_downsample() in place. */
hada_status hada_image_bin(hada_image *image, int factor, hada_mosaic mosaic, int keep_saturated, hada_error *err);

/* The largest value; 0 where none is above 0. */
float hada_image_brightest(const hada_image *image);

/* A copy; what *out held before is not freed. */
hada_status hada_image_copy(hada_image *out, const hada_image *image, hada_error *err);

#endif
