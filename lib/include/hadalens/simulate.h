/* Hadalens: raw frames of a camera by simulation, on a device: b = sum_z PSF_z * x_z + noise.
 *
 * Threads: a simulator is used by one thread at a time. */
#ifndef HADALENS_SIMULATE_H
#define HADALENS_SIMULATE_H

#include <hadalens/camera.h>
#include <hadalens/device.h>
#include <hadalens/image.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Renders raw frames of a camera on a device. Transfer functions are made at first use of each depth and kept. */
typedef struct hada_simulator hada_simulator;

/* The camera is copied. */
HADA_API hada_status hada_simulator_create(hada_simulator **out, hada_context *context, const hada_camera *camera,
                                           hada_error *err);
/* As hada_simulator_create, with measured or designed PSFs instead of the geometry: `psf` holds camera->depths images
 * of sensor size, of one channel or of camera->channels. Used as they are, without normalisation. */
HADA_API hada_status hada_simulator_create_psf(hada_simulator **out, hada_context *context, const hada_camera *camera,
                                               const hada_image *psf, hada_error *err);
HADA_API void hada_simulator_destroy(hada_simulator **simulator);
HADA_API const hada_camera *hada_simulator_camera(const hada_simulator *simulator);

/* A scene's part at one depth. */
typedef struct hada_plane {
    int depth;               /* index into the camera's distances */
    const hada_image *image; /* of window or of sensor size, camera->channels channels or one (grey) */
} hada_plane;

/* Renders the frame of a scene of `count` planes (depths may repeat; they add up) into *raw, created by the call, of
 * sensor size and camera->channels. Noise: Gaussian with standard deviation `noise` times the maximum of the
 * noise-free frame, from `noise_seed`; 0 for none. Intensities are not clipped. */
HADA_API hada_status hada_simulator_render(hada_simulator *simulator, const hada_plane *planes, int count, double noise,
                                           uint64_t noise_seed, hada_image *raw, hada_error *err);

/* The PSF in use at a depth (index): sensor size, channels as it was given (one from geometry). Created by the call. */
HADA_API hada_status hada_simulator_psf(const hada_simulator *simulator, int depth, hada_image *psf, hada_error *err);

/* Adds Gaussian noise with standard deviation `sigma` (in the image's units). */
HADA_API void hada_image_add_noise(hada_image *image, double sigma, uint64_t seed);

#ifdef __cplusplus
}
#endif
#endif
