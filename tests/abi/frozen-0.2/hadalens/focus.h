/* Hadalens: from a stack of refocused planes to an all-in-focus image and a distance map.
 *
 * Each pixel takes the distance of the plane whose local measure is largest, refined between planes by a parabola
 * through its neighbours (in the index, that is, in 1/z), or NaN where no plane stands out from the noise.
 *
 * The measure `contrast` is the local mean of the squared response of an edge filter (Sobel; the idea: S. K. Nayar and
 * Y. Nakagawa, "Shape from focus", IEEE Trans. PAMI 16(8), 824 (1994)). It suits planes that each hold the whole scene,
 * sharp at its depth and blurred elsewhere, such as the results of linear filters.
 *
 * The measure `energy` is the local mean of the intensity. It suits planes that share out the light among the depths,
 * such as the refined, non-negative ones, where it finds the right depth of more pixels than contrast does. `combined`,
 * energy times the square root of contrast, is as good there, and better where too many depths compete
 * (docs/explanation/surfaces.md).
 *
 * The noise threshold comes from the data. Every pixel of every plane that is not the best at its pixel shows what the
 * measure of a wrong depth looks like. With the median m and the spread s (1.4826 times the median absolute deviation)
 * of these losers, and z the quantile of the normal distribution for `false_alarm` shared out among the competing
 * depths, a pixel is covered when its best measure is above m + z s, and more than z s above every depth that is not
 * next to the best. Besides, it must be above mean + z standard deviations of the measure of white noise of the planes'
 * own level (J. Immerkaer, "Fast noise variance estimation", Computer Vision and Image Understanding 64(2), 300 (1996),
 * by the median). Ties go to the nearer depth.
 *
 * Threads: no state, but a context is used; calls on one context may run at once. *all_in_focus and *distance_map are
 * the caller's: hada_image_destroy(). */
#ifndef HADALENS_FOCUS_H
#define HADALENS_FOCUS_H

#include <hadalens/device.h>
#include <hadalens/image.h>
#include <hadalens/status.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum hada_focus_measure {
    HADA_FOCUS_CONTRAST = 1,
    HADA_FOCUS_ENERGY = 2,
    HADA_FOCUS_COMBINED = 3
} hada_focus_measure;

/* How planes become one image. */
typedef enum hada_focus_fuse {
    HADA_FOCUS_WEIGHTED = 1, /* mean over depths weighted by the measure */
    HADA_FOCUS_SUM = 2       /* sum over depths: for planes that share out the light */
} hada_focus_fuse;

typedef struct hada_focus_options {
    size_t size; /* sizeof(hada_focus_options) */
    hada_focus_measure measure;
    hada_focus_fuse fuse;
    double window_sigma; /* of the Gaussian window of the local mean, pixels; 0.5 to 20 */
    double false_alarm;  /* chance that a pixel without an object is covered; above 0, below 0.5 */
} hada_focus_options;

/* For planes of linear filters: contrast, weighted mean; `shared` not 0: for planes that share out the light:
 * combined, sum. Window 2.5 pixels, false alarm 0.01. */
static inline void hada_focus_options_init(hada_focus_options *options, int shared)
{
    hada_struct_init(shared ? HADA_STRUCT_FOCUS_SHARED : HADA_STRUCT_FOCUS_OPTIONS, options, sizeof *options);
}

/* What the focus step found in the data. */
typedef struct hada_focus_report {
    size_t size;      /* sizeof(hada_focus_report), set by the caller */
    double noise;     /* standard deviation of the planes' noise (luminance) */
    double threshold; /* of the measure */
    double margin;    /* over the best depth that is not next to the best */
    double coverage;  /* share of pixels with a distance */
} hada_focus_report;

/* Focuses a stack on the host, plane by plane (device memory does not grow with the depths). `planes`: `depths` images
 * of the same channels (1 or 3) and size, near to far; distances in millimetres, rising; `competing`: one value a
 * depth, 0 leaves a depth out (NULL: all compete; at least one must). *all_in_focus (channels as the planes) and
 * *distance_map (one channel, millimetres or NaN) are created by the call; report may be NULL. `options` may be NULL:
 * those of linear filters. */
HADA_API hada_status hada_focus_stack(hada_context *context, const hada_image *planes, const double *distances_mm,
                                      int depths, const unsigned char *competing, const hada_focus_options *options,
                                      hada_image *all_in_focus, hada_image *distance_map, hada_focus_report *report,
                                      hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
