/* The levels of resolution at which a surface is looked for: their grids, their planes, their camera and frame.
 * Internal to lib/surface. */
#ifndef HADA_SURFACE_LEVEL_H
#define HADA_SURFACE_LEVEL_H

#include "surface/between.h"
#include "surface/depth_map.h"
#include "surface/surface.h"

typedef struct hada_surface_plan {
    double shrink; /* whole grid over this one */
    int steps;     /* planes from a depth of the camera to the next */
    int before;    /* depths before the camera's nearest one that its planes begin with: 0, or 1 where optics are known
                      there */
    int whole;     /* the camera's own grid, and its frames as they are */
    hada_volume_shape shape;
    hada_spectrum_layout layout;
} hada_surface_plan;

typedef struct hada_surface_level {
    hada_surface_plan plan;
    hada_volume *volume;
    hada_buffer spectrum, pixels; /* of the frame, where the level has a grid of its own */
    hada_fft *inverse;            /* padded: to the pixels */
} hada_surface_level;

/* The levels of a camera, from coarse to fine; the last, on the camera's grid, is that of the texture. Returns how
 * many.
 */
int hada_surface_levels(const hada_context *context, const hada_surface_camera *camera, const hada_surface_shape *shape,
                        const hada_magnification *magnification, hada_surface_plan *plans);

hada_status hada_surface_level_make(hada_surface_level *level, hada_slot *slot, const hada_surface_plan *plan,
                                    hada_between *between, hada_buffer *plane, hada_error *err);
void hada_surface_level_free(hada_surface_level *level);

/* Hands a level the frame, brought to its grid. */
hada_status hada_surface_level_load(hada_surface_level *level, hada_slot *slot, const hada_spectrum_layout *from,
                                    cl_mem spectrum, size_t offset, cl_mem pixels, size_t pixels_offset,
                                    hada_error *err);

/* Where the window's pixels of a level lie in the window of another. */
hada_map_place hada_surface_level_place(const hada_surface_plan *of, const hada_surface_plan *in);

#endif
