/* Hadalens: yardsticks for images and distance maps.
 *
 * All are computed on the host in double precision. Images to compare must have the same channels, rows and columns
 * (HADA_ERROR_SIZE otherwise). Values over several channels are the mean of the channels' values (PSNR: of the mean
 * squared error). A mask, where given, holds rows * cols values; pixels with 0 are left out; NULL: all pixels count.
 * Pixels that are not finite are an error (HADA_ERROR_NOT_FINITE) except in distance maps, where NaN means "nothing in
 * focus here".
 *
 * To compare within a window, crop both images (hada_image_crop() of scene.h): structural similarity and gradients
 * then see nothing outside it. A mask chooses pixels and leaves their neighbours in sight. LPIPS has a header of its
 * own, lpips.h.
 *
 * Thread-safe: no state. */
#ifndef HADALENS_METRICS_H
#define HADALENS_METRICS_H

#include <hadalens/image.h>
#include <hadalens/status.h>

#ifdef __cplusplus
extern "C" {
#endif

/* How two images are compared. */
typedef enum hada_metric {
    HADA_METRIC_MSE = 1, /* mean of squared differences, over pixels and channels */
    HADA_METRIC_MAE = 2, /* mean of absolute differences */

    /* 10 log10(peak^2 / mse) in dB; infinite for equal images */
    HADA_METRIC_PSNR = 3,

    /* Structural similarity, Wang, Bovik, Sheikh, Simoncelli, IEEE Trans. Image Processing 13(4), 600 (2004): Gaussian
     * window of 11 x 11 with standard deviation 1.5, K1 = 0.01, K2 = 0.03, population statistics; the mean is taken
     * where the window lies inside the image (5 pixels from the edges), as scikit-image's structural_similarity(...,
     * gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=peak) does. The image must be at least
     * 11 x 11. With a mask, the mean is over the masked pixels of that inner part; their windows still see all pixels.
     */
    HADA_METRIC_SSIM = 4,

    /* What the code that belongs to F. Tian and W. Yang, Optics Express 30(19), 34479 (2022) calls PSNR and SSIM, for
     * comparing with its figures. PSNR: at each pixel the squared error is averaged over the channels and turned into
     * 10 ln(peak^2 / error) / 2.303 dB; the mean of these over the pixels is taken. It lies above the true PSNR (the
     * mean of a logarithm), by more the more the errors differ from pixel to pixel, and is infinite as soon as one
     * pixel is exact. 2.303 approximates ln 10: 0.02 % below decibels. SSIM: structural similarity as above with a data
     * range of 2 peak where the images span one: the constants are four times as large, so the value lies nearer to 1.
     */
    HADA_METRIC_AUTHORS_PSNR = 5,
    HADA_METRIC_AUTHORS_SSIM = 6
} hada_metric;

/* Compares two images. `peak` is the largest value that could occur (1 for images that were read from integer files);
 * the mean differences do not use it. `mask` may be NULL. */
HADA_API hada_status hada_metric_compare(hada_metric metric, const hada_image *a, const hada_image *b, double peak,
                                         const unsigned char *mask, double *out, hada_error *err);

/* Sharpness of one image: the mean magnitude of the gradient, by central differences inside and one-sided ones at the
 * edges (NumPy's gradient). In intensity per pixel. */
HADA_API hada_status hada_metric_sharpness(const hada_image *image, const unsigned char *mask, double *out,
                                           hada_error *err);

/* How good a distance map is. */
typedef struct hada_depth_score {
    size_t size;          /* sizeof(hada_depth_score), set by the caller */
    double coverage;      /* share of the pixels with a true distance that the map covers (is not NaN at) */
    double within;        /* share of the covered pixels that are within the tolerance */
    double mean_error_mm; /* mean absolute error over the covered pixels; NaN when none is */
    double mean_steps;    /* the same in depth steps; NaN when no list was given */
    long long pixels;     /* with a true distance, in the mask */
} hada_depth_score;

/* Compares a distance map with the truth (both one channel, millimetres; NaN in the truth: no object there, left
 * out). With a list of distances (near to far, at least two), errors are measured in steps of that list, as
 * differences of the fractional index interpolated in 1/z, and `tolerance` is in steps (0.5: half a depth step).
 * Without a list (NULL, 0), `tolerance` is in millimetres. */
HADA_API hada_status hada_metric_depth(const hada_image *map, const hada_image *truth, const double *distances_mm,
                                       int count, double tolerance, const unsigned char *mask, hada_depth_score *out,
                                       hada_error *err);

/* What kind of place a pixel of a true distance map is. */
typedef enum hada_depth_part {
    HADA_DEPTH_NONE = 0,   /* no true distance */
    HADA_DEPTH_AWAY = 1,   /* a smooth place */
    HADA_DEPTH_JUMP = 2,   /* at a jump */
    HADA_DEPTH_OUTSIDE = 3 /* more than half a step beyond the nearest or the farthest distance of the list */
} hada_depth_part;

/* Parts the pixels of a true map: parts[i] is a hada_depth_part; rows * cols values. A jump is where two neighbours
 * differ by more than `jump_steps` (HADA_AUTO: 0.5) steps of the list; the `reach_pixels` (HADA_AUTO: 3) pixels on
 * either side of it are at it. */
HADA_API hada_status hada_metric_depth_parts(const hada_image *truth, const double *distances_mm, int count,
                                             double jump_steps, int reach_pixels, unsigned char *parts,
                                             hada_error *err);

/* Where two surfaces are seen through each other: *truth becomes the one of the two true distances that is nearer to
 * the map's (in steps of the list; NULL, 0: in millimetres). NaN: no second surface, or nothing known. */
HADA_API hada_status hada_metric_depth_nearer(hada_image *truth, const hada_image *second, const hada_image *map,
                                              const double *distances_mm, int count, hada_error *err);

/* Whether a map knows where it is wrong. */
typedef struct hada_confidence_score {
    size_t size;       /* sizeof(hada_confidence_score), set by the caller */
    double half_error; /* mean absolute error of the more confident half of the pixels */
    double risk;       /* the mean over all shares of the most confident pixels of their mean error: the area under the
                          curve of risk against coverage (El-Yaniv and Wiener, JMLR 11, 1605 (2010)) */
    long long pixels;  /* that are known in all three images; with none, both are NaN */
} hada_confidence_score;

/* Errors in steps of the list, in millimetres without one. A higher value of `confidence` is more confident; equal ones
 * count as being in any order. */
HADA_API hada_status hada_metric_depth_confidence(const hada_image *map, const hada_image *truth,
                                                  const hada_image *confidence, const double *distances_mm, int count,
                                                  const unsigned char *mask, hada_confidence_score *out,
                                                  hada_error *err);

/* The fractional index of a distance in a list (near to far), linear in 1/z between neighbours and beyond the ends.
 * A list of one gives 0. */
HADA_API double hada_depth_index(const double *distances_mm, int count, double distance_mm);

/* The distance of a fractional index: the inverse of hada_depth_index. */
HADA_API double hada_depth_distance(const double *distances_mm, int count, double index);

#ifdef __cplusplus
}
#endif
#endif
