/* A few pairs that stay in memory, for the trial of refinement. Internal. */
#ifndef HADA_FIT_KEPT_H
#define HADA_FIT_KEPT_H

#include "fit/fit_pair.h"

/* Pairs kept for the trial. */
enum { HADA_FIT_KEPT = 4 };

typedef struct hada_fit_kept_pair {
    int depth;
    float *raw, *scene; /* pixels, dark level off */
    float *transfers;   /* its depth's, learned without it, as the device has them; NULL: from the sums without it */
} hada_fit_kept_pair;

typedef struct hada_fit_kept {
    hada_fit_kept_pair pair[HADA_FIT_KEPT];
    int count;
} hada_fit_kept;

/* Keeps a pair that was taken, if the trial wants one of its depth: the first ones of depths spread over all. */
hada_status hada_fit_keep(hada_fit_kept *kept, const hada_fit_pair *pair, int depth, hada_error *err);
void hada_fit_kept_free(hada_fit_kept *kept);

#endif
