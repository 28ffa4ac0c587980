#include "fit/fit_scores.h"

#include <math.h>
#include <stdlib.h>

#include "core/alloc.h"

hada_status hada_fit_scores_create(hada_fit_scores **out, size_t filters, size_t outsides, size_t refinements,
                                   hada_error *err)
{
    static const char what[] = "the scores of a fit";
    hada_fit_scores *scores = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(scores = hada_alloc(1, sizeof *scores, what, err)));
    HADA_TRY_OR_DONE(hada_allocated(scores->filters = hada_alloc(filters, sizeof *scores->filters, what, err)));
    HADA_TRY_OR_DONE(hada_allocated(scores->outsides = hada_alloc(outsides, sizeof *scores->outsides, what, err)));
    HADA_TRY_OR_DONE(
        hada_allocated(scores->refinements = hada_alloc(refinements, sizeof *scores->refinements, what, err)));
    scores->filter_count = filters;
    scores->outside_count = outsides;
    scores->refinement_count = refinements;
    *out = scores;
done:
    if (status)
        hada_fit_scores_destroy(&scores);
    return status;
}

void hada_fit_scores_destroy(hada_fit_scores **scores)
{
    if (!scores || !*scores)
        return;
    free((*scores)->filters);
    free((*scores)->outsides);
    free((*scores)->refinements);
    free(*scores);
    *scores = NULL;
}

const hada_fit_filter_score *hada_fit_scores_filter(const hada_fit_scores *scores, size_t index)
{
    return scores && index < scores->filter_count ? &scores->filters[index] : NULL;
}

const hada_fit_outside_score *hada_fit_scores_outside(const hada_fit_scores *scores, size_t index)
{
    return scores && index < scores->outside_count ? &scores->outsides[index] : NULL;
}

const hada_fit_refine_score *hada_fit_scores_refinement(const hada_fit_scores *scores, size_t index)
{
    return scores && index < scores->refinement_count ? &scores->refinements[index] : NULL;
}

double hada_fit_scores_gain(const hada_fit_scores *scores)
{
    double gain = 0.0;
    for (size_t i = 1; i < scores->refinement_count; i++)
        if (scores->refinements[i].chosen)
            gain = scores->refinements[i].psnr_single - scores->refinements[0].psnr_single;
    return isfinite(gain) ? gain : 0.0;
}
