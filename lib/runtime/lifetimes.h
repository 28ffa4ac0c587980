/* Memory planning from lifetimes: which pieces may share a place. Internal.
 *
 * Work runs in steps 0, 1, 2, ... on one in-order queue. A piece of memory is needed from its first to its last step,
 * both included; pieces whose steps do not meet may stand at the same place. The plan is made before anything is
 * allocated, so that its bytes can be stated beforehand. */
#ifndef HADA_RUNTIME_LIFETIMES_H
#define HADA_RUNTIME_LIFETIMES_H

#include "runtime/buffer.h"

typedef struct hada_piece {
    const char *what; /* for messages */
    size_t bytes;
    int first, last; /* steps */
    int arena;       /* out: which buffer */
    size_t offset;   /* out: bytes into it, aligned as sub-buffers need it */
} hada_piece;

typedef struct hada_arenas {
    int count;
    size_t *bytes; /* of each buffer; hada_arenas_free() */
} hada_arenas;

/* Gives every piece a place: largest first, each at the lowest place that is free during its steps. No buffer becomes
 * larger than `largest` (the device's largest allocation). HADA_ERROR_DEVICE_MEMORY where one piece alone is. */
hada_status hada_lifetimes_plan(hada_piece *pieces, int count, size_t alignment, size_t largest, hada_arenas *arenas,
                                hada_error *err);
void hada_arenas_free(hada_arenas *arenas);

/* The most bytes that are needed in any one step: what no plan can go below. */
size_t hada_lifetimes_floor(const hada_piece *pieces, int count);

#endif
