/* Hadalens: images on the host.
 *
 * float32, planar: data[(channel * rows + row) * cols + col]. Linear intensity. Integer files are
 * divided by their full scale (255, 65535, 4294967295); float files are taken as they are.
 *
 * Functions that make an image ("created by the call") do not free what *out held: destroy that first. It is not one of
 * the images that they read (HADA_ERROR_ARGUMENT).
 *
 * Threads: images are plain values; any number of threads may read one. */
#ifndef HADALENS_IMAGE_H
#define HADALENS_IMAGE_H

#include <hadalens/status.h>
#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hada_image {
    int channels, rows, cols;
    float *data; /* owned; NULL when empty */
} hada_image;

/* Allocates a zeroed image. On failure *image is empty. */
HADA_API hada_status hada_image_create(hada_image *image, int channels, int rows, int cols, hada_error *err);

/* Frees the pixels and empties the image; an empty image is fine. */
HADA_API void hada_image_destroy(hada_image *image);

/* Number of values: channels * rows * cols. */
static inline size_t hada_image_count(const hada_image *image)
{
    return (size_t)image->channels * (size_t)image->rows * (size_t)image->cols;
}

/* Colour filter mosaics (C. E. Bayer, US patent 3,971,065): frames of one channel whose pixels hold one colour each.
 * The names are the colours of the first two rows and columns, row by row. */
typedef enum hada_mosaic {
    HADA_MOSAIC_AUTO = -1, /* in options only: what the model or the file says */
    HADA_MOSAIC_NONE = 0,
    HADA_MOSAIC_RGGB = 1,
    HADA_MOSAIC_BGGR = 2,
    HADA_MOSAIC_GRBG = 3,
    HADA_MOSAIC_GBRG = 4
} hada_mosaic;

/* Binning: each pixel of *out, created by the call, is the mean of factor x factor pixels; rows and columns that fill
 * no bin are left out. mosaic: of an image of one channel; the three channels are means of the pixels that hold each
 * colour, and the factor is even. keep_saturated: 1, for raw frames: where values of a channel are cut off at its
 * largest one, bins that hold such a value get it, so that they are still known to be saturated; 0: means alone. */
HADA_API hada_status hada_image_downsample(hada_image *out, const hada_image *image, int factor, hada_mosaic mosaic,
                                           int keep_saturated, hada_error *err);

/* One frame, created by the call, of `count` exposures of the same scene (2 or more, in any order, linear in light, of
 * one size; a mosaic of one channel by its pattern). Values are in the units of the shortest exposure, its dark level
 * with them. An exposure counts by the square of its length at pixels that it does not saturate; one that all saturate
 * stays so. weights (may be NULL; created by the call): the length of the exposures that each value is made of, over
 * that of all: noise is lower where it is larger. A plan takes it as its pixel_weights; if that finds the weight of
 * total variation from the frame, the fourth root of it is better (perf/results/weights.md). dark (may be NULL): what a
 * pixel without light reads, by what the exposures have in common. scales (may be NULL): how many times the shortest
 * each exposure is, found from the frames themselves by orthogonal regression (W. E. Deming, Statistical Adjustment of
 * Data, 1943). HADA_ERROR_NUMERIC where two of them show different scenes, or share too few pixels that neither
 * saturates. */
HADA_API hada_status hada_image_merge_exposures(hada_image *out, hada_image *weights, const hada_image *frames,
                                                int count, hada_mosaic mosaic, double *scales, double *dark,
                                                hada_error *err);

/* Number of NaN and infinite values. */
HADA_API size_t hada_image_count_not_finite(const hada_image *image);

#ifdef __cplusplus
}
#endif
#endif
