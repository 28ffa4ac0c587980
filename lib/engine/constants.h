/* What the lanes of one device share: read-only once it is made. Internal. */
#ifndef HADA_ENGINE_CONSTANTS_H
#define HADA_ENGINE_CONSTANTS_H

#include "engine/config.h"
#include "filter/bank.h"
#include "filter/gains.h"

typedef struct hada_share {
    hada_context *context;
    int batch; /* depths at once that fit its memory */
    hada_bank *bank;
    hada_buffer prior;  /* of refinement; empty where the model knows none */
    hada_buffer optics; /* transfer functions of a classic method's own; empty where it takes the bank's */
    hada_buffer gains;  /* of the filters; empty where spectra are not measured */
} hada_share;

/* `depths`: indices into the model of the depths that are computed; `gains`: NULL where spectra are not measured. */
hada_status hada_share_create(hada_share **out, hada_context *context, const hada_model *model,
                              const hada_plan_shape *shape, const int *depths, const hada_gains *gains,
                              hada_error *err);
void hada_share_destroy(hada_share **share); /* the lanes must be gone */

/* Bytes of device memory that it holds. */
uint64_t hada_share_bytes(const hada_context *context, const hada_model *model, const hada_plan_shape *shape);

/* The transfer functions of all computed depths, which stand in one buffer; *offset in complex numbers. */
cl_mem hada_share_otf(const hada_share *share, size_t *offset);

#endif
