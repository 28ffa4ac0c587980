/* Hadalens: point spread functions by wave optics, and what a camera resolves by its point spread functions.
 *
 * Scalar waves, paraxial: the spherical wave of a point on the axis at distance z goes through the mask, each lens of
 * which turns its phase by its optical path, and on to the sensor by the Fresnel integral
 *     U(s) = integral T(q) exp(i pi |q|^2 / lambda z) exp(i pi |s - q|^2 / lambda d) dq;
 * a pixel collects |U|^2 over its square. J. W. Goodman, Introduction to Fourier Optics, 3rd ed. (2005), chapters 4, 5.
 * docs/explanation/simulation.md tells how it is sampled and how exact it is.
 *
 * Threads: a hada_wave is used by one thread at a time. */
#ifndef HADALENS_OPTICS_H
#define HADALENS_OPTICS_H

#include <hadalens/camera.h>
#include <hadalens/device.h>
#include <hadalens/image.h>
#include <hadalens/monitor.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hada_wave_options {
    size_t size; /* sizeof(hada_wave_options) */
    /* Masks of lenses or round holes: 0 (default): every lens alone, and their intensities added. That leaves out how
     * spots of different lenses interfere where they overlap: fringes of period lambda d / distance of the lenses,
     * which pixels wider than that average out, as does the bandwidth of a colour. 1: all light of the mask together,
     * as always for other masks; takes far more memory. */
    int coherent;
    double stray; /* about the share of light that may be left out, scattered at the edges of lenses or openings so
                     far that it leaves the grid that is computed; HADA_AUTO (default): 0.002 */
    const hada_monitor *monitor; /* asked several times a second whether to stop (then HADA_ERROR_CANCELLED); it must
                                    last as long as the hada_wave. NULL (default): nobody */
} hada_wave_options;

HADA_INIT(hada_wave_options, HADA_STRUCT_WAVE_OPTIONS)

/* Makes PSFs of a camera by wave optics on a device. */
typedef struct hada_wave hada_wave;

/* The camera is copied. `options` NULL: the defaults. HADA_ERROR_UNSUPPORTED, with the size, where a mask needs finer
 * sampling than the device has memory for. A mask that is computed as a whole keeps its samples and transforms on the
 * device from one PSF to the next, until the object is destroyed. */
HADA_API hada_status hada_wave_create(hada_wave **out, hada_context *context, const hada_camera *camera,
                                      const hada_wave_options *options, hada_error *err);
HADA_API void hada_wave_destroy(hada_wave **wave);

/* The PSF at a distance, on a grid of any size about the axis (the sensor's: camera->rows, camera->cols), with
 * camera->channels channels. In each channel all light of the mask sums to 1; what falls beyond the grid is missing.
 * Created by the call. */
HADA_API hada_status hada_wave_psf(hada_wave *wave, double distance_mm, int rows, int cols, hada_image *psf,
                                   hada_error *err);

/* The PSFs of all the camera's distances, by its `optics`: `psf` holds camera->depths images, created by the call, of
 * one channel (geometry) or camera->channels (wave): what hada_simulator_options takes. On failure all are empty.
 * Geometry needs no context (NULL). */
HADA_API hada_status hada_camera_psf_stack(hada_context *context, const hada_camera *camera, hada_image *psf,
                                           hada_error *err);

/* What a camera resolves at a distance, by its design and by its PSF. Lateral lengths on the sensor are in pixels,
 * which are those of the scene as well; times pitch z / d they are millimetres at the object. NaN: does not apply. */
typedef struct hada_optics_row {
    double distance_mm;
    double magnification;   /* 1 + d/z: how much wider than the mask the pattern stands on the sensor */
    double defocus_pixels;  /* diameter of a lens's blur by geometry: D |1 + d/z - d/f|, in green light */
    double airy_pixels;     /* radius of the Airy disc of a lens of diameter D in green: 1.22 lambda d / D */
    double object_pixel_mm; /* what a pixel is at the object: pitch z / d */
    double light;           /* share of the mask's light in the PSF's image */
    double spot_pixels;     /* full width at half maximum of the self-correlation's peak, over sqrt(2): of a spot */
    double sidelobe;        /* highest self-correlation beyond the peak (twice its full width), relative to it */
    double cutoff;          /* cycles per pixel: above, the mean MTF of a ring stays below the threshold */
    double support;         /* share of all frequencies whose MTF reaches the threshold */
    double lateral_mm;      /* spot_pixels at the object */
    double axial_mm;        /* towards farther distances (the last: nearer): where PSFs correlate by one half,
                               interpolated in 1/z between the distances of the stack */
    double axial_design_mm; /* by design: the distance step that moves a spot at the edge of the aperture by its width:
                               z^2 spot pitch / (d aperture / 2) */
    double occupancy; /* V = N R M^2: N lenses or holes, R the area of an object over that of the sensor, M = d/z its
                         scale on the sensor: how often its images cover the sensor. The object fills the window
                         at the nearest distance */
} hada_optics_row;

/* Makes a report on a camera as its PSFs are added, from near to far. Created and destroyed by the caller; NULL is fine
 * to destroy. Destroyed before the context is, where not all PSFs were added. */
typedef struct hada_optics_report hada_optics_report;

/* `threshold` HADA_AUTO: 0.05. */
HADA_API hada_status hada_optics_report_create(hada_optics_report **out, hada_context *context,
                                               const hada_camera *camera, double threshold, hada_error *err);
HADA_API void hada_optics_report_destroy(hada_optics_report **report);
/* The PSF of the next depth, of sensor size, designed or measured; the mean of its channels counts. */
HADA_API hada_status hada_optics_report_add(hada_optics_report *report, const hada_image *psf, hada_error *err);

/* What was found, filled as PSFs are added. Both belong to the report; later versions may add members at the end. */
typedef struct hada_optics_curves {
    int depths, frequencies, lags;
    double threshold;          /* of the MTF, for cutoff and support */
    const double *mtf;         /* [depth][frequency]: mean of |OTF| over a ring about (i + 0.5) / (2 frequencies) cycles
                                  per pixel; 1 at 0 */
    const double *self;        /* [depth][lag]: largest self-correlation of the PSF at that many pixels; 1 at 0 */
    const double *correlation; /* [depth][depth]: of PSFs, <a, b> / (|a| |b|) */
} hada_optics_curves;
HADA_API const hada_optics_curves *hada_optics_report_curves(const hada_optics_report *report);
HADA_API const hada_optics_row *hada_optics_report_row(const hada_optics_report *report, int depth);

#ifdef __cplusplus
}
#endif
#endif
