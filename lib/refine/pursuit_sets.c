#include "refine/pursuit_sets.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"

/* A set that was refined, and what it left. */
struct hada_known_set {
    hada_pursuit_look look;
    hada_set set;
    double left;
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

void hada_looks_free(hada_looks *looks)
{
    free(looks->known);
    looks->known = NULL;
    looks->count = looks->room = 0;
}

static hada_pursuit_level *level_of(const hada_looks *looks, hada_pursuit_look look)
{
    return &looks->pursuit->levels[looks->pursuit->looks[look].level];
}

/* The looks differ in steps or in grid: where two are the same, the first one's results serve. */
static hada_pursuit_look plain(const hada_looks *looks, hada_pursuit_look look)
{
    const hada_pursuit *p = looks->pursuit;
    for (int i = 0; i < (int)look; i++)
        if (p->looks[i].level == p->looks[look].level && p->looks[i].steps == p->looks[look].steps)
            return (hada_pursuit_look)i;
    return look;
}

static const hada_known_set *find(const hada_looks *looks, hada_pursuit_look look, const hada_set *wanted)
{
    for (size_t i = 0; i < looks->count; i++)
        if (looks->known[i].look == look && hada_set_same(&looks->known[i].set, wanted))
            return &looks->known[i];
    return NULL;
}

static hada_status make_room(hada_looks *looks, size_t more, hada_error *err)
{
    if (looks->count + more <= looks->room)
        return HADA_OK;
    const size_t room = 2 * looks->room + more;
    hada_known_set *larger;
    hada_status status = hada_alloc((void **)&larger, room, sizeof *larger, "the depth pursuit", err);
    if (status)
        return status;
    if (looks->count)
        memcpy(larger, looks->known, looks->count * sizeof *larger);
    free(looks->known);
    looks->known = larger;
    looks->room = room;
    return HADA_OK;
}

hada_status hada_looks_energy(const hada_looks *looks, hada_pursuit_look look, double *energy, hada_error *err)
{
    return hada_level_energy(level_of(looks, look), energy, err);
}

hada_status hada_looks_left(hada_looks *looks, hada_pursuit_look asked, const hada_set *sets, int count, double *left,
                            hada_error *err)
{
    const hada_pursuit_look look = plain(looks, asked);
    int list[HADA_PURSUIT_DEPTHS * HADA_PURSUIT_MAX], missing = 0;
    double fresh[HADA_PURSUIT_DEPTHS];
    const int places = sets[0].count;
    const size_t first = looks->count;
    if (!places)
        return hada_looks_energy(looks, look, left, err);
    hada_status status = make_room(looks, (size_t)count, err);
    if (status)
        return status;
    for (int i = 0; i < count; i++)
        if (!find(looks, look, &sets[i])) {
            memcpy(list + missing * places, sets[i].depth, (size_t)places * sizeof *list);
            missing++;
            looks->known[looks->count++] = (hada_known_set){look, sets[i], 0.0};
        }
    if (missing)
        status = hada_level_left(level_of(looks, look), looks->pursuit->looks[look].steps, missing, places, list, fresh,
                                 err);
    for (int i = 0; !status && i < missing; i++)
        looks->known[first + (size_t)i].left = fresh[i];
    for (int i = 0; !status && i < count; i++)
        left[i] = find(looks, look, &sets[i])->left;
    return status;
}

hada_status hada_looks_all(const hada_looks *looks, double *left, hada_error *err)
{
    const hada_pursuit *p = looks->pursuit;
    int list[HADA_PURSUIT_DEPTHS];
    for (int depth = 0; depth < p->options.depths; depth++)
        list[depth] = depth;
    return hada_level_left(level_of(looks, HADA_LOOK_JUDGE), p->looks[HADA_LOOK_JUDGE].steps, 1, p->options.depths,
                           list, left, err);
}
