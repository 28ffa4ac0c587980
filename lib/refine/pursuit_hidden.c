#include <stdlib.h>
#include <string.h>

#include "refine/pursuit_search.h"

/* Depths as close as this may hide one between or beside them, which explains at least this part of what they leave,
 * once all have parted; one that is not there explained up to 0.14 (docs/explanation/refinement.md). */
enum { CLOSE_DEPTHS = 2 };
#define HIDDEN_THRESHOLD 0.15

/* A third depth that steps too few for the threshold show: what depths that are not there explained by so many was
 * below this, what others did above. */
#define GLIMPSE 0.07

/* Whether a set has depths within CLOSE_DEPTHS of `depth`, others than it. */
static int has_near(const hada_set *set, int depth)
{
    for (int i = 0; i < set->count; i++)
        if (set->depth[i] != depth && abs(set->depth[i] - depth) <= CLOSE_DEPTHS)
            return 1;
    return 0;
}

/* Whether `depth` is free and neighbour of one of several close depths. */
static int is_hidden(const hada_set *set, int depth)
{
    int hidden = 0;
    for (int i = 0; i < set->count; i++)
        hidden |= abs(set->depth[i] - depth) == 1 && has_near(set, set->depth[i]);
    return hidden && !hada_set_has(set, depth);
}

/* All sets of one depth more that may be better once all have parted: the first of those that begin to explain
 * something, and those that hide. */
static hada_status list_missed(hada_search *s, const hada_set *current, hada_error *err)
{
    double now;
    HADA_TRY(hada_search_residual(s, HADA_FIDELITY_CONVERGED, current, &now, err));
    HADA_TRY(hada_search_shortlist(s, current, HADA_FIDELITY_CONVERGED, (1.0 - GLIMPSE) * now, err));
    for (int depth = 0; depth < s->pursuit->options.depths; depth++)
        if (is_hidden(current, depth)) /* once more in the list is no more work */
            s->candidates[s->count++] = hada_set_with(current, depth);
    return HADA_OK;
}

/* Whether the depths follow each other. */
static int is_row(const hada_set *set)
{
    return set->depth[set->count - 1] - set->depth[0] < set->count;
}

/* Whether a set explains enough of what one of a depth less leaves, once all have parted: by what each of them leaves.
 */
static int explains(double smaller, double larger)
{
    return larger <= (1.0 - HIDDEN_THRESHOLD) * smaller;
}

/* Drops the depth of *current that explains least, unless that is enough. */
static hada_status drop_hidden(hada_search *s, hada_set *current, hada_error *err)
{
    double now, least;
    s->count = hada_search_reductions(current, s->candidates);
    HADA_TRY(hada_search_residual(s, HADA_FIDELITY_FINE, current, &now, err));
    HADA_TRY(hada_search_evaluate(s, HADA_FIDELITY_FINE, err));
    const hada_set less = s->candidates[hada_search_take_best(s, &least)];
    if (!explains(least, now))
        *current = less;
    return HADA_OK;
}

/* Depths that few steps do not tell from others: adds those that explain enough once all have parted, moves the set
 * again, and drops what is then not needed. A single depth hides nothing. */
static hada_status part(hada_search *s, hada_set *current, hada_error *err)
{
    const hada_pursuit_options *o = &s->pursuit->options;
    int added = 0;
    while (current->count > 1 && current->count < o->max_depths) {
        double now, least;
        HADA_TRY(list_missed(s, current, err));
        if (!s->count)
            break;
        hada_residuals_ahead(s->residuals, HADA_FIDELITY_FINE, s->candidates, s->count);
        HADA_TRY(hada_search_residual(s, HADA_FIDELITY_FINE, current, &now, err));
        HADA_TRY(hada_search_evaluate(s, HADA_FIDELITY_FINE, err));
        const hada_set more = s->candidates[hada_search_take_best(s, &least)];
        if (!explains(now, least))
            break;
        *current = more;
        added = 1;
        HADA_TRY(hada_search_move(s, current, HADA_FIDELITY_FINE, err));
    }
    if (added)
        HADA_TRY(drop_hidden(s, current, err));
    /* no room for more, and all are needed; in a row they are one or two that stand between depths */
    s->result->all = added && current->count == o->max_depths && o->max_depths < o->depths && !is_row(current);
    return HADA_OK;
}

hada_status hada_search_hidden(hada_search *s, hada_error *err)
{
    const hada_pursuit_result *result = s->result;
    hada_set found = {.count = result->count};
    memcpy(found.depth, result->list, sizeof found.depth);
    HADA_TRY(part(s, &found, err));
    return hada_search_report(s, &found, 1, err);
}
