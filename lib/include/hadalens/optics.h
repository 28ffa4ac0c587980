/* Hadalens: point spread functions by wave optics, and what a camera resolves by its point spread functions.
 *
 * Scalar waves, paraxial: the spherical wave of a point on the axis at distance z goes through the mask, each lens of
 * which turns its phase by its optical path, and on to the sensor by the Fresnel integral
 *     U(s) = integral T(q) exp(i pi |q|^2 / lambda z) exp(i pi |s - q|^2 / lambda d) dq;
 * a pixel collects |U|^2 over its square. J. W. Goodman, Introduction to Fourier Optics, 3rd ed. (2005), chapters 4, 5.
 * docs/optics.md tells how it is sampled and how exact it is.
 *
 * Threads: a hada_wave is used by one thread at a time. */
#ifndef HADALENS_OPTICS_H
#define HADALENS_OPTICS_H

#include <hadalens/camera.h>
#include <hadalens/device.h>
#include <hadalens/image.h>

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
                     far that it leaves the grid that is computed; 0: 0.002 */
} hada_wave_options;

HADA_API void hada_wave_options_init(hada_wave_options *options);

/* Makes PSFs of a camera by wave optics on a device. */
typedef struct hada_wave hada_wave;

/* The camera is copied. `options` NULL: the defaults. HADA_ERROR_UNSUPPORTED, with the size, where a mask needs finer
 * sampling than the device has memory for. */
HADA_API hada_status hada_wave_create(hada_wave **out, hada_context *context, const hada_camera *camera,
                                      const hada_wave_options *options, hada_error *err);
HADA_API void hada_wave_destroy(hada_wave **wave);

/* The PSF at a distance, on a grid of any size about the axis (the sensor's: camera->rows, camera->cols), with
 * camera->channels channels. In each channel all light of the mask sums to 1; what falls beyond the grid is missing.
 * Created by the call. */
HADA_API hada_status hada_wave_psf(hada_wave *wave, double distance_mm, int rows, int cols, hada_image *psf,
                                   hada_error *err);

/* The PSFs of all the camera's distances, by its `optics`: `psf` holds camera->depths images, created by the call, of
 * one channel (geometry) or camera->channels (wave): what hada_simulator_create_psf() takes. On failure all are empty.
 * Geometry needs no context (NULL). */
HADA_API hada_status hada_camera_psf_stack(hada_context *context, const hada_camera *camera, hada_image *psf,
                                           hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
