/* What all pipelines of one device read and none writes: filters or transfer functions, the prior; and what they share
 * for surfaces. Internal. */
#ifndef HADA_ENGINE_CONSTANTS_H
#define HADA_ENGINE_CONSTANTS_H

#include "engine/setup.h"
#include "engine/surfaces.h"
#include "filter/bank.h"

typedef struct hada_constants {
    hada_context *context;
    hada_bank *bank;
    hada_buffer prior;  /* of refinement; empty where the model knows none */
    hada_buffer optics; /* transfer functions of a classic method's own; empty where it takes the bank's */
    hada_buffer gains;  /* of the filters; empty where spectra are not measured */
    hada_surfaces *surfaces;
} hada_constants;

hada_status hada_constants_create(hada_constants **out, hada_context *context, const hada_setup *setup,
                                  hada_error *err);
void hada_constants_destroy(hada_constants **constants); /* the pipelines must be gone */

/* Bytes of device memory that they hold, without surfaces. */
uint64_t hada_constants_bytes(const hada_context *context, const hada_model *model, const hada_config *config);

/* The transfer functions of all computed depths, which stand in one buffer; *offset in complex numbers. */
cl_mem hada_constants_otf(const hada_constants *constants, size_t *offset);

#endif
