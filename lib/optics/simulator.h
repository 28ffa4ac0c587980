/* What the files of the simulator share. Internal. */
#ifndef HADA_OPTICS_SIMULATOR_H
#define HADA_OPTICS_SIMULATOR_H

#include <hadalens/optics.h>
#include <hadalens/sensor.h>
#include <hadalens/simulate.h>

#include "fft/fft.h"
#include "runtime/slot.h"

typedef struct hada_extent {
    int rows, cols;
} hada_extent;

/* Where a plane is: at a depth of the camera, or (depth -1) at any distance, with a PSF by the camera's optics. */
typedef struct hada_place {
    int depth;
    double distance_mm;
} hada_place;

typedef struct hada_layer {
    hada_place place;
    const hada_image *image;   /* light that it sends itself; NULL: none */
    const hada_image *opacity; /* NULL: hides nothing */
} hada_layer;

/* Transfer functions of other distances than the camera's, as many as are kept. */
typedef struct hada_between {
    double *distance_mm;
    hada_buffer *otf;
    int count;
} hada_between;

/* PSFs that vary over the field (varying.c). */
typedef struct hada_varying hada_varying;

struct hada_simulator {
    hada_camera camera;
    hada_varying *varying;       /* NULL: they are the same everywhere */
    hada_image *psf;             /* given ones, one a depth; NULL: by the camera's optics */
    hada_wave *wave;             /* makes them by wave optics; NULL: geometry */
    int psf_images;              /* channels of each PSF */
    hada_extent shift, field;    /* of the options; the field at least the window */
    const hada_monitor *monitor; /* asked whether to stop; NULL: nobody */
    double patch_pixels;         /* of parallax between neighbouring patches of a mask without lenses, at most */
    int rows, cols;              /* of the transform: the sensor, or larger where light is cropped */

    hada_slot *slot;
    hada_fft *forward_psf, *forward_scene, *inverse;
    hada_spectrum_layout layout;
    hada_buffer real;     /* a PSF on the transform's grid, or the frame */
    hada_buffer scene;    /* a plane, channels x field */
    hada_buffer spectrum; /* of a plane */
    hada_buffer sum;      /* of the frame */
    hada_buffer *otf;     /* per depth, empty until first used */
    hada_between between;
};

/* HADA_ERROR_ARGUMENT where the camera has no such depth. */
hada_status hada_simulator_check_depth(const hada_simulator *simulator, int depth, hada_error *err);

hada_place hada_simulator_place(const hada_simulator *simulator, int depth);

/* The PSF of a place on a grid about the axis, moved by the sensor's shift; created by the call. */
hada_status hada_simulator_place_psf(const hada_simulator *simulator, hada_place place, int rows, int cols,
                                     hada_image *psf, hada_error *err);

/* Transfer functions (psf->channels of them) of a placed PSF of the transform's size into `otf`, created where empty.
 * With `share`, of that share of each pixel alone. */
hada_status hada_simulator_make_otf(hada_simulator *simulator, const hada_image *psf, const float *share,
                                    hada_buffer *otf, hada_error *err);

/* HADA_ERROR_SIZE and others where an image cannot be shown. */
hada_status hada_simulator_check_image(const hada_simulator *simulator, const hada_image *image, hada_error *err);
hada_status hada_simulator_check_plane(const hada_simulator *simulator, const hada_plane *plane, hada_error *err);

/* A plane of window or field size to the middle of a field on the device, `channels` of them (a grey one is repeated).
 */
hada_status hada_simulator_upload(hada_simulator *simulator, const hada_image *image, int channels, hada_buffer *to,
                                  size_t offset, hada_error *err);

/* The transfer functions of a place, made where they are first needed: kept by the simulator or, where many others are
 * kept, in `scratch`, which is created where it is empty. */
hada_status hada_simulator_otf(hada_simulator *simulator, hada_place place, hada_buffer *scratch,
                               const hada_buffer **otf, hada_error *err);

/* Adds (add 1) an image's part, unhidden and through all lenses, to the frame's spectrum, or begins it (add 0). */
hada_status hada_simulator_add_image(hada_simulator *simulator, const hada_image *image, const hada_buffer *otf,
                                     int add, hada_error *err);

/* From the frame's spectrum to the frame, with noise as hada_simulator_render says. */
hada_status hada_simulator_finish(hada_simulator *simulator, double noise, uint64_t seed, hada_image *raw,
                                  hada_error *err);

/* The frame of a window that is white at a depth; created by the call. */
hada_status hada_simulator_white(hada_simulator *simulator, int depth, hada_image *raw, hada_error *err);

/* The product-sum of the forward model: enqueues sum[c] = otf[c % otf_images] * scene[c] (add 0) or adds that to it
 * (add 1), for `images` images c of `count` complex numbers each; `sum_offset` in complex numbers. */
hada_status hada_optics_accumulate(hada_slot *slot, cl_mem sum, size_t sum_offset, cl_mem otf, int otf_images,
                                   cl_mem scene, int images, size_t count, int add, hada_error *err);

/* Gives a simulator PSFs that vary: in a corner of the window they correlate so much with that of the middle. */
hada_status hada_varying_create(hada_simulator *simulator, double wanted, hada_error *err);
void hada_varying_destroy(hada_simulator *simulator);

/* The frame of planes, with the PSF of each of their pixels; created by the call. */
hada_status hada_varying_render(hada_simulator *simulator, const hada_plane *planes, int count, hada_image *raw,
                                hada_error *err);

/* HADA_ERROR_UNSUPPORTED where PSFs vary. */
hada_status hada_varying_none(const hada_simulator *simulator, hada_error *err);

/* The sensor's model on the device. Internal. */

/* Enqueues what the sensor makes of `count` values, channels of `pixels` each, in place (from `offset` floats on).
 * `gain` holds `pixels` values; NULL: no vignetting. */
hada_status hada_optics_expose(hada_slot *slot, cl_mem values, size_t offset, cl_mem gain, size_t pixels, size_t count,
                               const hada_sensor *sensor, uint64_t seed, hada_error *err);

#endif
