/* The law of magnification of a camera whose transfer functions are on a device. Internal. */
#ifndef HADA_SURFACE_MEASURE_H
#define HADA_SURFACE_MEASURE_H

#include "fft/fft.h"
#include "surface/magnification.h"

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

#endif
