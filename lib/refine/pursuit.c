#include "refine/pursuit.h"

#include <math.h>
#include <stdlib.h>

#include "core/clock.h"
#include "refine/pursuit_search.h"

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
    const hada_refine_rect *frame = &o->shape.frame;
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
        const hada_refine_rect *frame = &full->frame;
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

/* The grids that completed options ask for, and what each fidelity takes, into p->count and p->fidelity. */
static void choose_levels(hada_pursuit *p, const hada_context *context, hada_level_spec *specs)
{
    const hada_pursuit_options *o = &p->options;
    const double shrink = o->shrink;
    const int parts = is_dense(o), fine_steps = parts ? PARTED_STEPS : CONVERGED_STEPS;
    const int fine_sets = parts && context->shape == HADA_SHAPE_GROUPS ? FINE_SETS_GROUPS : FINE_SETS;
    int ranking = 0, coarse = 0, fine = 0;
    p->parts = parts;
    p->count = 0;
    if (o->full) {
        specs[p->count++] = (hada_level_spec){1.0, shrink, 1, fine_steps, FINE_SETS, 0};
    } else {
        specs[p->count++] = (hada_level_spec){shrink, shrink, 0, CONVERGED_STEPS, COARSE_SETS, 1};
        /* on GPUs all candidates that stand side by side take as long as a few: they need no order */
        const int at_once = context->shape == HADA_SHAPE_GROUPS && o->depths <= COARSE_SETS;
        if (longer_side(o) / shrink >= 2 * RANKING_SIDE && !at_once) {
            ranking = p->count++;
            specs[ranking] = (hada_level_spec){2.0 * shrink, 2.0 * shrink, 0, RANKING_STEPS, COARSE_SETS, 0};
        }
        if (shrink > 1.0) {
            fine = p->count++;
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
    HADA_TRY_OR_DONE(hada_allocated(p = hada_alloc(1, sizeof *p, "a depth pursuit", err)));
    p->slot = slot;
    p->options = o;
    p->residuals.pursuit = p;
    choose_levels(p, slot->context, specs);
    for (int i = 0; i < p->count; i++) {
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
    hada_residuals_free(&p->residuals);
    for (int i = 0; i < p->count; i++)
        hada_level_destroy(&p->levels[i]);
    free(p);
}

static hada_status check_depths(const hada_pursuit *p, int first, int count, hada_error *err)
{
    if (first < 0 || count < 0 || first + count > p->options.depths)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "depth pursuit: depths %d to %d given, the camera has %d", first,
                         first + count - 1, p->options.depths);
    return HADA_OK;
}

hada_status hada_pursuit_set_otf(hada_pursuit *p, int first, int count, cl_mem otf, size_t offset, hada_error *err)
{
    HADA_TRY(check_depths(p, first, count, err));
    for (int i = 0; i < p->count; i++)
        HADA_TRY(hada_level_set_otf(&p->levels[i], first, count, otf, offset, err));
    return HADA_OK;
}

hada_status hada_pursuit_set_prior(hada_pursuit *p, cl_mem prior, hada_error *err)
{
    for (int i = 0; i < p->count; i++)
        HADA_TRY(hada_level_set_prior(&p->levels[i], prior, err));
    return HADA_OK;
}

hada_status hada_pursuit_set_power(hada_pursuit *p, int depth, cl_mem power, hada_error *err)
{
    HADA_TRY(check_depths(p, depth, 1, err));
    for (int i = 0; i < p->count; i++)
        HADA_TRY(hada_level_set_power(&p->levels[i], depth, power, err));
    return HADA_OK;
}

static size_t transforms(const hada_pursuit *p)
{
    size_t sum = 0;
    for (int i = 0; i < p->count; i++)
        sum += hada_refiner_transforms(p->levels[i].refiner);
    return sum;
}

static hada_status search(hada_pursuit *p, hada_pursuit_result *result, hada_status (*how)(hada_search *, hada_error *),
                          hada_error *err)
{
    const double start = hada_seconds();
    const size_t before = transforms(p);
    hada_search *s;
    hada_status status = HADA_OK;
    HADA_TRY(hada_allocated(s = hada_alloc(1, sizeof *s, "the depth pursuit", err)));
    *s = (hada_search){.pursuit = p, .result = result, .residuals = &p->residuals};
    status = how(s, err);
    free(s);
    result->seconds += hada_seconds() - start;
    result->transforms += transforms(p) - before;
    return status;
}

hada_status hada_pursuit_run(hada_pursuit *p, cl_mem spectrum, hada_pursuit_result *result, hada_error *err)
{
    *result = (hada_pursuit_result){0};
    hada_residuals_free(&p->residuals);
    for (int i = 0; i < p->count; i++)
        hada_level_set_frame(&p->levels[i], spectrum);
    return search(p, result, hada_search_depths, err);
}

hada_status hada_pursuit_part(hada_pursuit *p, hada_pursuit_result *result, hada_error *err)
{
    return search(p, result, hada_search_hidden, err);
}
