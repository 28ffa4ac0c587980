/* Depth pursuit: its grids, and the search on them. */
#include "refine/pursuit_level.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/clock.h"

enum {
    SMALL_SIDE = 128,  /* pixels: the longer side of the small grid's frame: see complete() */
    RANKING_SIDE = 64, /* pixels: candidates are not put in order on grids smaller than this */
    RANKING_STEPS = 4, /* steps of refinement of each fidelity: docs/explanation/refinement.md */
    COARSE_STEPS = 8,
    CONVERGED_STEPS = 20,
    PARTED_STEPS = 64,
    COARSE_SETS = 16, /* sets side by side */
    FINE_SETS = 2,
    FINE_SETS_GROUPS = 8, /* on GPUs, of small frames: moves and additions in one look */
    FEW_DEPTHS = 6,       /* of a camera: so many are told apart on any grid, and searched for up to the last one */
    MOST_FOUND = 4        /* of more: a scene that needs more than these counts as one that fills all depths */
};

/* rho begins low, so that depths part, and grows by this a step, so that they settle: eight steps do what a constant
 * one did in twelve. Neighbours that are nearly alike take their time (docs/explanation/refinement.md). */
#define GROWTH        1.5
#define PARTED_GROWTH 1.06

/* A depth that is not there explains about the window's share of white noise; the threshold is clearly above that, and
 * between what false and true depths explained (docs/explanation/refinement.md). */
#define CHANCE_MARGIN   1.6
#define THRESHOLD_LEAST 0.3
#define THRESHOLD_MOST  0.5

void hada_pursuit_options_init(hada_pursuit_options *options)
{
    *options = (hada_pursuit_options){.rho = 1e-2};
}

static int longer_side(const hada_pursuit_options *o)
{
    const hada_rectangle *frame = &o->shape.frame;
    const int padded = o->shape.boundary == HADA_BOUNDARY_PADDED;
    const int rows = padded ? frame->rows : o->shape.grid_rows, cols = padded ? frame->cols : o->shape.grid_cols;
    return rows > cols ? rows : cols;
}

/* Whether neighbouring depths may be nearly alike: many are told apart on less than half the grid only where it has
 * many pixels (docs/explanation/refinement.md). */
static int is_dense(const hada_pursuit_options *o)
{
    return o->depths > FEW_DEPTHS && longer_side(o) < 4 * SMALL_SIDE;
}

static hada_pursuit_options complete(const hada_pursuit_options *options)
{
    hada_pursuit_options o = *options;
    const hada_refine_shape *full = &o.shape;
    if (o.shrink == 0.0)
        o.shrink = is_dense(&o) ? 2.0 : fmax(2.0, (double)longer_side(&o) / SMALL_SIDE);
    if (o.threshold == 0.0) {
        const hada_rectangle *frame = &full->frame;
        const double pixels = full->boundary == HADA_BOUNDARY_PADDED ? (double)frame->rows * frame->cols
                                                                     : (double)full->grid_rows * full->grid_cols;
        const double chance = CHANCE_MARGIN * full->window.rows * full->window.cols / pixels;
        o.threshold = chance < THRESHOLD_LEAST ? THRESHOLD_LEAST : chance > THRESHOLD_MOST ? THRESHOLD_MOST : chance;
    }
    if (!o.max_depths)
        o.max_depths = o.depths > FEW_DEPTHS ? MOST_FOUND : o.depths;
    if (o.max_depths > o.depths)
        o.max_depths = o.depths;
    return o;
}

/* The grids that completed options ask for, and what each fidelity takes, into p->level_count and p->fidelity. */
static void choose_levels(hada_pursuit *p, const hada_context *context, hada_level_spec *specs)
{
    const hada_pursuit_options *o = &p->options;
    const double shrink = o->shrink;
    const int parts = is_dense(o), fine_steps = parts ? PARTED_STEPS : CONVERGED_STEPS;
    const int fine_sets = parts && context->shape == HADA_SHAPE_GROUPS ? FINE_SETS_GROUPS : FINE_SETS;
    int ranking = 0, coarse = 0, fine = 0;
    p->parts = parts;
    p->level_count = 0;
    if (o->full) {
        specs[p->level_count++] = (hada_level_spec){1.0, shrink, 1, fine_steps, FINE_SETS, 0};
    } else {
        specs[p->level_count++] = (hada_level_spec){shrink, shrink, 0, CONVERGED_STEPS, COARSE_SETS, 1};
        /* on GPUs all candidates that stand side by side take as long as a few: they need no order */
        const int at_once = context->shape == HADA_SHAPE_GROUPS && o->depths <= COARSE_SETS;
        if (longer_side(o) / shrink >= 2 * RANKING_SIDE && !at_once) {
            ranking = p->level_count++;
            specs[ranking] = (hada_level_spec){2.0 * shrink, 2.0 * shrink, 0, RANKING_STEPS, COARSE_SETS, 0};
        }
        if (shrink > 1.0) {
            fine = p->level_count++;
            /* so many steps are dear: neighbours part by the mean of the channels as well
             * (docs/explanation/refinement.md) */
            specs[fine] = (hada_level_spec){fmax(1.0, shrink / 2.0), shrink, !parts, fine_steps, fine_sets, 0};
        }
    }
    p->fidelity[HADA_FIDELITY_RANKING] =
        (hada_effort){ranking, ranking == coarse ? COARSE_STEPS : RANKING_STEPS, GROWTH};
    p->fidelity[HADA_FIDELITY_COARSE] = (hada_effort){coarse, COARSE_STEPS, GROWTH};
    p->fidelity[HADA_FIDELITY_CONVERGED] = (hada_effort){coarse, CONVERGED_STEPS, GROWTH};
    p->fidelity[HADA_FIDELITY_FINE] = (hada_effort){fine, fine_steps, parts ? PARTED_GROWTH : GROWTH};
}

hada_status hada_pursuit_create(hada_pursuit **out, hada_slot *slot, const hada_pursuit_options *options,
                                hada_error *err)
{
    hada_pursuit *p = NULL;
    hada_level_spec specs[HADA_PURSUIT_LEVELS];
    const int first = slot->scratch ? slot->scratch->first : 0;
    hada_status status = HADA_OK;
    *out = NULL;
    const hada_pursuit_options o = complete(options);
    if (o.depths < 1 || o.depths > HADA_PURSUIT_DEPTHS || o.max_depths > HADA_PURSUIT_MAX || o.max_depths < 1 ||
        !(o.shrink >= 1.0) || !(o.rho > 0.0) || o.shape.channels < 1)
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "depth pursuit: 1 to %d depths, channels from 1 on, up to %d depths in a set, a shrink factor from 1 on "
            "and rho above 0 are possible (got %d, %d, %d, %g, %g)",
            HADA_PURSUIT_DEPTHS, HADA_PURSUIT_MAX, o.depths, o.shape.channels, o.max_depths, o.shrink, o.rho);
    HADA_TRY_OR_DONE(HADA_NEW(p, 1, "a depth pursuit", err));
    p->slot = slot;
    p->options = o;
    choose_levels(p, slot->context, specs);
    for (int i = 0; i < p->level_count; i++) {
        hada_scratch_steps(slot->scratch, first + i, first + i, first + i);
        HADA_TRY_OR_DONE(hada_level_create(&p->levels[i], slot, &p->options, &specs[i], err));
    }
    *out = p;
done:
    if (status)
        hada_pursuit_destroy(&p);
    return status;
}

void hada_pursuit_destroy(hada_pursuit **pointer)
{
    hada_pursuit *p = hada_taken(pointer);
    if (!p)
        return;
    hada_slot_finish(p->slot, NULL);
    hada_residuals_forget(p);
    for (int i = 0; i < p->level_count; i++)
        hada_level_destroy(&p->levels[i]);
    free(p);
}

hada_status hada_pursuit_set_otf(hada_pursuit *p, cl_mem otf, size_t offset, hada_error *err)
{
    for (int i = 0; i < p->level_count; i++)
        HADA_TRY(hada_level_set_otf(&p->levels[i], otf, offset, err));
    return HADA_OK;
}

hada_status hada_pursuit_set_prior(hada_pursuit *p, cl_mem prior, hada_error *err)
{
    for (int i = 0; i < p->level_count; i++)
        HADA_TRY(hada_level_set_prior(&p->levels[i], prior, err));
    return HADA_OK;
}

hada_status hada_pursuit_set_power(hada_pursuit *p, int depth, cl_mem power, hada_error *err)
{
    for (int i = 0; i < p->level_count; i++)
        HADA_TRY(hada_level_set_power(&p->levels[i], depth, power, err));
    return HADA_OK;
}

/* The greedy search: additions, moves, pruning; on which grid each is decided. */

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

static int set_has(const hada_set *set, int depth)
{
    for (int i = 0; i < set->count; i++)
        if (set->depth[i] == depth)
            return 1;
    return 0;
}

static hada_set set_with(const hada_set *set, int depth)
{
    hada_set more = {.count = set->count + 1};
    int i = 0;
    for (; i < set->count && set->depth[i] < depth; i++)
        more.depth[i] = set->depth[i];
    more.depth[i] = depth;
    for (; i < set->count; i++)
        more.depth[i + 1] = set->depth[i];
    return more;
}

static hada_set set_without(const hada_set *set, int place)
{
    hada_set less = {.count = set->count - 1};
    for (int i = 0; i < less.count; i++)
        less.depth[i] = set->depth[i < place ? i : i + 1];
    return less;
}

/* What a set leaves. */
static hada_status residual_of_set(hada_pursuit *p, hada_fidelity fidelity, const hada_set *set, double *energy,
                                   hada_error *err)
{
    return hada_residuals_of(p, fidelity, set, 1, energy, err);
}

/* What the candidates leave, into p->energy. */
static hada_status search_evaluate(hada_pursuit *p, hada_fidelity fidelity, hada_error *err)
{
    return hada_residuals_of(p, fidelity, p->candidates, p->count, p->energy, err);
}

/* The candidate that leaves least and was not yet taken; *energy: what it leaves, INFINITY where all are taken. */
static int search_take_best(hada_pursuit *p, double *energy)
{
    int best = 0;
    for (int i = 1; i < p->count; i++)
        if (p->energy[i] < p->energy[best])
            best = i;
    *energy = p->energy[best];
    p->energy[best] = INFINITY;
    return best;
}

/* The part of what `smaller` leaves that `larger` explains. */
static hada_status reduction_at(hada_pursuit *p, hada_fidelity fidelity, const hada_set *smaller,
                                const hada_set *larger, double *reduction, hada_error *err)
{
    double frame, before, after;
    HADA_TRY(hada_residuals_frame(p, fidelity, &frame, err));
    hada_residuals_ahead(p, fidelity, larger, 1);
    HADA_TRY(residual_of_set(p, fidelity, smaller, &before, err));
    HADA_TRY(residual_of_set(p, fidelity, larger, &after, err));
    *reduction = before > 0.0 ? (before - after) / (before + MODEL_ERROR * MODEL_ERROR * frame) : 0.0;
    return HADA_OK;
}

static double threshold_of(const hada_pursuit *p, const hada_set *smaller)
{
    const double threshold = p->options.threshold;
    return smaller->count ? threshold : fmin(threshold, FIRST_THRESHOLD);
}

/* The same, as closely as it takes. A larger set converges later, so few steps make its reduction too small, never too
 * large: one that is clearly enough is, one that is not is given more steps. */
static hada_status reduction_of(hada_pursuit *p, const hada_set *smaller, const hada_set *larger, double *reduction,
                                hada_error *err)
{
    const double high = CLOSE_ABOVE * threshold_of(p, smaller), low = CLOSE_BELOW * threshold_of(p, smaller);
    HADA_TRY(reduction_at(p, HADA_FIDELITY_COARSE, smaller, larger, reduction, err));
    if (*reduction > high)
        return HADA_OK;
    HADA_TRY(reduction_at(p, HADA_FIDELITY_CONVERGED, smaller, larger, reduction, err));
    if (*reduction > high || *reduction < low)
        return HADA_OK;
    p->result->fine_comparisons++;
    HADA_TRY(reduction_at(p, HADA_FIDELITY_FINE, smaller, larger, reduction, err));
    return HADA_OK;
}

/* Whether `moved` leaves less than `current`, evaluated no closer than `finest`. */
static hada_status is_better(hada_pursuit *p, const hada_set *current, const hada_set *moved, hada_fidelity finest,
                             int *better, hada_error *err)
{
    *better = 0;
    for (int fidelity = HADA_FIDELITY_COARSE; fidelity <= (int)finest; fidelity++) {
        double now, then;
        p->result->fine_comparisons += fidelity == HADA_FIDELITY_FINE;
        hada_residuals_ahead(p, (hada_fidelity)fidelity, moved, 1);
        HADA_TRY(residual_of_set(p, (hada_fidelity)fidelity, current, &now, err));
        HADA_TRY(residual_of_set(p, (hada_fidelity)fidelity, moved, &then, err));
        *better = then < now;
        if (then > CLOSE_RATIO * now || now > CLOSE_RATIO * then)
            break;
    }
    return HADA_OK;
}

/* All sets with one depth moved to a free neighbour; how many. */
static int moves_of(const hada_pursuit *p, const hada_set *current, hada_set *moves)
{
    int count = 0;
    for (int place = 0; place < current->count; place++)
        for (int side = -1; side <= 1; side += 2) {
            const int depth = current->depth[place] + side;
            const hada_set rest = set_without(current, place);
            if (depth >= 0 && depth < p->options.depths && !set_has(current, depth))
                moves[count++] = set_with(&rest, depth);
        }
    return count;
}

/* What the candidates may be moved to next. */
static void moves_ahead(hada_pursuit *p)
{
    hada_set next[2 * HADA_PURSUIT_MAX];
    for (int i = 0; i < p->count; i++)
        hada_residuals_ahead(p, HADA_FIDELITY_COARSE, next, moves_of(p, &p->candidates[i], next));
}

/* All sets with a depth less; how many. */
static int search_reductions(const hada_set *current, hada_set *less)
{
    for (int place = 0; place < current->count; place++)
        less[place] = set_without(current, place);
    return current->count;
}

/* The candidates that leave no more than `most` may have to be told apart more closely. */
static void rivals_ahead(hada_pursuit *p, double most)
{
    for (int i = 0; i < p->count; i++)
        for (int fidelity = HADA_FIDELITY_CONVERGED; p->energy[i] <= most && fidelity <= HADA_FIDELITY_FINE; fidelity++)
            hada_residuals_ahead(p, (hada_fidelity)fidelity, &p->candidates[i], 1);
}

/* The best of the moves that leaves less than *current, which takes it. */
static hada_status move_once(hada_pursuit *p, hada_set *current, hada_fidelity finest, int *moved, hada_error *err)
{
    double now, energy;
    *moved = 0;
    p->count = moves_of(p, current, p->candidates);
    if (!p->count)
        return HADA_OK;
    hada_residuals_ahead(p, HADA_FIDELITY_COARSE, p->candidates, p->count);
    HADA_TRY(residual_of_set(p, HADA_FIDELITY_COARSE, current, &now, err));
    moves_ahead(p);
    HADA_TRY(search_evaluate(p, HADA_FIDELITY_COARSE, err));
    if (finest == HADA_FIDELITY_FINE)
        rivals_ahead(p, CLOSE_RATIO * now);
    for (int tried = 0; !*moved && tried < p->count; tried++) {
        const int best = search_take_best(p, &energy);
        if (energy > CLOSE_RATIO * now)
            break;
        HADA_TRY(is_better(p, current, &p->candidates[best], finest, moved, err));
        if (*moved)
            *current = p->candidates[best];
    }
    return HADA_OK;
}

/* Local search: moves depths of *current to free neighbours while that leaves less. */
static hada_status search_move(hada_pursuit *p, hada_set *current, hada_fidelity finest, hada_error *err)
{
    int moved = 1;
    for (int sweep = 0; moved && sweep < 2 * p->options.depths; sweep++)
        HADA_TRY(move_once(p, current, finest, &moved, err));
    return HADA_OK;
}

/* Drops depths of *current that the others explain as well. */
static hada_status prune(hada_pursuit *p, hada_set *current, hada_error *err)
{
    while (current->count > 1) {
        double least, reduction;
        p->count = search_reductions(current, p->candidates);
        HADA_TRY(search_evaluate(p, HADA_FIDELITY_COARSE, err));
        const hada_set less = p->candidates[search_take_best(p, &least)];
        HADA_TRY(reduction_of(p, &less, current, &reduction, err));
        if (reduction >= p->options.threshold)
            break;
        *current = less;
    }
    return HADA_OK;
}

/* Lists the sets of one depth more than *current: the first few of those that leave least, evaluated so, and no more
 * than `most`. */
static hada_status search_shortlist(hada_pursuit *p, const hada_set *current, hada_fidelity fidelity, double most,
                                    hada_error *err)
{
    hada_set first[SHORTLIST];
    double energy;
    int count = 0;
    p->count = 0;
    for (int depth = 0; depth < p->options.depths; depth++)
        if (!set_has(current, depth))
            p->candidates[p->count++] = set_with(current, depth);
    HADA_TRY(search_evaluate(p, fidelity, err));
    while (count < SHORTLIST && count < p->count) {
        const int best = search_take_best(p, &energy);
        if (energy > most)
            break;
        first[count++] = p->candidates[best];
    }
    memcpy(p->candidates, first, (size_t)count * sizeof *first);
    p->count = count;
    return HADA_OK;
}

/* Of the candidates the one that leaves least; *energy: how much. */
static hada_status best_candidate(hada_pursuit *p, hada_set *best, double *energy, hada_error *err)
{
    HADA_TRY(search_evaluate(p, HADA_FIDELITY_COARSE, err));
    *best = p->candidates[search_take_best(p, energy)];
    return HADA_OK;
}

/* Whether the frame holds more depths than a set has room for, found out at a pair, before any set is moved: depths
 * are added as they come, and must leave much at every size; all depths together must leave much less than the largest
 * set. *largest is then that set. */
static hada_status detect_many(hada_pursuit *p, const hada_set *pair, hada_set *largest, int *many, hada_error *err)
{
    const hada_pursuit_options *o = &p->options;
    double frame, energy, all;
    *many = 0;
    if (o->full || o->max_depths == o->depths)
        return HADA_OK;
    *largest = *pair;
    HADA_TRY(hada_residuals_frame(p, HADA_FIDELITY_COARSE, &frame, err));
    HADA_TRY(residual_of_set(p, HADA_FIDELITY_COARSE, pair, &energy, err));
    for (;;) {
        const double much = MANY_LEAVE / largest->count;
        if (energy < much * much * frame)
            return HADA_OK;
        if (largest->count == o->max_depths)
            break;
        HADA_TRY(search_shortlist(p, largest, HADA_FIDELITY_RANKING, INFINITY, err));
        HADA_TRY(best_candidate(p, largest, &energy, err));
    }
    HADA_TRY(hada_residuals_of_all(p, &all, err));
    *many = all < ALL_LEAVE * energy;
    return HADA_OK;
}

/* The best addition to *current: *more is the larger set, moved where that may help. *many: there are more depths than
 * a set has room for. */
static hada_status best_addition(hada_pursuit *p, const hada_set *current, hada_set *more, int *many, hada_error *err)
{
    const hada_pursuit_options *o = &p->options;
    const int last = current->count + 1 == o->max_depths && o->max_depths < o->depths;
    hada_set largest = {0}, less[HADA_PURSUIT_MAX];
    double reduction, energy;
    *many = 0;
    /* where nothing is added, these come next */
    hada_residuals_ahead(p, HADA_FIDELITY_COARSE, less, search_reductions(current, less));
    HADA_TRY(search_shortlist(p, current, HADA_FIDELITY_RANKING, INFINITY, err));
    /* the last one that there is room for: that it is needed says enough, which one it is does not matter */
    if (last) {
        *more = p->candidates[0];
        HADA_TRY(reduction_at(p, HADA_FIDELITY_COARSE, current, more, &reduction, err));
        if (reduction > CLOSE_ABOVE * o->threshold)
            return HADA_OK;
    }
    HADA_TRY(best_candidate(p, more, &energy, err));
    if (more->count == 2)
        HADA_TRY(detect_many(p, more, &largest, many, err));
    if (*many) {
        *more = largest;
        return HADA_OK;
    }
    HADA_TRY(reduction_at(p, HADA_FIDELITY_COARSE, current, more, &reduction, err));
    if (current->count && reduction >= MOVE_FROM && reduction <= (current->count == 1 ? MOVE_PAIR_TO : MOVE_TO))
        HADA_TRY(search_move(p, more, HADA_FIDELITY_COARSE, err));
    return HADA_OK;
}

/* Adds a depth to *found where one explains enough (*added). Where the frame holds too many to tell apart (result->all)
 * *found is the largest set. */
static hada_status add(hada_pursuit *p, hada_set *found, int *added, hada_error *err)
{
    hada_pursuit_result *result = p->result;
    hada_set more;
    double reduction;
    *added = 0;
    HADA_TRY(best_addition(p, found, &more, &result->all, err));
    if (!result->all) {
        HADA_TRY(reduction_of(p, found, &more, &reduction, err));
        result->reduction[result->rounds++] = reduction;
        *added = reduction >= threshold_of(p, found);
        result->more = *added ? 0.0 : reduction;
    }
    if (result->all || *added)
        *found = more;
    return HADA_OK;
}

static hada_status pursue(hada_pursuit *p, hada_set *found, hada_error *err)
{
    const hada_pursuit_options *o = &p->options;
    hada_pursuit_result *result = p->result;
    while (result->rounds < 2 * HADA_PURSUIT_MAX) {
        const int room = found->count < o->max_depths;
        int added = 0;
        if (room)
            HADA_TRY(add(p, found, &added, err));
        if (result->all)
            break;
        if (added)
            continue;
        /* nothing to add, or no room: unless a smaller set or a moved one is better, this is it */
        const hada_set before = *found;
        if (found->count)
            HADA_TRY(prune(p, found, err));
        if (found->count && room)
            HADA_TRY(search_move(p, found, HADA_FIDELITY_FINE, err));
        if (hada_set_same(&before, found)) {
            result->all = !room && o->max_depths < o->depths;
            break;
        }
    }
    return HADA_OK;
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
    return hidden && !set_has(set, depth);
}

/* All sets of one depth more that may be better once all have parted: the first of those that begin to explain
 * something, and those that hide. */
static hada_status list_missed(hada_pursuit *p, const hada_set *current, hada_error *err)
{
    double now;
    HADA_TRY(residual_of_set(p, HADA_FIDELITY_CONVERGED, current, &now, err));
    HADA_TRY(search_shortlist(p, current, HADA_FIDELITY_CONVERGED, (1.0 - GLIMPSE) * now, err));
    for (int depth = 0; depth < p->options.depths; depth++)
        if (is_hidden(current, depth)) /* once more in the list is no more work */
            p->candidates[p->count++] = set_with(current, depth);
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
static hada_status drop_hidden(hada_pursuit *p, hada_set *current, hada_error *err)
{
    double now, least;
    p->count = search_reductions(current, p->candidates);
    HADA_TRY(residual_of_set(p, HADA_FIDELITY_FINE, current, &now, err));
    HADA_TRY(search_evaluate(p, HADA_FIDELITY_FINE, err));
    const hada_set less = p->candidates[search_take_best(p, &least)];
    if (!explains(least, now))
        *current = less;
    return HADA_OK;
}

/* Depths that few steps do not tell from others: adds those that explain enough once all have parted, moves the set
 * again, and drops what is then not needed. A single depth hides nothing. */
static hada_status part(hada_pursuit *p, hada_set *current, hada_error *err)
{
    const hada_pursuit_options *o = &p->options;
    int added = 0;
    while (current->count > 1 && current->count < o->max_depths) {
        double now, least;
        HADA_TRY(list_missed(p, current, err));
        if (!p->count)
            break;
        hada_residuals_ahead(p, HADA_FIDELITY_FINE, p->candidates, p->count);
        HADA_TRY(residual_of_set(p, HADA_FIDELITY_FINE, current, &now, err));
        HADA_TRY(search_evaluate(p, HADA_FIDELITY_FINE, err));
        const hada_set more = p->candidates[search_take_best(p, &least)];
        if (!explains(now, least))
            break;
        *current = more;
        added = 1;
        HADA_TRY(search_move(p, current, HADA_FIDELITY_FINE, err));
    }
    if (added)
        HADA_TRY(drop_hidden(p, current, err));
    /* no room for more, and all are needed; in a row they are one or two that stand between depths */
    p->result->all = added && current->count == o->max_depths && o->max_depths < o->depths && !is_row(current);
    return HADA_OK;
}

/* Takes down what was found, and whether depths may hide beside it, unless these were looked for (parted). */
static hada_status search_report(hada_pursuit *p, const hada_set *found, int parted, hada_error *err)
{
    hada_pursuit_result *result = p->result;
    double frame, energy;
    HADA_TRY(hada_residuals_frame(p, HADA_FIDELITY_COARSE, &frame, err));
    HADA_TRY(residual_of_set(p, HADA_FIDELITY_COARSE, found, &energy, err));
    result->residual = frame > 0.0 ? sqrt(energy / frame) : 0.0;
    result->count = found->count;
    memcpy(result->list, found->depth, sizeof found->depth);
    result->hides = p->parts && !parted && !result->all && found->count > 1 && found->count < p->options.max_depths;
    return HADA_OK;
}

static size_t transforms(const hada_pursuit *p)
{
    size_t sum = 0;
    for (int i = 0; i < p->level_count; i++)
        sum += hada_refiner_transforms(p->levels[i].refiner);
    return sum;
}

/* Searches on from *found; parted: for depths that hide. */
static hada_status search(hada_pursuit *p, hada_pursuit_result *result, hada_set *found, int parted, hada_error *err)
{
    const double start = hada_seconds();
    const size_t before = transforms(p);
    hada_status status = HADA_OK;
    p->result = result;
    HADA_TRY_OR_DONE(parted ? part(p, found, err) : pursue(p, found, err));
    HADA_TRY_OR_DONE(search_report(p, found, parted, err));
done:
    result->seconds += hada_seconds() - start;
    result->transforms += transforms(p) - before;
    return status;
}

hada_status hada_pursuit_run(hada_pursuit *p, cl_mem spectrum, double scale, hada_pursuit_result *result,
                             hada_error *err)
{
    hada_set found = {0};
    *result = (hada_pursuit_result){0};
    hada_residuals_forget(p);
    for (int i = 0; i < p->level_count; i++)
        hada_level_set_frame(&p->levels[i], spectrum, scale);
    return search(p, result, &found, 0, err);
}

hada_status hada_pursuit_part(hada_pursuit *p, hada_pursuit_result *result, hada_error *err)
{
    hada_set found = {.count = result->count};
    memcpy(found.depth, result->list, sizeof found.depth);
    return search(p, result, &found, 1, err);
}
