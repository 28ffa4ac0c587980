/* The surface that explains a frame: one texture and one continuous depth map. Internal.
 *
 * Coarse to fine (docs/explanation/surfaces.md): at a fraction of the resolution the planes of all depths, whose
 * light's centre of mass is the depth of a pixel; at twice that only planes near it; at the whole resolution the one
 * texture that, at these depths, explains the frame. Planes stand between the depths of the camera where those lie far
 * apart.
 *
 * An object belongs to one slot. Same bits at every run. */
#ifndef HADA_SURFACE_SURFACE_H
#define HADA_SURFACE_SURFACE_H

#include "surface/magnification.h"
#include "surface/volume.h"

typedef struct hada_surface_shape {
    hada_rectangle frame;  /* what the sensor sees; the whole grid where the boundary is circular */
    hada_rectangle window; /* where the scene may be bright */
    hada_boundary boundary;
    int weighs; /* 1: pixels may have weights */
} hada_surface_shape;

/* A frame without dark level: its spectrum [channel][count] complex, zero outside the sensor, and where the sensor
 * crops its pixels [channel][frame] and their weights in the data term of the whole resolution, as hada_refine_data has
 * them (NULL: all 1). Offsets in complex numbers, in floats. Values of small weights are those of a guess in the
 * spectrum. */
typedef struct hada_surface_frame {
    cl_mem spectrum;
    size_t spectrum_offset;
    cl_mem pixels;
    size_t pixels_offset;
    cl_mem weights;
} hada_surface_frame;

enum { HADA_SURFACE_LEVELS = 8 };

typedef struct hada_surface_rule {
    int first_steps, band_steps, texture_steps; /* at the coarsest level, at those between, and at the last */
    double floor;                               /* of the weight of frequencies, in units of |H(0)|^2 */
    double first_variation;                     /* of planes of the coarsest level, in units of the scene's mean */
    /* of planes and of the texture later on, in units of the noise in the gradient of the texture's data term, by what
     * the level before left of its frame */
    double band_variation, texture_variation;
    /* a surface that leaves more energy than this is not wanted, and the run ends at a coarse level that says it will
     * by far; 0: it goes to its end. Beside it the energy of the frame. */
    double enough, frame;
} hada_surface_rule;
void hada_surface_rule_init(hada_surface_rule *rule);

typedef struct hada_surface_result {
    int rows, cols;               /* of the window */
    const float *depth;           /* [rows][cols], in depths of the camera, 0 ... depths - 1 */
    const float *confidence;      /* [rows][cols], 0 to 1 */
    const unsigned char *outside; /* [rows][cols], 1: beyond the camera's depths, and the nearest of them is said */
    cl_mem texture;               /* [channel][rows][cols] */
    int steps;                    /* of all levels */
    int levels, touched;          /* of resolution; planes of the last that any depth needs */
    double energy[HADA_SURFACE_LEVELS]; /* what each level leaves of its frame, sum of squares over its pixels */
    int in_vain; /* 1: the run ended early, for it will not be enough; no depth and no texture were found */
} hada_surface_result;

typedef struct hada_surface hada_surface;

/* The camera's transfer functions and the magnification are read now and not again. */
hada_status hada_surface_create(hada_surface **out, hada_slot *slot, const hada_surface_camera *camera,
                                const hada_surface_shape *shape, const hada_magnification *magnification,
                                hada_error *err);
void hada_surface_destroy(hada_surface **surface);

/* The surface of a frame. *result is the object's, until the next call. A frame without light has a texture without. */
hada_status hada_surface_run(hada_surface *surface, const hada_surface_frame *frame, const hada_surface_rule *rule,
                             hada_surface_result *result, hada_error *err);

/* The planes at the camera's depths that the texture makes, as it is now: shares of it, linear between two depths.
 * [depth][channel][window] floats. Enqueued. */
hada_status hada_surface_planes(hada_surface *surface, cl_mem planes, hada_error *err);

#endif
