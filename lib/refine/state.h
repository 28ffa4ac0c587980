/* Where a refinement stands, kept aside so that others can go on from it. Internal to lib/refine. */
#ifndef HADA_REFINE_STATE_H
#define HADA_REFINE_STATE_H

#include "refine/admm.h"

typedef struct hada_refine_state {
    hada_buffer planes, now_u, now_w; /* [place][channel] */
    hada_buffer split_a, dual;        /* [channel], padded boundary only */
} hada_refine_state;

/* Room for a set of `depths` depths. */
hada_status hada_refine_state_create(hada_refine_state *state, const hada_refiner *refiner, int depths,
                                     hada_error *err);
void hada_refine_state_destroy(hada_refine_state *state);
size_t hada_refine_state_bytes(const hada_context *context, const hada_refine_shape *shape, int depths);

/* Keeps set `set` of the last run (sets of `depths` depths), after hada_refiner_score() or _residual(). */
hada_status hada_refine_state_save(hada_refine_state *state, hada_refiner *refiner, int set, int depths,
                                   hada_error *err);

/* What a place of a set starts from. */
typedef enum hada_refine_from {
    HADA_REFINE_FROM_BOTH = 0,   /* planes and duals of the kept place */
    HADA_REFINE_FROM_PLANES = 1, /* its planes, duals zero */
    HADA_REFINE_FROM_ZERO = 2
} hada_refine_from;

/* Makes place `place` of set `set` (sets of `depths` depths) start from place `kept`; the next run starts with
 * HADA_REFINE_ON. hada_refine_state_load_split() does the same for what a set has once (padded boundary). */
hada_status hada_refine_state_load(const hada_refine_state *state, hada_refiner *refiner, int set, int depths,
                                   int place, int kept, hada_refine_from from, hada_error *err);
hada_status hada_refine_state_load_split(const hada_refine_state *state, hada_refiner *refiner, int set,
                                         hada_error *err);

#endif
