#include "refine/pursuit_search.h"

#include <stdlib.h>
#include <string.h>

#include "core/base.h"

/* A set that was refined, and the energy that it left. */
struct hada_known_residual {
    hada_fidelity fidelity;
    hada_set set;
    double energy;
};

int hada_set_same(const hada_set *a, const hada_set *b)
{
    return a->count == b->count && !memcmp(a->depth, b->depth, (size_t)a->count * sizeof *a->depth);
}

int hada_set_has(const hada_set *set, int depth)
{
    for (int i = 0; i < set->count; i++)
        if (set->depth[i] == depth)
            return 1;
    return 0;
}

hada_set hada_set_with(const hada_set *set, int depth)
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

hada_set hada_set_without(const hada_set *set, int place)
{
    hada_set less = {.count = set->count - 1};
    for (int i = 0; i < less.count; i++)
        less.depth[i] = set->depth[i < place ? i : i + 1];
    return less;
}

void hada_residuals_free(hada_residuals *residuals)
{
    free(residuals->known);
    residuals->known = NULL;
    residuals->count = residuals->room = 0;
    residuals->ahead_count = 0;
}

static hada_pursuit_level *level_of(const hada_residuals *residuals, hada_fidelity fidelity)
{
    return &residuals->pursuit->levels[residuals->pursuit->fidelity[fidelity].level];
}

/* Fidelities differ in steps or in grid: where two are the same, the first one's results serve. */
static hada_fidelity first_alike(const hada_residuals *residuals, hada_fidelity fidelity)
{
    const hada_pursuit *p = residuals->pursuit;
    for (int i = 0; i < (int)fidelity; i++)
        if (p->fidelity[i].level == p->fidelity[fidelity].level && p->fidelity[i].steps == p->fidelity[fidelity].steps)
            return (hada_fidelity)i;
    return fidelity;
}

static const hada_known_residual *find(const hada_residuals *residuals, hada_fidelity fidelity, const hada_set *set)
{
    for (size_t i = 0; i < residuals->count; i++)
        if (residuals->known[i].fidelity == fidelity && hada_set_same(&residuals->known[i].set, set))
            return &residuals->known[i];
    return NULL;
}

static hada_status make_room(hada_residuals *residuals, size_t more, hada_error *err)
{
    if (residuals->count + more <= residuals->room)
        return HADA_OK;
    const size_t room = 2 * residuals->room + more;
    hada_known_residual *larger;
    HADA_TRY(hada_allocated(larger = hada_alloc(room, sizeof *larger, "the depth pursuit", err)));
    if (residuals->count)
        memcpy(larger, residuals->known, residuals->count * sizeof *larger);
    free(residuals->known);
    residuals->known = larger;
    residuals->room = room;
    return HADA_OK;
}

hada_status hada_residuals_frame(const hada_residuals *residuals, hada_fidelity fidelity, double *energy,
                                 hada_error *err)
{
    return hada_level_frame_energy(level_of(residuals, fidelity), energy, err);
}

void hada_residuals_ahead(hada_residuals *residuals, hada_fidelity fidelity, const hada_set *sets, int count)
{
    for (int i = 0; i < count && residuals->ahead_count < HADA_RESIDUALS_AHEAD; i++) {
        residuals->ahead_fidelity[residuals->ahead_count] = first_alike(residuals, fidelity);
        residuals->ahead[residuals->ahead_count++] = sets[i];
    }
}

/* Sets that are to be refined side by side: those that are not known yet. */
typedef struct batch {
    const hada_set *sets[HADA_PURSUIT_DEPTHS];
    int count, places;
} batch;

static void add_unknown(batch *all, const hada_residuals *residuals, hada_fidelity fidelity, const hada_set *set)
{
    if (!set->count || find(residuals, fidelity, set))
        return;
    for (int i = 0; i < all->count; i++)
        if (hada_set_same(all->sets[i], set))
            return;
    all->sets[all->count++] = set;
    all->places = set->count > all->places ? set->count : all->places;
}

/* Those of this fidelity that there is room for. What is left of them is forgotten, the others wait. */
static void take_ahead(batch *all, hada_residuals *residuals, hada_fidelity fidelity)
{
    const int room = hada_level_room(level_of(residuals, fidelity));
    int kept = 0;
    for (int i = 0; i < residuals->ahead_count; i++) {
        if (residuals->ahead_fidelity[i] != fidelity) {
            residuals->ahead_fidelity[kept] = residuals->ahead_fidelity[i];
            residuals->ahead[kept++] = residuals->ahead[i];
        } else if (all->count < room) {
            residuals->taken[all->count] = residuals->ahead[i];
            add_unknown(all, residuals, fidelity, &residuals->taken[all->count]);
        }
    }
    residuals->ahead_count = kept;
}

/* Refines them and takes down what they leave. Smaller sets have places without a depth, which stay dark. */
static hada_status refine(hada_residuals *residuals, hada_fidelity fidelity, const batch *all, hada_error *err)
{
    const hada_pursuit *p = residuals->pursuit;
    int list[HADA_PURSUIT_DEPTHS * HADA_PURSUIT_MAX];
    double energy[HADA_PURSUIT_DEPTHS];
    for (int i = 0; i < all->count; i++)
        for (int k = 0; k < all->places; k++)
            list[i * all->places + k] = k < all->sets[i]->count ? all->sets[i]->depth[k] : HADA_LEVEL_NO_DEPTH;
    HADA_TRY(make_room(residuals, (size_t)all->count, err));
    const hada_effort *effort = &p->fidelity[fidelity];
    HADA_TRY(hada_level_residuals(level_of(residuals, fidelity), effort->steps, effort->growth, all->count, all->places,
                                  list, energy, err));
    for (int i = 0; i < all->count; i++)
        residuals->known[residuals->count++] = (hada_known_residual){fidelity, *all->sets[i], energy[i]};
    return HADA_OK;
}

hada_status hada_residuals_of(hada_residuals *residuals, hada_fidelity asked, const hada_set *sets, int count,
                              double *energy, hada_error *err)
{
    const hada_fidelity fidelity = first_alike(residuals, asked);
    batch all = {0};
    if (!sets[0].count)
        return hada_residuals_frame(residuals, fidelity, energy, err);
    for (int i = 0; i < count; i++)
        add_unknown(&all, residuals, fidelity, &sets[i]);
    if (all.count)
        take_ahead(&all, residuals, fidelity);
    if (all.count)
        HADA_TRY(refine(residuals, fidelity, &all, err));
    for (int i = 0; i < count; i++)
        energy[i] = find(residuals, fidelity, &sets[i])->energy;
    return HADA_OK;
}

hada_status hada_residuals_of_all(const hada_residuals *residuals, double *energy, hada_error *err)
{
    const hada_pursuit *p = residuals->pursuit;
    int list[HADA_PURSUIT_DEPTHS];
    for (int depth = 0; depth < p->options.depths; depth++)
        list[depth] = depth;
    const hada_effort *effort = &p->fidelity[HADA_FIDELITY_COARSE];
    return hada_level_residuals(level_of(residuals, HADA_FIDELITY_COARSE), effort->steps, effort->growth, 1,
                                p->options.depths, list, energy, err);
}
