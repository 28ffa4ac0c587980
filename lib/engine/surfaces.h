/* What the pipelines of a device share for surfaces: the optics between depths, measured when a frame first needs them,
 * and the memory that their surfaces take. Internal. Its calls may come from several threads. */
#ifndef HADA_ENGINE_SURFACES_H
#define HADA_ENGINE_SURFACES_H

#include <stdint.h>

#include "surface/surface.h"

typedef struct hada_surfaces hada_surfaces;

hada_status hada_surfaces_create(hada_surfaces **out, hada_error *err);
void hada_surfaces_destroy(hada_surfaces **surfaces); /* what it made must be gone */

/* The camera and the window, as for hada_surface_create(); the depths' distances; device memory that each pipeline has
 * for a surface. */
typedef struct hada_surfaces_desc {
    hada_surface_camera camera;
    hada_surface_shape shape;
    const double *distances_mm;
    uint64_t most_bytes;
} hada_surfaces_desc;

/* Makes a pipeline's surface. The same answer for each pipeline of a plan, so that results do not depend on who takes a
 * frame: HADA_ERROR_MODEL where the camera has no optics between its depths, HADA_ERROR_DEVICE_MEMORY where a surface
 * and its making take more than most_bytes; nothing is allocated then. */
hada_status hada_surfaces_make(hada_surfaces *surfaces, hada_surface **out, hada_slot *slot,
                               const hada_surfaces_desc *desc, hada_error *err);
void hada_surfaces_unmake(hada_surfaces *surfaces, hada_surface **surface);

/* Bytes of device memory that all surfaces hold now. */
uint64_t hada_surfaces_bytes(hada_surfaces *surfaces);

#endif
