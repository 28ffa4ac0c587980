#include "refine/pursuit_search.h"

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

/* Depths in rising order. */
typedef struct set {
    int count, depth[HADA_PURSUIT_MAX];
} set;

/* A set that was refined, and what it left. */
typedef struct known {
    hada_pursuit_look look;
    set set;
    double left;
} known;

typedef struct search {
    hada_pursuit *pursuit;
    hada_pursuit_result *result;
    known *known;
    size_t count, room;
    set variations[HADA_PURSUIT_DEPTHS]; /* of a set, all of one size */
    double left[HADA_PURSUIT_DEPTHS];    /* by the variations */
    int varied;
} search;

static int same(const set *a, const set *b)
{
    return a->count == b->count && !memcmp(a->depth, b->depth, (size_t)a->count * sizeof *a->depth);
}

static int member(const set *s, int depth)
{
    for (int i = 0; i < s->count; i++)
        if (s->depth[i] == depth)
            return 1;
    return 0;
}

static set with(const set *s, int depth)
{
    set more = {.count = s->count + 1};
    int i = 0;
    for (; i < s->count && s->depth[i] < depth; i++)
        more.depth[i] = s->depth[i];
    more.depth[i] = depth;
    for (; i < s->count; i++)
        more.depth[i + 1] = s->depth[i];
    return more;
}

static set without(const set *s, int place)
{
    set less = {.count = s->count - 1};
    for (int i = 0; i < less.count; i++)
        less.depth[i] = s->depth[i < place ? i : i + 1];
    return less;
}

/* The looks differ in steps or in grid: where two are the same, the first one's results serve. */
static hada_pursuit_look plain(const search *s, hada_pursuit_look look)
{
    for (int i = 0; i < (int)look; i++)
        if (s->pursuit->looks[i].level == s->pursuit->looks[look].level &&
            s->pursuit->looks[i].steps == s->pursuit->looks[look].steps)
            return (hada_pursuit_look)i;
    return look;
}

static const known *find(const search *s, hada_pursuit_look look, const set *wanted)
{
    for (size_t i = 0; i < s->count; i++)
        if (s->known[i].look == look && same(&s->known[i].set, wanted))
            return &s->known[i];
    return NULL;
}

static hada_status make_room(search *s, size_t more, hada_error *err)
{
    if (s->count + more <= s->room)
        return HADA_OK;
    const size_t room = 2 * s->room + more;
    known *larger;
    hada_status status = hada_alloc((void **)&larger, room, sizeof *larger, "the depth pursuit", err);
    if (status)
        return status;
    if (s->count)
        memcpy(larger, s->known, s->count * sizeof *larger);
    free(s->known);
    s->known = larger;
    s->room = room;
    return HADA_OK;
}

static double energy_of(const search *s, hada_pursuit_look look)
{
    return s->pursuit->levels[s->pursuit->looks[look].level].energy;
}

/* What each of `count` sets of one size leaves to a look; those not yet known are refined side by side. */
static hada_status refine(search *s, hada_pursuit_look asked, const set *sets, int count, double *left, hada_error *err)
{
    hada_pursuit *p = s->pursuit;
    const hada_pursuit_look look = plain(s, asked);
    int list[HADA_PURSUIT_DEPTHS * HADA_PURSUIT_MAX], missing = 0;
    double fresh[HADA_PURSUIT_DEPTHS];
    const int places = sets[0].count;
    const size_t first = s->count;
    hada_status status = make_room(s, (size_t)count, err);
    if (status)
        return status;
    if (!places) {
        left[0] = energy_of(s, look);
        return HADA_OK;
    }
    for (int i = 0; i < count; i++)
        if (!find(s, look, &sets[i])) {
            memcpy(list + missing * places, sets[i].depth, (size_t)places * sizeof *list);
            missing++;
            s->known[s->count++] = (known){look, sets[i], 0.0};
        }
    if (missing)
        status =
            hada_level_left(&p->levels[p->looks[look].level], p->looks[look].steps, missing, places, list, fresh, err);
    for (int i = 0; !status && i < missing; i++)
        s->known[first + (size_t)i].left = fresh[i];
    for (int i = 0; !status && i < count; i++)
        left[i] = find(s, look, &sets[i])->left;
    return status;
}

/* The part of what `smaller` leaves that `larger` explains, in one look. */
static hada_status fall_in(search *s, hada_pursuit_look look, const set *smaller, const set *larger, double *fall,
                           hada_error *err)
{
    const double floor = FLOOR * FLOOR * energy_of(s, look);
    double before, after;
    hada_status status = refine(s, look, smaller, 1, &before, err);
    if (!status)
        status = refine(s, look, larger, 1, &after, err);
    if (!status)
        *fall = before > 0.0 ? (before - after) / (before + floor) : 0.0;
    return status;
}

static double threshold_of(const search *s, const set *smaller)
{
    const double threshold = s->pursuit->options.threshold;
    return smaller->count ? threshold : fmin(threshold, FIRST_THRESHOLD);
}

/* The same, in as many looks as it takes. A larger set settles later, so few steps make its fall too small, never too
 * large: a fall that is clearly enough is, one that is not is given time. */
static hada_status fall_of(search *s, const set *smaller, const set *larger, double *fall, hada_error *err)
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
static hada_status is_better(search *s, const set *current, const set *moved, int closely, int *better, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int look = HADA_LOOK_JUDGE; !status && look <= (closely ? HADA_LOOK_CLOSER : HADA_LOOK_JUDGE); look++) {
        double now, then;
        s->result->closer += look == HADA_LOOK_CLOSER;
        status = refine(s, (hada_pursuit_look)look, current, 1, &now, err);
        if (!status)
            status = refine(s, (hada_pursuit_look)look, moved, 1, &then, err);
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
static hada_status settle(search *s, set *current, int closely, hada_error *err)
{
    const hada_pursuit *p = s->pursuit;
    hada_status status = HADA_OK;
    for (int sweep = 0; sweep < 2 * p->options.depths; sweep++) {
        double now;
        s->varied = 0;
        for (int place = 0; place < current->count; place++)
            for (int side = -1; side <= 1; side += 2) {
                const int depth = current->depth[place] + side;
                const set rest = without(current, place);
                if (depth >= 0 && depth < p->options.depths && !member(current, depth))
                    s->variations[s->varied++] = with(&rest, depth);
            }
        if (!s->varied)
            return HADA_OK;
        status = refine(s, HADA_LOOK_JUDGE, current, 1, &now, err);
        if (!status)
            status = refine(s, HADA_LOOK_JUDGE, s->variations, s->varied, s->left, err);
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
static hada_status drop(search *s, set *current, hada_error *err)
{
    hada_status status = HADA_OK;
    while (!status && current->count > 1) {
        double least, fall;
        s->varied = current->count;
        for (int place = 0; place < current->count; place++)
            s->variations[place] = without(current, place);
        status = refine(s, HADA_LOOK_JUDGE, s->variations, s->varied, s->left, err);
        if (status)
            return status;
        const set less = s->variations[take_best(s, &least)];
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
    set first[LOOKS];
    double left;
    hada_status status = refine(s, HADA_LOOK_ORDER, s->variations, s->varied, s->left, err);
    const int count = s->varied < LOOKS ? s->varied : LOOKS;
    for (int i = 0; !status && i < count; i++)
        first[i] = s->variations[take_best(s, &left)];
    if (!status)
        memcpy(s->variations, first, (size_t)count * sizeof *first);
    s->varied = count;
    return status;
}

/* The best addition to *current: *more is the larger set, moved where that may help. */
static hada_status grow(search *s, const set *current, set *more, hada_error *err)
{
    const hada_pursuit_options *o = &s->pursuit->options;
    const int last = current->count + 1 == o->max_depths && o->max_depths < o->depths;
    double left, fall;
    s->varied = 0;
    for (int depth = 0; depth < o->depths; depth++)
        if (!member(current, depth))
            s->variations[s->varied++] = with(current, depth);
    hada_status status = keep_first(s, err);
    /* the last one that there is room for: that it is needed says enough, which one it is does not matter */
    if (!status && last) {
        *more = s->variations[0];
        status = fall_in(s, HADA_LOOK_JUDGE, current, more, &fall, err);
        if (status || fall > CLOSE_ABOVE * o->threshold)
            return status;
    }
    if (!status)
        status = refine(s, HADA_LOOK_JUDGE, s->variations, s->varied, s->left, err);
    if (status)
        return status;
    *more = s->variations[take_best(s, &left)];
    status = fall_in(s, HADA_LOOK_JUDGE, current, more, &fall, err);
    if (status || !current->count || fall < MOVE_FROM || fall > (current->count == 1 ? MOVE_PAIR_TO : MOVE_TO))
        return status;
    return settle(s, more, 0, err);
}

static hada_status run(search *s, set *found, hada_error *err)
{
    const hada_pursuit_options *o = &s->pursuit->options;
    hada_pursuit_result *result = s->result;
    hada_status status = HADA_OK;
    while (!status && result->rounds < 2 * HADA_PURSUIT_MAX) {
        const int room = found->count < o->max_depths;
        set more;
        double fall = 0.0;
        if (room) {
            status = grow(s, found, &more, err);
            if (!status)
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
        const set before = *found;
        if (found->count)
            status = drop(s, found, err);
        if (!status && found->count && room)
            status = settle(s, found, 1, err);
        if (!status && same(&before, found)) {
            result->all = !room && o->max_depths < o->depths;
            break;
        }
    }
    return status;
}

hada_status hada_pursuit_search(hada_pursuit *p, hada_pursuit_result *result, hada_error *err)
{
    search *s;
    set found = {0};
    double left = 0.0;
    hada_status status = hada_alloc((void **)&s, 1, sizeof *s, "the depth pursuit", err);
    if (status)
        return status;
    s->pursuit = p;
    s->result = result;
    status = run(s, &found, err);
    if (!status)
        status = refine(s, HADA_LOOK_JUDGE, &found, 1, &left, err);
    const double energy = energy_of(s, HADA_LOOK_JUDGE);
    result->residual = energy > 0.0 ? sqrt(left / energy) : 0.0;
    result->count = found.count;
    memcpy(result->list, found.depth, sizeof found.depth);
    free(s->known);
    free(s);
    return status;
}
