/* Hadalens: raw frames of a camera by simulation, on a device: b = sum_z PSF_z * x_z + noise; with opaque objects, lens
 * by lens (docs/explanation/simulation.md).
 *
 * Threads: a simulator is used by one thread at a time. */
#ifndef HADALENS_SIMULATE_H
#define HADALENS_SIMULATE_H

#include <hadalens/camera.h>
#include <hadalens/device.h>
#include <hadalens/image.h>
#include <hadalens/monitor.h>
#include <hadalens/sensor.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Renders raw frames of a camera on a device. Transfer functions are made at first use of each depth and kept. */
typedef struct hada_simulator hada_simulator;

/* What a simulator can differ in. Start from hada_simulator_options_init(). */
typedef struct hada_simulator_options {
    size_t size;                 /* sizeof(hada_simulator_options) */
    const hada_image *psf;       /* measured or designed PSFs instead of the camera's own: camera->depths images of
                                    sensor size, of one channel or of camera->channels. Used as they are, without
                                    normalisation. NULL (default): made by the camera's `optics` */
    int shift_rows, shift_cols;  /* where the sensor's middle stands from the optical axis, in pixels: the frame holds
                                    at pixel (r, c) what it would hold at (r + shift_rows, c + shift_cols) */
    int field_rows, field_cols;  /* scenes may be this large, about the middle of the window, so that light from beyond
                                    the window enters the frame; larger than the sensor with HADA_BOUNDARY_PADDED only.
                                    0 (default): the window */
    const hada_monitor *monitor; /* asked several times a second whether to stop, while PSFs are made and frames are
                                    rendered (then HADA_ERROR_CANCELLED); it must last as long as the simulator. NULL
                                    (default): nobody; in hada_simulate_run() the task's */
    double field_varying; /* PSFs vary over the field, by an aberration that grows with the square of the field angle
                             and is another one for each part of the mask: in the corners of the window they correlate
                             so much with that of the middle, between 0 and 1. With HADA_BOUNDARY_PADDED, of planes
                             that hide nothing. 0 (default): they are the same everywhere */
} hada_simulator_options;
HADA_INIT(hada_simulator_options, HADA_STRUCT_SIMULATOR_OPTIONS)
/* The camera is copied. `options` may be NULL. */
HADA_API hada_status hada_simulator_create(hada_simulator **out, hada_context *context, const hada_camera *camera,
                                           const hada_simulator_options *options, hada_error *err);
HADA_API void hada_simulator_destroy(hada_simulator **simulator);
HADA_API const hada_camera *hada_simulator_camera(const hada_simulator *simulator);

/* A scene's part at one depth. */
typedef struct hada_plane {
    int depth;               /* index into the camera's distances */
    const hada_image *image; /* of the window's size or the field's, camera->channels channels or one (grey) */
} hada_plane;

/* Renders the frame of a scene of `count` planes (depths may repeat; they add up) into *raw, created by the call, of
 * sensor size and camera->channels. Noise: Gaussian with standard deviation `noise` times the maximum of the
 * noise-free frame, from `noise_seed`; 0 for none. Intensities are not clipped. */
HADA_API hada_status hada_simulator_render(hada_simulator *simulator, const hada_plane *planes, int count, double noise,
                                           uint64_t noise_seed, hada_image *raw, hada_error *err);

/* As hada_simulator_render, with planes that hide what stands behind them, seen by every lens from its own place.
 * opacity[i] is NULL where plane i hides nothing, else one channel of the size of its image, 0 (clear) to 1 (opaque);
 * opacity NULL: no plane hides anything;
 * the image is the light that the plane sends itself. A plane hides those of larger depth indices. `lens` is an index
 * of hada_camera_lenses() to look through that lens alone, or -1 for all. A mask without lenses is parted into patches
 * (docs/explanation/simulation.md), and takes -1 alone. */
HADA_API hada_status hada_simulator_render_occluded(hada_simulator *simulator, const hada_plane *planes,
                                                    const hada_image *const *opacity, int count, int lens, double noise,
                                                    uint64_t noise_seed, hada_image *raw, hada_error *err);

/* A scene's part on a surface: each pixel at a distance of its own, between the camera's depths or beyond them. */
typedef struct hada_relief {
    const hada_image *image;        /* as of a plane */
    const hada_image *distances_mm; /* one channel of the image's size, from the mask; NaN: nothing stands there */
} hada_relief;

/* As hada_simulator_render, of `count` surfaces of one size, whose light adds up. `opaque` 1: they hide what stands
 * behind them, as planes do in hada_simulator_render_occluded; 0: nothing hides anything. PSFs are made in steps of 1/z
 * from which to which the outermost spot moves by a quarter of a pixel, and light between two is shared out to both:
 * docs/explanation/simulation.md says what that leaves, and of opaque surfaces. HADA_ERROR_UNSUPPORTED with PSFs that
 * were given. */
HADA_API hada_status hada_simulator_render_reliefs(hada_simulator *simulator, const hada_relief *surfaces, int count,
                                                   int opaque, double noise, uint64_t noise_seed, hada_image *raw,
                                                   hada_error *err);

/* What a sensor makes of a frame of light, in place: sensor size, any number of channels (<hadalens/sensor.h>). The
 * same seed gives the same bits on a device. */
HADA_API hada_status hada_simulator_expose(hada_simulator *simulator, const hada_sensor *sensor, uint64_t seed,
                                           hada_image *frame, hada_error *err);

/* The exposure at which a white scene (1 all over the window) just reaches `share` of the full scale, at the depth
 * where its frame is brightest. */
HADA_API hada_status hada_simulator_white_exposure(hada_simulator *simulator, double share, double *exposure,
                                                   hada_error *err);

/* The PSF in use at a depth (index), as the sensor sees it where it stands: sensor size, channels as it was given (by
 * geometry one, by waves the camera's). Created by the call. */
HADA_API hada_status hada_simulator_psf(const hada_simulator *simulator, int depth, hada_image *psf, hada_error *err);

/* With options.field_varying: what the sensor sees of a point that stands `row` and `col` pixels from the axis (where
 * row and column of its picture are more than the middle, rows / 2 and cols / 2, by so much). As above. */
HADA_API hada_status hada_simulator_psf_at(const hada_simulator *simulator, int depth, int row, int col,
                                           hada_image *psf, hada_error *err);

/* Adds Gaussian noise with standard deviation `sigma` (in the image's units); none where that is not finite. */
HADA_API void hada_image_add_noise(hada_image *image, double sigma, uint64_t seed);

#ifdef __cplusplus
}
#endif
#endif
