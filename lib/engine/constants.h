/* What all pipelines of one device read and none writes: filters or transfer functions, the prior; and what they share
 * for surfaces: the optics between depths, measured when a frame first needs them, and the memory that their surfaces
 * take. Internal. */
#ifndef HADA_ENGINE_CONSTANTS_H
#define HADA_ENGINE_CONSTANTS_H

#include <pthread.h>

#include "engine/setup.h"
#include "filter/bank.h"
#include "surface/surface.h"

/* Calls may come from several threads. */
typedef struct hada_surfaces hada_surfaces;

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

/* What volumes of all pipelines share, made when a frame first needs it (volume_path.c), with the lock held. */
typedef struct hada_volumes {
    pthread_mutex_t lock;
    int known; /* 1: the members below are; -1: there is no room for them */
    hada_classic_shape shape;
    hada_classic_camera camera;
    hada_buffer optics;
    uint64_t each; /* bytes of a pipeline's own part */
    int made;
} hada_volumes;

void hada_volumes_unmake(hada_volumes *volumes, hada_classic **volume);

/* Bytes of device memory that volumes hold now. */
uint64_t hada_volumes_bytes(hada_volumes *volumes);

typedef struct hada_constants {
    hada_context *context;
    hada_bank *bank;
    hada_buffer prior;  /* of refinement; empty where the model knows none */
    hada_buffer optics; /* transfer functions of a classic method's own; empty where it takes the bank's */
    hada_buffer gains;  /* of the filters; empty where spectra are not measured */
    hada_surfaces *surfaces;
    hada_volumes *volumes;
} hada_constants;

hada_status hada_constants_create(hada_constants **out, hada_context *context, const hada_setup *setup,
                                  hada_error *err);
void hada_constants_destroy(hada_constants **constants); /* the pipelines must be gone */

/* The transfer functions of all computed depths, in one buffer; *offset in complex numbers. */
cl_mem hada_constants_otf(const hada_constants *constants, size_t *offset);

#endif
