/* What a fit compared on held-out pairs. Internal. */
#ifndef HADA_FIT_FIT_SCORES_H
#define HADA_FIT_FIT_SCORES_H

#include <hadalens/fit.h>

struct hada_fit_scores {
    hada_fit_filter_score *filters;
    hada_fit_outside_score *outsides;
    hada_fit_refine_score *refinements;
    size_t filter_count, outside_count, refinement_count;
};

/* So many places of each kind, to be filled in. */
hada_status hada_fit_scores_create(hada_fit_scores **out, size_t filters, size_t outsides, size_t refinements,
                                   hada_error *err);

/* By how many decibels the chosen refinement leads the linear filters, one depth occupied; 0 where it was not tried. */
double hada_fit_scores_gain(const hada_fit_scores *scores);

#endif
