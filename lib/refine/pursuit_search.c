#include "refine/pursuit_search.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    SHORTLIST = 3 /* candidates, first in order, that are evaluated for an addition: docs/explanation/refinement.md */
};

/* What a model leaves of a frame that it knows, as a part of the frame's amplitude: eight steps do not come closer, and
 * transfer functions from pairs are no better. Below it nothing counts. */
#define MODEL_ERROR 0.008

/* Around the threshold, as parts of it, a reduction is close, and the finer grid decides; so it does between two sets
 * of which one leaves less than this times as much as the other. Grids differed by less
 * (docs/explanation/refinement.md). */
#define CLOSE_BELOW 0.6
#define CLOSE_ABOVE 1.4
#define CLOSE_RATIO 1.15

/* The first depth need only beat noise, which one depth explains little of; a rough model of a bright
 * scene is not darkness. */
#define FIRST_THRESHOLD 0.2

/* An addition may stand one step off, or the first depth between two true ones: moving helps, unless the addition
 * explains next to nothing, or, beyond a pair, already a good part. */
#define MOVE_FROM    0.1
#define MOVE_PAIR_TO 0.9
#define MOVE_TO      0.5

/* A scene of many depths: what k of them leave, unmoved, is above MANY_LEAVE / k of the frame's amplitude, and all
 * depths together leave less than the part ALL_LEAVE of the energy that the largest set leaves: between what scenes of
 * three and of all depths left (docs/explanation/refinement.md). */
#define MANY_LEAVE 0.12
#define ALL_LEAVE  0.55

/* What a set leaves. */
static hada_status residual_of_set(hada_search *s, hada_fidelity fidelity, const hada_set *set, double *energy,
                                   hada_error *err)
{
    return hada_residuals_of(s->residuals, fidelity, set, 1, energy, err);
}

/* What the candidates leave, into s->energy. */
static hada_status search_evaluate(hada_search *s, hada_fidelity fidelity, hada_error *err)
{
    return hada_residuals_of(s->residuals, fidelity, s->candidates, s->count, s->energy, err);
}

/* The candidate that leaves least and was not yet taken; *energy: what it leaves, INFINITY where all are taken. */
static int search_take_best(hada_search *s, double *energy)
{
    int best = 0;
    for (int i = 1; i < s->count; i++)
        if (s->energy[i] < s->energy[best])
            best = i;
    *energy = s->energy[best];
    s->energy[best] = INFINITY;
    return best;
}

/* The part of what `smaller` leaves that `larger` explains. */
static hada_status reduction_at(hada_search *s, hada_fidelity fidelity, const hada_set *smaller, const hada_set *larger,
                                double *reduction, hada_error *err)
{
    double frame, before, after;
    HADA_TRY(hada_residuals_frame(s->residuals, fidelity, &frame, err));
    hada_residuals_ahead(s->residuals, fidelity, larger, 1);
    HADA_TRY(residual_of_set(s, fidelity, smaller, &before, err));
    HADA_TRY(residual_of_set(s, fidelity, larger, &after, err));
    *reduction = before > 0.0 ? (before - after) / (before + MODEL_ERROR * MODEL_ERROR * frame) : 0.0;
    return HADA_OK;
}

static double threshold_of(const hada_search *s, const hada_set *smaller)
{
    const double threshold = s->pursuit->options.threshold;
    return smaller->count ? threshold : fmin(threshold, FIRST_THRESHOLD);
}

/* The same, as closely as it takes. A larger set converges later, so few steps make its reduction too small, never too
 * large: one that is clearly enough is, one that is not is given more steps. */
static hada_status reduction_of(hada_search *s, const hada_set *smaller, const hada_set *larger, double *reduction,
                                hada_error *err)
{
    const double high = CLOSE_ABOVE * threshold_of(s, smaller), low = CLOSE_BELOW * threshold_of(s, smaller);
    HADA_TRY(reduction_at(s, HADA_FIDELITY_COARSE, smaller, larger, reduction, err));
    if (*reduction > high)
        return HADA_OK;
    HADA_TRY(reduction_at(s, HADA_FIDELITY_CONVERGED, smaller, larger, reduction, err));
    if (*reduction > high || *reduction < low)
        return HADA_OK;
    s->result->fine_comparisons++;
    HADA_TRY(reduction_at(s, HADA_FIDELITY_FINE, smaller, larger, reduction, err));
    return HADA_OK;
}

/* Whether `moved` leaves less than `current`, evaluated no closer than `finest`. */
static hada_status is_better(hada_search *s, const hada_set *current, const hada_set *moved, hada_fidelity finest,
                             int *better, hada_error *err)
{
    *better = 0;
    for (int fidelity = HADA_FIDELITY_COARSE; fidelity <= (int)finest; fidelity++) {
        double now, then;
        s->result->fine_comparisons += fidelity == HADA_FIDELITY_FINE;
        hada_residuals_ahead(s->residuals, (hada_fidelity)fidelity, moved, 1);
        HADA_TRY(residual_of_set(s, (hada_fidelity)fidelity, current, &now, err));
        HADA_TRY(residual_of_set(s, (hada_fidelity)fidelity, moved, &then, err));
        *better = then < now;
        if (then > CLOSE_RATIO * now || now > CLOSE_RATIO * then)
            break;
    }
    return HADA_OK;
}

/* All sets with one depth moved to a free neighbour; how many. */
static int moves_of(const hada_search *s, const hada_set *current, hada_set *moves)
{
    int count = 0;
    for (int place = 0; place < current->count; place++)
        for (int side = -1; side <= 1; side += 2) {
            const int depth = current->depth[place] + side;
            const hada_set rest = hada_set_without(current, place);
            if (depth >= 0 && depth < s->pursuit->options.depths && !hada_set_has(current, depth))
                moves[count++] = hada_set_with(&rest, depth);
        }
    return count;
}

/* What the candidates may be moved to next. */
static void moves_ahead(hada_search *s)
{
    hada_set next[2 * HADA_PURSUIT_MAX];
    for (int i = 0; i < s->count; i++)
        hada_residuals_ahead(s->residuals, HADA_FIDELITY_COARSE, next, moves_of(s, &s->candidates[i], next));
}

/* All sets with a depth less; how many. */
static int search_reductions(const hada_set *current, hada_set *less)
{
    for (int place = 0; place < current->count; place++)
        less[place] = hada_set_without(current, place);
    return current->count;
}

/* The candidates that leave no more than `most` may have to be told apart more closely. */
static void rivals_ahead(hada_search *s, double most)
{
    for (int i = 0; i < s->count; i++)
        for (int fidelity = HADA_FIDELITY_CONVERGED; s->energy[i] <= most && fidelity <= HADA_FIDELITY_FINE; fidelity++)
            hada_residuals_ahead(s->residuals, (hada_fidelity)fidelity, &s->candidates[i], 1);
}

/* The best of the moves that leaves less than *current, which takes it. */
static hada_status move_once(hada_search *s, hada_set *current, hada_fidelity finest, int *moved, hada_error *err)
{
    double now, energy;
    *moved = 0;
    s->count = moves_of(s, current, s->candidates);
    if (!s->count)
        return HADA_OK;
    hada_residuals_ahead(s->residuals, HADA_FIDELITY_COARSE, s->candidates, s->count);
    HADA_TRY(residual_of_set(s, HADA_FIDELITY_COARSE, current, &now, err));
    moves_ahead(s);
    HADA_TRY(search_evaluate(s, HADA_FIDELITY_COARSE, err));
    if (finest == HADA_FIDELITY_FINE)
        rivals_ahead(s, CLOSE_RATIO * now);
    for (int tried = 0; !*moved && tried < s->count; tried++) {
        const int best = search_take_best(s, &energy);
        if (energy > CLOSE_RATIO * now)
            break;
        HADA_TRY(is_better(s, current, &s->candidates[best], finest, moved, err));
        if (*moved)
            *current = s->candidates[best];
    }
    return HADA_OK;
}

/* Local search: moves depths of *current to free neighbours while that leaves less. */
static hada_status search_move(hada_search *s, hada_set *current, hada_fidelity finest, hada_error *err)
{
    int moved = 1;
    for (int sweep = 0; moved && sweep < 2 * s->pursuit->options.depths; sweep++)
        HADA_TRY(move_once(s, current, finest, &moved, err));
    return HADA_OK;
}

/* Drops depths of *current that the others explain as well. */
static hada_status prune(hada_search *s, hada_set *current, hada_error *err)
{
    while (current->count > 1) {
        double least, reduction;
        s->count = search_reductions(current, s->candidates);
        HADA_TRY(search_evaluate(s, HADA_FIDELITY_COARSE, err));
        const hada_set less = s->candidates[search_take_best(s, &least)];
        HADA_TRY(reduction_of(s, &less, current, &reduction, err));
        if (reduction >= s->pursuit->options.threshold)
            break;
        *current = less;
    }
    return HADA_OK;
}

/* Lists the sets of one depth more than *current: the first few of those that leave least, evaluated so, and no more
 * than `most`. */
static hada_status search_shortlist(hada_search *s, const hada_set *current, hada_fidelity fidelity, double most,
                                    hada_error *err)
{
    hada_set first[SHORTLIST];
    double energy;
    int count = 0;
    s->count = 0;
    for (int depth = 0; depth < s->pursuit->options.depths; depth++)
        if (!hada_set_has(current, depth))
            s->candidates[s->count++] = hada_set_with(current, depth);
    HADA_TRY(search_evaluate(s, fidelity, err));
    while (count < SHORTLIST && count < s->count) {
        const int best = search_take_best(s, &energy);
        if (energy > most)
            break;
        first[count++] = s->candidates[best];
    }
    memcpy(s->candidates, first, (size_t)count * sizeof *first);
    s->count = count;
    return HADA_OK;
}

/* Of the candidates the one that leaves least; *energy: how much. */
static hada_status best_candidate(hada_search *s, hada_set *best, double *energy, hada_error *err)
{
    HADA_TRY(search_evaluate(s, HADA_FIDELITY_COARSE, err));
    *best = s->candidates[search_take_best(s, energy)];
    return HADA_OK;
}

/* Whether the frame holds more depths than a set has room for, found out at a pair, before any set is moved: depths
 * are added as they come, and must leave much at every size; all depths together must leave much less than the largest
 * set. *largest is then that set. */
static hada_status detect_many(hada_search *s, const hada_set *pair, hada_set *largest, int *many, hada_error *err)
{
    const hada_pursuit_options *o = &s->pursuit->options;
    double frame, energy, all;
    *many = 0;
    if (o->full || o->max_depths == o->depths)
        return HADA_OK;
    *largest = *pair;
    HADA_TRY(hada_residuals_frame(s->residuals, HADA_FIDELITY_COARSE, &frame, err));
    HADA_TRY(residual_of_set(s, HADA_FIDELITY_COARSE, pair, &energy, err));
    for (;;) {
        const double much = MANY_LEAVE / largest->count;
        if (energy < much * much * frame)
            return HADA_OK;
        if (largest->count == o->max_depths)
            break;
        HADA_TRY(search_shortlist(s, largest, HADA_FIDELITY_RANKING, INFINITY, err));
        HADA_TRY(best_candidate(s, largest, &energy, err));
    }
    HADA_TRY(hada_residuals_of_all(s->residuals, &all, err));
    *many = all < ALL_LEAVE * energy;
    return HADA_OK;
}

/* The best addition to *current: *more is the larger set, moved where that may help. *many: there are more depths than
 * a set has room for. */
static hada_status best_addition(hada_search *s, const hada_set *current, hada_set *more, int *many, hada_error *err)
{
    const hada_pursuit_options *o = &s->pursuit->options;
    const int last = current->count + 1 == o->max_depths && o->max_depths < o->depths;
    hada_set largest = {0}, less[HADA_PURSUIT_MAX];
    double reduction, energy;
    *many = 0;
    /* where nothing is added, these come next */
    hada_residuals_ahead(s->residuals, HADA_FIDELITY_COARSE, less, search_reductions(current, less));
    HADA_TRY(search_shortlist(s, current, HADA_FIDELITY_RANKING, INFINITY, err));
    /* the last one that there is room for: that it is needed says enough, which one it is does not matter */
    if (last) {
        *more = s->candidates[0];
        HADA_TRY(reduction_at(s, HADA_FIDELITY_COARSE, current, more, &reduction, err));
        if (reduction > CLOSE_ABOVE * o->threshold)
            return HADA_OK;
    }
    HADA_TRY(best_candidate(s, more, &energy, err));
    if (more->count == 2)
        HADA_TRY(detect_many(s, more, &largest, many, err));
    if (*many) {
        *more = largest;
        return HADA_OK;
    }
    HADA_TRY(reduction_at(s, HADA_FIDELITY_COARSE, current, more, &reduction, err));
    if (current->count && reduction >= MOVE_FROM && reduction <= (current->count == 1 ? MOVE_PAIR_TO : MOVE_TO))
        HADA_TRY(search_move(s, more, HADA_FIDELITY_COARSE, err));
    return HADA_OK;
}

/* Adds a depth to *found where one explains enough (*added). Where the frame holds too many to tell apart (result->all)
 * *found is the largest set. */
static hada_status add(hada_search *s, hada_set *found, int *added, hada_error *err)
{
    hada_pursuit_result *result = s->result;
    hada_set more;
    double reduction;
    *added = 0;
    HADA_TRY(best_addition(s, found, &more, &result->all, err));
    if (!result->all) {
        HADA_TRY(reduction_of(s, found, &more, &reduction, err));
        result->reduction[result->rounds++] = reduction;
        *added = reduction >= threshold_of(s, found);
        result->more = *added ? 0.0 : reduction;
    }
    if (result->all || *added)
        *found = more;
    return HADA_OK;
}

static hada_status pursue(hada_search *s, hada_set *found, hada_error *err)
{
    const hada_pursuit_options *o = &s->pursuit->options;
    hada_pursuit_result *result = s->result;
    while (result->rounds < 2 * HADA_PURSUIT_MAX) {
        const int room = found->count < o->max_depths;
        int added = 0;
        if (room)
            HADA_TRY(add(s, found, &added, err));
        if (result->all)
            break;
        if (added)
            continue;
        /* nothing to add, or no room: unless a smaller set or a moved one is better, this is it */
        const hada_set before = *found;
        if (found->count)
            HADA_TRY(prune(s, found, err));
        if (found->count && room)
            HADA_TRY(search_move(s, found, HADA_FIDELITY_FINE, err));
        if (hada_set_same(&before, found)) {
            result->all = !room && o->max_depths < o->depths;
            break;
        }
    }
    return HADA_OK;
}

/* Takes down what was found, and whether depths may hide beside it, unless these were looked for (parted). */
static hada_status search_report(hada_search *s, const hada_set *found, int parted, hada_error *err)
{
    const hada_pursuit *p = s->pursuit;
    hada_pursuit_result *result = s->result;
    double frame, energy;
    HADA_TRY(hada_residuals_frame(s->residuals, HADA_FIDELITY_COARSE, &frame, err));
    HADA_TRY(residual_of_set(s, HADA_FIDELITY_COARSE, found, &energy, err));
    result->residual = frame > 0.0 ? sqrt(energy / frame) : 0.0;
    result->count = found->count;
    memcpy(result->list, found->depth, sizeof found->depth);
    result->hides = p->parts && !parted && !result->all && found->count > 1 && found->count < p->options.max_depths;
    return HADA_OK;
}

hada_status hada_search_depths(hada_search *s, hada_error *err)
{
    hada_set found = {0};
    HADA_TRY(pursue(s, &found, err));
    return search_report(s, &found, 0, err);
}

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
    HADA_TRY(residual_of_set(s, HADA_FIDELITY_CONVERGED, current, &now, err));
    HADA_TRY(search_shortlist(s, current, HADA_FIDELITY_CONVERGED, (1.0 - GLIMPSE) * now, err));
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
    s->count = search_reductions(current, s->candidates);
    HADA_TRY(residual_of_set(s, HADA_FIDELITY_FINE, current, &now, err));
    HADA_TRY(search_evaluate(s, HADA_FIDELITY_FINE, err));
    const hada_set less = s->candidates[search_take_best(s, &least)];
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
        HADA_TRY(residual_of_set(s, HADA_FIDELITY_FINE, current, &now, err));
        HADA_TRY(search_evaluate(s, HADA_FIDELITY_FINE, err));
        const hada_set more = s->candidates[search_take_best(s, &least)];
        if (!explains(now, least))
            break;
        *current = more;
        added = 1;
        HADA_TRY(search_move(s, current, HADA_FIDELITY_FINE, err));
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
    return search_report(s, &found, 1, err);
}
