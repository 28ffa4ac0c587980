/* The search of depth pursuit: its two parts, and what they have in common. Internal to lib/refine. */
#ifndef HADA_REFINE_PURSUIT_SEARCH_H
#define HADA_REFINE_PURSUIT_SEARCH_H

#include "refine/pursuit_sets.h"

typedef struct hada_search {
    hada_pursuit *pursuit;
    hada_pursuit_result *result;
    hada_residuals *residuals;
    /* the sets of one size that are to be compared, and what they leave */
    hada_set candidates[HADA_PURSUIT_DEPTHS];
    double energy[HADA_PURSUIT_DEPTHS];
    int count;
} hada_search;

/* Searches the frame that the levels were given, into *s->result. On failure that says nothing. */
hada_status hada_search_depths(hada_search *s, hada_error *err);

/* Goes on with the result, where depths may hide that few steps do not tell from others. */
hada_status hada_search_hidden(hada_search *s, hada_error *err);

/* What a set leaves. */
hada_status hada_search_residual(hada_search *s, hada_fidelity fidelity, const hada_set *set, double *energy,
                                 hada_error *err);
/* What the candidates leave, into s->energy. */
hada_status hada_search_evaluate(hada_search *s, hada_fidelity fidelity, hada_error *err);
/* The candidate that leaves least and was not yet taken; *energy: what it leaves, INFINITY where all are taken. */
int hada_search_take_best(hada_search *s, double *energy);
/* Lists the sets of one depth more than *current: the first few of those that leave least, evaluated so, and no more
 * than `most`. */
hada_status hada_search_shortlist(hada_search *s, const hada_set *current, hada_fidelity fidelity, double most,
                                  hada_error *err);
/* All sets with a depth less; how many. */
int hada_search_reductions(const hada_set *current, hada_set *less);
/* Local search: moves depths of *current to free neighbours while that leaves less. */
hada_status hada_search_move(hada_search *s, hada_set *current, hada_fidelity finest, hada_error *err);
/* Takes down what was found, and whether depths may hide beside it, unless these were looked for (parted). */
hada_status hada_search_report(hada_search *s, const hada_set *found, int parted, hada_error *err);

#endif
