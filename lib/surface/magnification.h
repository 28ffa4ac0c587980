/* Optics between the depths of a camera: the law of magnification, measuring it, and transfer functions at any depth.
 * Internal. */
#ifndef HADA_SURFACE_MAGNIFICATION_H
#define HADA_SURFACE_MAGNIFICATION_H

#include "fft/fft.h"

/* How the point spread functions of a camera's depths become one another, found from themselves. Internal.
 *
 * Light that a mask casts from a point at distance z is the mask's pattern magnified by 1 + a/z about the optical axis,
 * a the distance from mask to sensor: PSFs of neighbouring depths are magnified to the depth in between and then
 * blended (docs/explanation/surfaces.md). The law's a, and the axis' place, are those that make neighbours correlate
 * best. Where waves or other optics spoil the law, each pair of neighbours may have a magnification of its own, or
 * none. */

typedef enum hada_magnification_kind {
    HADA_MAGNIFICATION_NONE = 0, /* PSFs are blended as they are */
    HADA_MAGNIFICATION_LAW = 1,  /* 1 + a/z */
    HADA_MAGNIFICATION_FREE = 2, /* from pair to pair */
    HADA_MAGNIFICATION_KINDS = 3
} hada_magnification_kind;

/* The PSF of depth k is 1/scale^2 g((x - place) / scale) of one pattern g, x in pixels from the grid's origin. */
typedef struct hada_magnified {
    double scale, row, col;
} hada_magnified;

typedef struct hada_magnification {
    hada_magnification_kind kind;
    int depths;
    double *inverse;       /* [depths] 1 / distance, falling */
    hada_magnified *depth; /* [depths] */
    double mask;           /* a, in the unit of the distances; the law's, also where another kind was chosen */
    double row, col;       /* the law's: pixels that the pattern moves, times distance: 0 where the grid's origin is the
                              optical axis */
    double edge;           /* radius in pixels within which 0.9 of the PSFs' energy lies */
    double spread;         /* root of the mean square of that radius' light's distance from the origin */
    double shift;          /* largest, of light at the edge, between neighbours, in pixels */
    double unexplained[HADA_MAGNIFICATION_KINDS]; /* |difference| / |PSF| at its brightest pixels when each depth is
                                                     predicted from its two neighbours (two depths: from the other one);
                                                     noise of the PSFs included. Between depths as they stand it is
                                                     less: about a quarter of what is not noise. */
} hada_magnification;

/* From spline coefficients (spline.h) of the PSFs, [depths][rows][cols], origin at pixel (0, 0). Distances rise. */
hada_status hada_magnification_fit(hada_magnification *out, int depths, const double *distances,
                                   const float *coefficients, int rows, int cols, hada_error *err);
void hada_magnification_free(hada_magnification *magnification);

/* At a depth between two, counted in depths; between them all is linear in 1 / distance, and it goes on so beyond the
 * first and the last. */
hada_magnified hada_magnification_at(const hada_magnification *magnification, double depth);

/* What makes the PSF `from` the PSF `to`: to(x) = 1/scale^2 from((x - place) / scale). */
hada_magnified hada_magnified_between(const hada_magnified *from, const hada_magnified *to);

/* How far light at this radius moves from a depth to the next, in pixels, k < depths - 1. Where there is no law, as
 * much as a pattern of spots of a pixel would have to move to change by what one depth leaves unexplained of the next.
 */
double hada_magnification_shift(const hada_magnification *magnification, int k, double radius);

/* How far beyond the nearest or the farthest depth, in depths, the law says what point spread functions are: one, or
 * less where that would be beyond infinity; 0 where no law holds. */
double hada_magnification_beyond(const hada_magnification *magnification, int far);

/* Steps from a depth to the next so that light at the edge moves by at most `pixels` a step. */
int hada_magnification_steps(const hada_magnification *magnification, double pixels);

/* The law of magnification of a camera whose transfer functions are on a device. Internal. */

/* The transfer functions of depths that follow one another: [depth][channel][count] complex, in the layout of
 * hada_fft_layout(context, rows, cols, AUTO), `first` images of count into the buffer. */
typedef struct hada_surface_camera {
    int rows, cols, channels, depths; /* of the grid: at least 8 x 8 */
    cl_mem otf;
    size_t first;
} hada_surface_camera;

/* Finds it from the mean of the channels, on the grid or, where that is large, on a coarser one; in pixels of the
 * grid either way. */
hada_status hada_magnification_measure(hada_magnification *out, hada_slot *slot, const hada_surface_camera *camera,
                                       const double *distances, hada_error *err);

/* The layout of a grid of half spectra that the library's tables make of this size. */
hada_spectrum_layout hada_surface_layout(const hada_context *context, int rows, int cols);

/* 1 / the gains of a spline at every frequency of a layout, as complex numbers. */
hada_status hada_surface_prefilter(hada_buffer *out, hada_slot *slot, const hada_spectrum_layout *layout,
                                   hada_error *err);

/* `images` spectra, each `factor` times the mean of `channels` of those that are read, for a coarser grid. tapers:
 * times that a Gaussian window over the frequencies is applied, 1/2 at the coarse grid's last. Offsets in complex
 * numbers. */
hada_status hada_surface_crop(hada_slot *slot, cl_mem in, size_t in_offset, const hada_spectrum_layout *from,
                              int images, int channels, double factor, double tapers, cl_mem out, size_t out_offset,
                              const hada_spectrum_layout *to, hada_error *err);

/* Transfer functions of depths between those of a camera: PSFs of its depths magnified to the depth in between
 * (magnification.h), blended, and transformed again. Internal.
 *
 * They are made on demand, for any depth counted in depths of the camera; neighbouring depths one after the other cost
 * the least. An object belongs to one slot. Same bits whatever was made before. */

typedef struct hada_between hada_between;

/* `camera` and `magnification` are copied but for the buffer and the arrays they refer to, which must stay. */
hada_status hada_between_create(hada_between **out, hada_slot *slot, const hada_surface_camera *camera,
                                const hada_magnification *magnification, hada_error *err);
void hada_between_destroy(hada_between **between);

/* The transfer functions of `count` depths, from hada_magnification_beyond() before the first to that behind the last,
 * where the nearest PSF is magnified alone: [count][channel][to->count] complex, from
 * `first` images of to->count on. to: the layout of a coarser grid, whose Nyquist row and column are 0; NULL: the
 * camera's. Enqueued. */
hada_status hada_between_make(hada_between *between, int count, const double *depth, cl_mem out, size_t first,
                              const hada_spectrum_layout *to, hada_error *err);

#endif
