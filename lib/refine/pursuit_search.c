#include "refine/pursuit_search.h"

#include <math.h>
#include <string.h>

/* Steps of a look at an addition and of a comparison of sets. A depth added to a settled set first makes things worse:
 * four steps named a quarter of the wrong depths in the trials of docs/refinement.md, more than eight changed none. */
enum { LOOK = 8, COMPARE = 12 };

/* The first depth need only beat noise, which one depth explains little of; a rough model of a bright
 * scene is not darkness. */
#define FIRST_THRESHOLD 0.2

/* A set of depths and where each place starts from. */
typedef struct trial {
    int count;
    int depth[HADA_PURSUIT_MAX], kept[HADA_PURSUIT_MAX];
    hada_refine_from from[HADA_PURSUIT_MAX];
} trial;

typedef struct search {
    hada_pursuit *pursuit;
    hada_refine_data data;
    trial trials[HADA_PURSUIT_DEPTHS]; /* variations of a set, all of one size */
    int count;
    double energy; /* of the frame itself */
} search;

static hada_refine_data coarse_data(const hada_pursuit *pursuit)
{
    return (hada_refine_data){.spectrum = pursuit->spectrum.mem,
                              .frame = pursuit->frame.mem,
                              .otf = pursuit->otf.mem,
                              .otf_depths = pursuit->options.depths,
                              .prior = pursuit->has_prior ? pursuit->prior.mem : NULL,
                              .doubt = pursuit->has_doubt ? pursuit->doubt.mem : NULL};
}

static hada_status load(const search *s, const hada_refine_state *from, int first, int sets, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int set = 0; !status && set < sets; set++) {
        const trial *t = &s->trials[first + set];
        for (int place = 0; !status && place < t->count; place++)
            status = hada_refine_state_load(from, s->pursuit->refiner, set, t->count, place, t->kept[place],
                                            t->from[place], err);
        if (!status)
            status = hada_refine_state_load_split(from, s->pursuit->refiner, set, err);
    }
    return status;
}

/* Refines all trials by `steps` steps, from the state `from` or (NULL) from nothing. *best takes the one that leaves
 * least, *left how much that is, `keep` (may be NULL, not `from`) its state. */
static hada_status refine(search *s, const hada_refine_state *from, int steps, hada_refine_state *keep, int *best,
                          double *left, hada_error *err)
{
    hada_refiner *refiner = s->pursuit->refiner;
    const int places = s->trials[0].count;
    int list[HADA_PURSUIT_DEPTHS * HADA_PURSUIT_MAX];
    double scores[HADA_PURSUIT_DEPTHS];
    hada_refine_rule rule;
    hada_status status = HADA_OK;
    hada_refine_rule_init(&rule);
    rule.rho = s->pursuit->options.rho;
    rule.steps = steps;
    rule.start = from ? HADA_REFINE_ON : HADA_REFINE_COLD;
    *best = 0;
    *left = INFINITY;
    for (int first = 0; !status && first < s->count; first += s->pursuit->shape.max_sets) {
        const int sets = s->count - first < s->pursuit->shape.max_sets ? s->count - first : s->pursuit->shape.max_sets;
        for (int set = 0; set < sets; set++)
            memcpy(list + set * places, s->trials[first + set].depth, (size_t)places * sizeof *list);
        status = from ? load(s, from, first, sets, err) : HADA_OK;
        if (!status)
            status = hada_refiner_run(refiner, &s->data, &rule, sets, places, list, NULL, err);
        /* where the sensor crops, only what is missing within the frame counts */
        if (!status)
            status = s->pursuit->shape.boundary == HADA_BOUNDARY_PADDED
                         ? hada_refiner_residual(refiner, &s->data, sets, places, list, scores, err)
                         : hada_refiner_score(refiner, &s->data, sets, places, list, scores, err);
        int winner = -1;
        for (int set = 0; !status && set < sets; set++)
            if (scores[set] < *left) {
                *left = scores[set];
                *best = first + set;
                winner = set;
            }
        if (!status && keep && winner >= 0)
            status = hada_refine_state_save(keep, refiner, winner, places, err);
        s->energy = hada_refiner_energy(refiner, 0, 0);
    }
    return status;
}

static int member(const trial *set, int depth)
{
    for (int i = 0; i < set->count; i++)
        if (set->depth[i] == depth)
            return 1;
    return 0;
}

/* The set itself, every place from its own kept one. */
static trial itself(const trial *set)
{
    trial same = {.count = set->count};
    for (int i = 0; i < set->count; i++) {
        same.depth[i] = set->depth[i];
        same.kept[i] = i;
        same.from[i] = HADA_REFINE_FROM_BOTH;
    }
    return same;
}

static trial with(const trial *set, int depth)
{
    trial more = itself(set);
    more.depth[more.count] = depth;
    more.from[more.count++] = HADA_REFINE_FROM_ZERO;
    return more;
}

static trial without(const trial *set, int place)
{
    trial less = {.count = set->count - 1};
    for (int i = 0; i < less.count; i++) {
        const int from = i < place ? i : i + 1;
        less.depth[i] = set->depth[from];
        less.kept[i] = from;
        less.from[i] = HADA_REFINE_FROM_BOTH;
    }
    return less;
}

static hada_status refine_one(search *s, trial one, const hada_refine_state *from, int steps, hada_refine_state *keep,
                              double *left, hada_error *err)
{
    int best;
    s->trials[0] = one;
    s->count = 1;
    return refine(s, from, steps, keep, &best, left, err);
}

static void exchange(hada_refine_state *a, hada_refine_state *b)
{
    const hada_refine_state kept = *a;
    *a = *b;
    *b = kept;
}

/* Moves depths of *set, whose state is `next`, to free neighbours while that leaves less. */
static hada_status swap(search *s, trial *set, double *left, hada_error *err)
{
    hada_pursuit *p = s->pursuit;
    hada_status status = HADA_OK;
    for (int sweep = 0; !status && sweep < p->options.depths; sweep++) {
        status = refine_one(s, itself(set), &p->next, LOOK, &p->best, left, err);
        if (status)
            return status;
        exchange(&p->next, &p->best);
        s->count = 0;
        for (int place = 0; place < set->count; place++)
            for (int side = -1; side <= 1; side += 2) {
                const int depth = set->depth[place] + side;
                if (depth < 0 || depth >= p->options.depths || member(set, depth))
                    continue;
                trial *moved = &s->trials[s->count++];
                *moved = itself(set);
                moved->depth[place] = depth;
                moved->from[place] = HADA_REFINE_FROM_PLANES;
            }
        if (!s->count)
            return HADA_OK;
        int best;
        double moved;
        status = refine(s, &p->next, COMPARE, &p->best, &best, &moved, err);
        if (status || !(moved < *left))
            return status;
        *left = moved;
        *set = s->trials[best];
        exchange(&p->next, &p->best);
    }
    return status;
}

/* Drops depths of *set, whose state is `now`, that the others explain as well. */
static hada_status drop(search *s, trial *set, double *left, hada_error *err)
{
    hada_pursuit *p = s->pursuit;
    hada_status status = HADA_OK;
    while (!status && set->count > 2) {
        int best;
        double others;
        s->count = 0;
        for (int place = 0; place < set->count; place++)
            s->trials[s->count++] = without(set, place);
        status = refine(s, &p->now, COMPARE, &p->best, &best, &others, err);
        if (status || 1.0 - *left / others >= p->options.threshold)
            return status;
        *set = s->trials[best];
        *left = others;
        exchange(&p->now, &p->best);
    }
    return status;
}

/* One more depth for *set, whose state is `now`: *more is the larger set with its state in `next`, *left what it
 * leaves, *base what the smaller set leaves after as many steps. */
static hada_status grow(search *s, const trial *set, trial *more, double *left, double *base, hada_error *err)
{
    hada_pursuit *p = s->pursuit;
    const hada_refine_state *from = set->count ? &p->now : NULL;
    int best;
    hada_status status;
    s->count = 0;
    for (int depth = 0; depth < p->options.depths; depth++)
        if (!member(set, depth))
            s->trials[s->count++] = with(set, depth);
    status = refine(s, from, LOOK, NULL, &best, left, err);
    *more = s->trials[best];
    *base = s->energy;
    if (!status && from)
        status = refine_one(s, itself(set), from, COMPARE, NULL, base, err);
    if (!status)
        status = refine_one(s, *more, from, COMPARE, &p->next, left, err);
    if (!status && from)
        status = swap(s, more, left, err);
    return status;
}

hada_status hada_pursuit_search(hada_pursuit *p, hada_pursuit_result *result, hada_error *err)
{
    search s = {.pursuit = p, .data = coarse_data(p)};
    trial set = {0}, more;
    double left = 0.0, base, frame = 0.0;
    hada_status status = HADA_OK;
    const int rounds = p->options.max_rounds && p->options.max_rounds < 2 * HADA_PURSUIT_MAX ? p->options.max_rounds
                                                                                             : 2 * HADA_PURSUIT_MAX;
    while (!status && set.count < p->options.depths && result->rounds < rounds) {
        if (set.count == p->options.max_depths) {
            result->all = 1;
            break;
        }
        double after;
        status = grow(&s, &set, &more, &after, &base, err);
        if (status)
            break;
        if (!set.count)
            left = frame = base;
        const double fall = base > 0.0 ? 1.0 - after / base : 0.0;
        result->fall[result->rounds++] = fall;
        if (fall < (set.count ? p->options.threshold : fmin(p->options.threshold, FIRST_THRESHOLD)))
            break;
        set = more;
        left = after;
        exchange(&p->now, &p->next);
        status = drop(&s, &set, &left, err);
    }
    result->residual = frame > 0.0 ? sqrt(left / frame) : 0.0;
    for (int depth = 0; depth < p->options.depths; depth++)
        if (member(&set, depth))
            result->list[result->count++] = depth;
    return status;
}
