/* PSFs by wave optics: what the two ways of computing them share. Internal to lib/optics. */
#ifndef HADA_OPTICS_WAVE_H
#define HADA_OPTICS_WAVE_H

#include <hadalens/optics.h>

#include "fft/fft.h"
#include "kernels/shared_fft.h"
#include "kernels/shared_optics.h"
#include "optics/mask.h"

/* A line that bounds the ground of a lens, for the kernel of optics_wave_lens.cl. */
typedef struct hada_wave_plane {
    float a, b, c, unused;
} hada_wave_plane;

struct hada_wave {
    hada_camera camera;
    hada_wave_options options;
    hada_slot *slot;
    hada_mask_design design;
    hada_buffer lenses, planes;  /* lens by lens */
    double area;                 /* of all lenses, square millimetres */
    struct hada_wave_work *work; /* the whole mask: what stays from call to call */
};

/* Gives back what the whole mask keeps; the next call makes it again. */
void hada_wave_rest(hada_wave *wave);

/* A colour's wavelength, and the mask's optical path at it over that at 587.6 nm. */
static inline void hada_wave_colour(const hada_camera *camera, int channel, double *wavelength_mm, double *path_scale)
{
    const double nm = camera->wavelengths_nm[camera->channels == 1 ? 1 : channel];
    *wavelength_mm = nm * 1e-6;
    *path_scale = (hada_camera_refractive_index(camera, nm) - 1.0) / (camera->refractive_index - 1.0);
}

/* How the spot of a lens is sampled at a distance and a wavelength: a pixel is `samples` x `samples` values of the
 * field, the square round the spot `pixels` x `pixels`, the transform n = pixels samples; a lens `points` x `points`
 * samples, `step` apart. */
typedef struct hada_wave_spot {
    int pixels, samples, n, points, pitch;
    double step;
    double chirp; /* 1/z + 1/d - 1/f: the field behind a lens is exp(i pi chirp u^2 / lambda) */
} hada_wave_spot;

/* Their buffers, as launches take them. */
typedef struct hada_wave_lens_memory *hada_wave_lens_array;
typedef struct hada_wave_pixel_memory *hada_wave_pixel_array;

/* Launches, each a kernel. Buffers as the kernels' heads say. */
hada_status hada_wave_launch_pupil(hada_slot *slot, cl_mem field, cl_mem phase, hada_wave_lens_array lenses,
                                   cl_mem planes, int first, int count, const hada_wave_spot *spot, double radius,
                                   double aperture, hada_error *err);
hada_status hada_wave_launch_spots(hada_slot *slot, cl_mem image, cl_mem part, cl_mem spectra, int count, int pixels,
                                   int samples, hada_error *err);
hada_status hada_wave_launch_mask(hada_slot *slot, cl_mem field, cl_mem path, cl_mem open, int n, double waves,
                                  hada_error *err);
hada_status hada_wave_launch_travel(hada_slot *slot, cl_mem spectrum, cl_mem across, cl_mem down, int rows, int blocks,
                                    hada_error *err);
hada_status hada_wave_launch_sensor(hada_slot *slot, cl_mem image, cl_mem part, cl_mem field,
                                    hada_wave_pixel_array across, hada_wave_pixel_array down, int rows, int cols,
                                    int pixel_rows, int pixel_cols, hada_error *err);

/* Samples of width `step`, the first of which begins at `begin`, under pixels of width `width`, the first of which
 * begins at `pixel`: `samples` and `pixels` of them. */
void hada_wave_share(hada_wave_pixel *table, int pixels, double pixel, double width, int samples, double begin,
                     double step);

#endif
