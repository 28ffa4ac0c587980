/* What the parts of a surface have in common: its levels, buffers and arrays. Internal. */
#ifndef HADA_SURFACE_SURFACE_STATE_H
#define HADA_SURFACE_SURFACE_STATE_H

#include "surface/level.h"
#include "surface/surface.h"

struct hada_surface {
    hada_slot *slot;
    hada_surface_camera camera;
    hada_spectrum_layout layout;
    hada_surface_level level[HADA_SURFACE_LEVELS];
    int levels;
    hada_buffer map, texture, allowed; /* depth in planes, of the last level; the texture; masks of planes */
    double *light;                     /* [channel] H(0) of the middle depth */
    double *shift;                     /* [depth] rms, of light from a depth to the next, in pixels */
    float *power;                      /* [count] mean over channels of the middle depth's |H|^2 */
    double gradient_power;             /* of white noise in the gradient of the texture's data term, by a run's rule */
    /* on the host: planes of a level and of the one before, masks; maps of a level and of the one before, in depths of
     * the camera from the first plane on; textures */
    float *planes[2], *mask, *depth[2], *sum, *image[2], *confidence;
    unsigned char *outside;
};

static inline size_t hada_surface_area(const hada_surface_plan *plan)
{
    return (size_t)plan->shape.window.rows * (size_t)plan->shape.window.cols;
}

/* Values of the planes of a level. */
static inline size_t hada_surface_values(const hada_surface_plan *plan)
{
    return (size_t)plan->shape.planes * (size_t)plan->shape.channels * hada_surface_area(plan);
}

/* A buffer of so many floats that another object holds. */
static inline hada_buffer hada_surface_view(const hada_surface *s, cl_mem mem, size_t values)
{
    return (hada_buffer){.context = s->slot->context, .mem = mem, .bytes = values * sizeof(float), .part = 1};
}

#endif
