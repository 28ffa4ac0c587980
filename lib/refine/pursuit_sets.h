/* Sets of depths, and what each of them leaves of the frame in hand: what was refined once is kept. Internal to
 * lib/refine. */
#ifndef HADA_REFINE_PURSUIT_SETS_H
#define HADA_REFINE_PURSUIT_SETS_H

#include "refine/pursuit_search.h"

/* Depths in rising order. */
typedef struct hada_set {
    int count, depth[HADA_PURSUIT_MAX];
} hada_set;

int hada_set_same(const hada_set *a, const hada_set *b);
int hada_set_has(const hada_set *set, int depth);
hada_set hada_set_with(const hada_set *set, int depth);
hada_set hada_set_without(const hada_set *set, int place);

typedef struct hada_known_set hada_known_set;

/* What is known of the frame in hand; all zero but for the pursuit at first. */
typedef struct hada_looks {
    hada_pursuit *pursuit;
    hada_known_set *known;
    size_t count, room;
} hada_looks;

void hada_looks_free(hada_looks *looks);

/* The energy of the frame itself to a look. */
hada_status hada_looks_energy(const hada_looks *looks, hada_pursuit_look look, double *energy, hada_error *err);

/* What each of `count` sets of one size leaves to a look; those not yet known are refined side by side. */
hada_status hada_looks_left(hada_looks *looks, hada_pursuit_look look, const hada_set *sets, int count, double *left,
                            hada_error *err);

/* What all depths of the camera together leave to the look that judges. Not for the full look. */
hada_status hada_looks_all(const hada_looks *looks, double *left, hada_error *err);

#endif
