/* What all pipelines of one device read and none writes: filters or transfer functions, the prior; and what they share
 * for surfaces and volumes, made when a frame first needs it. Internal. */
#ifndef HADA_ENGINE_CONSTANTS_H
#define HADA_ENGINE_CONSTANTS_H

#include <pthread.h>

#include "engine/setup.h"
#include "filter/bank.h"
#include "surface/surface.h"

/* What surfaces and volumes of all pipelines share (surface_path.c, volume_path.c). */
typedef struct hada_on_demand {
    pthread_mutex_t lock;   /* held for making and unmaking */
    hada_magnification law; /* the optics between depths; no depths: not measured yet */
    uint64_t surface_bytes; /* of a pipeline's surface */
    int surfaces;           /* made */
    int volumes_known;      /* 1: the members below are; -1: there is no room for them */
    hada_classic_shape shape;
    hada_classic_camera camera;
    hada_buffer optics;
    uint64_t volume_bytes; /* of a pipeline's own part */
    int volumes;           /* made */
} hada_on_demand;

/* Bytes of device memory that surfaces and volumes hold now. */
uint64_t hada_on_demand_bytes(hada_on_demand *all);

typedef struct hada_constants {
    hada_context *context;
    hada_bank *bank;
    hada_buffer prior;  /* of refinement; empty where the model knows none */
    hada_buffer optics; /* transfer functions of a classic method's own; empty where it takes the bank's */
    hada_buffer gains;  /* of the filters; empty where spectra are not measured */
    hada_on_demand *on_demand;
} hada_constants;

hada_status hada_constants_create(hada_constants **out, hada_context *context, const hada_setup *setup,
                                  hada_error *err);
void hada_constants_destroy(hada_constants **constants); /* the pipelines must be gone */

/* The transfer functions of all computed depths, in one buffer; *offset in complex numbers. */
cl_mem hada_constants_otf(const hada_constants *constants, size_t *offset);

#endif
