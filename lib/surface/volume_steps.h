/* A volume, and what a step of it is made of: kernels and transforms, each one call. Internal to lib/surface. */
#ifndef HADA_SURFACE_VOLUME_STEPS_H
#define HADA_SURFACE_VOLUME_STEPS_H

#include "launch/refine.h"
#include "launch/surface_volume.h"
#include "refine/proximal.h"
#include "surface/volume.h"

/* Buffers that transfer functions are spread over, at most, where the device has not so much memory in one piece. */
enum { HADA_VOLUME_PIECES = 16 };

struct hada_volume {
    hada_slot *slot;
    hada_volume_shape shape;
    hada_spectrum_layout layout;
    hada_program_surface_volume program;
    hada_program_refine refine;
    size_t group;
    hada_variation variation;
    hada_shrinkage shrinkage;
    int batch; /* planes at once */
    int piece; /* planes whose transfer functions are in one buffer */
    size_t window_area, frame_area;
    hada_fft *forward, *inverse;             /* of the window's planes */
    hada_fft *frame_forward, *frame_inverse; /* padded */
    hada_buffer otf[HADA_VOLUME_PIECES];     /* conjugate, `piece` planes in each but the last */
    hada_buffer weight, spectra, sum, frame; /* weights; spectra of a batch; of what the planes make; in the frame */
    hada_buffer mask;                        /* weights of the frame's pixels, as they are of a residual */
    hada_buffer planes;                      /* free planes; textures: those of a batch */
    hada_buffer at, gradient, start;         /* the extrapolated point, the gradient there, where a run began */
    hada_buffer duals[2], partial;
    float *host_partial; /* of a look or more: see hada_volume_looks() */
    double floor;        /* that the weights were made with; 0: not yet */
    cl_mem frame_spectrum, frame_pixels, weights;
    size_t spectrum_offset, pixels_offset;
};

/* The unknown of a run: free planes, or a texture that makes some of them. */
typedef struct hada_volume_unknown {
    int texture;
    int first, last; /* planes that take part */
    cl_mem depth;    /* of a texture */
    cl_mem values;   /* the planes, or the texture: u */
    cl_mem allowed;  /* or NULL */
    size_t count;    /* of values */
} hada_volume_unknown;

/* 1 where the sensor crops. */
int hada_volume_is_padded(const hada_volume_shape *shape);

/* The weights of the residual, over all planes of the camera. */
hada_status hada_volume_weigh(hada_volume *v, double floor, hada_error *err);

/* Energies, that of the frame beside, which are read together. A device that shares the host's memory is waited for at
 * little cost; another idles meanwhile, and a run that has gone astray, which is seen later then, is rare. */
enum { HADA_VOLUME_LOOKS = 8 };
int hada_volume_looks(const hada_context *context);

/* The gradient at the extrapolated point; the residual's energy at place `look`, 1 to hada_volume_looks(). */
hada_status hada_volume_differentiate(hada_volume *v, const hada_volume_unknown *u, int look, hada_error *err);

/* The proximal step number `step` of a run, of length 1 / bound from the extrapolated point, and the next such point.
 */
hada_status hada_volume_step(hada_volume *v, const hada_volume_unknown *u, const hada_volume_rule *rule, double bound,
                             double momentum, int step, hada_error *err);

/* The energy of the frame itself, what nothing explains, at place 0. */
hada_status hada_volume_frame_energy(hada_volume *v, hada_error *err);

/* The first `count` energies, within the frame. */
hada_status hada_volume_fetch_energies(hada_volume *v, int count, double *energy, hada_error *err);

#endif
