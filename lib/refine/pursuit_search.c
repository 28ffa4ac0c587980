#include "refine/pursuit_sets.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"

enum { LOOKS = 3 /* candidates, first in order, that are judged for an addition */ };

/* What a model leaves of a frame that it knows, as a part of the frame's amplitude: eight steps do not come closer, and
 * transfer functions from pairs are no better. Below it nothing counts. */
#define FLOOR 0.008

/* Around the threshold, as parts of it, a fall is close, and the finer grid decides; so it does between two sets of
 * which one leaves less than this times as much as the other. Grids differed by less (docs/refinement.md). */
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
 * depths together leave less than the part ALL_LEAVE of the energy that the largest set leaves. */
#define MANY_LEAVE 0.12
#define ALL_LEAVE  0.55

typedef struct search {
    hada_pursuit *pursuit;
    hada_pursuit_result *result;
    hada_looks looks;
    hada_set variations[HADA_PURSUIT_DEPTHS]; /* of a set, all of one size */
    double left[HADA_PURSUIT_DEPTHS];         /* by the variations */
    int varied;
} search;

/* The part of what `smaller` leaves that `larger` explains, in one look. */
static hada_status fall_in(search *s, hada_pursuit_look look, const hada_set *smaller, const hada_set *larger,
                           double *fall, hada_error *err)
{
    double energy, before, after;
    hada_status status = hada_looks_energy(&s->looks, look, &energy, err);
    if (!status)
        status = hada_looks_left(&s->looks, look, smaller, 1, &before, err);
    if (!status)
        status = hada_looks_left(&s->looks, look, larger, 1, &after, err);
    if (!status)
        *fall = before > 0.0 ? (before - after) / (before + FLOOR * FLOOR * energy) : 0.0;
    return status;
}

static double threshold_of(const search *s, const hada_set *smaller)
{
    const double threshold = s->pursuit->options.threshold;
    return smaller->count ? threshold : fmin(threshold, FIRST_THRESHOLD);
}

/* The same, in as many looks as it takes. A larger set settles later, so few steps make its fall too small, never too
 * large: a fall that is clearly enough is, one that is not is given time. */
static hada_status fall_of(search *s, const hada_set *smaller, const hada_set *larger, double *fall, hada_error *err)
{
    const double high = CLOSE_ABOVE * threshold_of(s, smaller), low = CLOSE_BELOW * threshold_of(s, smaller);
    hada_status status = fall_in(s, HADA_LOOK_JUDGE, smaller, larger, fall, err);
    if (status || *fall > high)
        return status;
    status = fall_in(s, HADA_LOOK_PATIENT, smaller, larger, fall, err);
    if (status || *fall > high || *fall < low)
        return status;
    s->result->closer++;
    return fall_in(s, HADA_LOOK_CLOSER, smaller, larger, fall, err);
}

/* Whether `moved` leaves less than `current`; `closely`: in as many looks as it takes. */
static hada_status is_better(search *s, const hada_set *current, const hada_set *moved, int closely, int *better,
                             hada_error *err)
{
    hada_status status = HADA_OK;
    for (int look = HADA_LOOK_JUDGE; !status && look <= (closely ? HADA_LOOK_CLOSER : HADA_LOOK_JUDGE); look++) {
        double now, then;
        s->result->closer += look == HADA_LOOK_CLOSER;
        status = hada_looks_left(&s->looks, (hada_pursuit_look)look, current, 1, &now, err);
        if (!status)
            status = hada_looks_left(&s->looks, (hada_pursuit_look)look, moved, 1, &then, err);
        *better = !status && then < now;
        if (then > CLOSE_RATIO * now || now > CLOSE_RATIO * then)
            break;
    }
    return status;
}

/* The variation that leaves least and was not yet taken (which has left = INFINITY then). */
static int take_best(search *s, double *left)
{
    int best = 0;
    for (int i = 1; i < s->varied; i++)
        if (s->left[i] < s->left[best])
            best = i;
    *left = s->left[best];
    s->left[best] = INFINITY;
    return best;
}

/* Moves depths of *current to free neighbours while that leaves less; `closely`: in as many looks as it takes. */
static hada_status settle(search *s, hada_set *current, int closely, hada_error *err)
{
    const hada_pursuit *p = s->pursuit;
    hada_status status = HADA_OK;
    for (int sweep = 0; sweep < 2 * p->options.depths; sweep++) {
        double now;
        s->varied = 0;
        for (int place = 0; place < current->count; place++)
            for (int side = -1; side <= 1; side += 2) {
                const int depth = current->depth[place] + side;
                const hada_set rest = hada_set_without(current, place);
                if (depth >= 0 && depth < p->options.depths && !hada_set_has(current, depth))
                    s->variations[s->varied++] = hada_set_with(&rest, depth);
            }
        if (!s->varied)
            return HADA_OK;
        status = hada_looks_left(&s->looks, HADA_LOOK_JUDGE, current, 1, &now, err);
        if (!status)
            status = hada_looks_left(&s->looks, HADA_LOOK_JUDGE, s->variations, s->varied, s->left, err);
        int better = 0;
        for (int tried = 0; !status && !better && tried < s->varied; tried++) {
            double left;
            const int best = take_best(s, &left);
            if (left > CLOSE_RATIO * now)
                break;
            status = is_better(s, current, &s->variations[best], closely, &better, err);
            if (better)
                *current = s->variations[best];
        }
        if (status || !better)
            return status;
    }
    return status;
}

/* Drops depths of *current that the others explain as well. */
static hada_status drop(search *s, hada_set *current, hada_error *err)
{
    hada_status status = HADA_OK;
    while (!status && current->count > 1) {
        double least, fall;
        s->varied = current->count;
        for (int place = 0; place < current->count; place++)
            s->variations[place] = hada_set_without(current, place);
        status = hada_looks_left(&s->looks, HADA_LOOK_JUDGE, s->variations, s->varied, s->left, err);
        if (status)
            return status;
        const hada_set less = s->variations[take_best(s, &least)];
        status = fall_of(s, &less, current, &fall, err);
        if (status || fall >= s->pursuit->options.threshold)
            return status;
        *current = less;
    }
    return status;
}

/* Keeps the LOOKS variations that come first in the order of the smallest grid. */
static hada_status keep_first(search *s, hada_error *err)
{
    hada_set first[LOOKS];
    double left;
    hada_status status = hada_looks_left(&s->looks, HADA_LOOK_ORDER, s->variations, s->varied, s->left, err);
    const int count = s->varied < LOOKS ? s->varied : LOOKS;
    for (int i = 0; !status && i < count; i++)
        first[i] = s->variations[take_best(s, &left)];
    if (!status)
        memcpy(s->variations, first, (size_t)count * sizeof *first);
    s->varied = count;
    return status;
}

/* All sets of one depth more than *current, the most promising alone. */
static hada_status list_additions(search *s, const hada_set *current, hada_error *err)
{
    s->varied = 0;
    for (int depth = 0; depth < s->pursuit->options.depths; depth++)
        if (!hada_set_has(current, depth))
            s->variations[s->varied++] = hada_set_with(current, depth);
    return keep_first(s, err);
}

/* Of the variations the one that leaves least; *left (may be NULL) takes how much. */
static hada_status judge(search *s, hada_set *best, double *left, hada_error *err)
{
    double least;
    hada_status status = hada_looks_left(&s->looks, HADA_LOOK_JUDGE, s->variations, s->varied, s->left, err);
    if (!status)
        *best = s->variations[take_best(s, &least)];
    if (!status && left)
        *left = least;
    return status;
}

/* Whether the frame holds more depths than a set has room for, found out at a pair, before any set is moved: depths
 * are added as they come, and must leave much at every size; all depths together must leave much less than the largest
 * set. *many is then that set. */
static hada_status look_for_many(search *s, const hada_set *pair, hada_set *many, int *found, hada_error *err)
{
    const hada_pursuit_options *o = &s->pursuit->options;
    double energy, left, all;
    *found = 0;
    if (o->full || o->max_depths == o->depths)
        return HADA_OK;
    *many = *pair;
    hada_status status = hada_looks_energy(&s->looks, HADA_LOOK_JUDGE, &energy, err);
    if (!status)
        status = hada_looks_left(&s->looks, HADA_LOOK_JUDGE, pair, 1, &left, err);
    while (!status) {
        const double much = MANY_LEAVE / many->count;
        if (left < much * much * energy)
            return HADA_OK;
        if (many->count == o->max_depths)
            break;
        status = list_additions(s, many, err);
        if (!status)
            status = judge(s, many, &left, err);
    }
    if (!status)
        status = hada_looks_all(&s->looks, &all, err);
    *found = !status && all < ALL_LEAVE * left;
    return status;
}

/* The best addition to *current: *more is the larger set, moved where that may help. *many: there are more depths than
 * a set has room for. */
static hada_status grow(search *s, const hada_set *current, hada_set *more, int *many, hada_error *err)
{
    const hada_pursuit_options *o = &s->pursuit->options;
    const int last = current->count + 1 == o->max_depths && o->max_depths < o->depths;
    hada_set full;
    double fall;
    hada_status status = list_additions(s, current, err);
    *many = 0;
    /* the last one that there is room for: that it is needed says enough, which one it is does not matter */
    if (!status && last) {
        *more = s->variations[0];
        status = fall_in(s, HADA_LOOK_JUDGE, current, more, &fall, err);
        if (status || fall > CLOSE_ABOVE * o->threshold)
            return status;
    }
    if (!status)
        status = judge(s, more, NULL, err);
    if (!status && more->count == 2)
        status = look_for_many(s, more, &full, many, err);
    if (!status && *many)
        *more = full;
    if (!status && !*many)
        status = fall_in(s, HADA_LOOK_JUDGE, current, more, &fall, err);
    if (status || *many || !current->count || fall < MOVE_FROM || fall > (current->count == 1 ? MOVE_PAIR_TO : MOVE_TO))
        return status;
    return settle(s, more, 0, err);
}

static hada_status run(search *s, hada_set *found, hada_error *err)
{
    const hada_pursuit_options *o = &s->pursuit->options;
    hada_pursuit_result *result = s->result;
    hada_status status = HADA_OK;
    while (!status && result->rounds < 2 * HADA_PURSUIT_MAX) {
        const int room = found->count < o->max_depths;
        hada_set more;
        double fall = 0.0;
        if (room) {
            status = grow(s, found, &more, &result->all, err);
            if (!status && result->all)
                *found = more;
            if (status || result->all)
                break;
            status = fall_of(s, found, &more, &fall, err);
            if (status)
                break;
            result->fall[result->rounds++] = fall;
            if (fall >= threshold_of(s, found)) {
                *found = more;
                continue;
            }
        }
        /* nothing to add, or no room: unless a smaller set or a moved one is better, this is it */
        const hada_set before = *found;
        if (found->count)
            status = drop(s, found, err);
        if (!status && found->count && room)
            status = settle(s, found, 1, err);
        if (!status && hada_set_same(&before, found)) {
            result->all = !room && o->max_depths < o->depths;
            break;
        }
    }
    return status;
}

hada_status hada_pursuit_search(hada_pursuit *p, hada_pursuit_result *result, hada_error *err)
{
    search *s;
    hada_set found = {0};
    double energy = 0.0, left = 0.0;
    hada_status status = hada_alloc((void **)&s, 1, sizeof *s, "the depth pursuit", err);
    if (status)
        return status;
    s->pursuit = s->looks.pursuit = p;
    s->result = result;
    status = run(s, &found, err);
    if (!status)
        status = hada_looks_energy(&s->looks, HADA_LOOK_JUDGE, &energy, err);
    if (!status)
        status = hada_looks_left(&s->looks, HADA_LOOK_JUDGE, &found, 1, &left, err);
    result->residual = energy > 0.0 ? sqrt(left / energy) : 0.0;
    result->count = found.count;
    memcpy(result->list, found.depth, sizeof found.depth);
    hada_looks_free(&s->looks);
    free(s);
    return status;
}
