#include "train/snapshot.h"

#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "core/callers.h"

hada_status hada_snapshot_create(hada_snapshot *snapshot, hada_workers *workers, const hada_train_progress *progress,
                                 hada_error *err)
{
    const size_t groups = (size_t)workers->groups;
    *snapshot = (hada_snapshot){.groups = workers->groups};
    HADA_TRY(hada_allocated(snapshot->values = hada_alloc(groups, sizeof *snapshot->values, "a snapshot", err)));
    HADA_TRY(hada_allocated(snapshot->states = hada_alloc(groups, sizeof *snapshot->states, "a snapshot", err)));
    HADA_TRY(hada_allocated(snapshot->dirty = hada_alloc(groups, 1, "a snapshot", err)));
    HADA_TRY(
        hada_allocated(snapshot->group_steps = hada_alloc(groups, sizeof *snapshot->group_steps, "a snapshot", err)));
    for (int g = 0; g < workers->groups; g++) {
        HADA_TRY(
            hada_allocated(snapshot->values[g] = hada_alloc_raw(hada_workers_floats(workers, g, HADA_CONTENT_VALUES),
                                                                sizeof(float), "a copy of the parameters", err)));
        HADA_TRY(hada_allocated(snapshot->states[g] =
                                    hada_alloc_raw(hada_workers_floats(workers, g, HADA_CONTENT_STATE), sizeof(float),
                                                   "a copy of the optimiser's state", err)));
        snapshot->dirty[g] = 1;
    }
    return hada_snapshot_take(snapshot, workers, progress, err);
}

void hada_snapshot_free(hada_snapshot *snapshot)
{
    for (int g = 0; g < snapshot->groups; g++) {
        if (snapshot->values)
            free(snapshot->values[g]);
        if (snapshot->states)
            free(snapshot->states[g]);
    }
    free(snapshot->values);
    free(snapshot->states);
    free(snapshot->dirty);
    free(snapshot->group_steps);
    *snapshot = (hada_snapshot){0};
}

/* What tells arrays apart, but for chance: FNV-1a over words of 64 bits in lanes, none of which waits for the one
 * before (G. Fowler, L. C. Noll and P. Vo, 1991). */
static uint64_t digest_of(const float *values, size_t count, uint64_t digest)
{
    enum { DIGEST_LANES = 8, WORD = sizeof(uint64_t) / sizeof(float) };
    const uint64_t prime = UINT64_C(0x100000001b3);
    uint64_t lanes[DIGEST_LANES], word;
    for (int k = 0; k < DIGEST_LANES; k++)
        lanes[k] = digest + (uint64_t)k;
    const size_t step = (size_t)DIGEST_LANES * WORD, whole = count / step * step;
    for (size_t i = 0; i < whole; i += step)
        for (size_t k = 0; k < DIGEST_LANES; k++) {
            memcpy(&word, values + i + k * WORD, sizeof word);
            lanes[k] = (lanes[k] ^ word) * prime;
        }
    for (size_t i = whole; i < count; i++) {
        word = 0;
        memcpy(&word, values + i, sizeof *values);
        lanes[0] = (lanes[0] ^ word) * prime;
    }
    for (int k = 0; k < DIGEST_LANES; k++)
        digest = (digest ^ lanes[k]) * prime;
    return digest;
}

/* Whether a rank has other values or states than the first; a digest is compared, which takes no more than reading. */
static hada_status compare(const hada_snapshot *snapshot, const hada_workers *workers, int group, int *differ,
                           hada_error *err)
{
    const uint64_t values = digest_of(snapshot->values[group], hada_workers_floats(workers, group, HADA_CONTENT_VALUES),
                                      UINT64_C(0xcbf29ce484222325));
    const uint64_t own =
        digest_of(snapshot->states[group], hada_workers_floats(workers, group, HADA_CONTENT_STATE), values);
    uint64_t first = own;
    double others = 0.0;
    HADA_TRY(hada_broadcast(workers->ranks, 0, &first, sizeof first, err));
    others = first != own;
    HADA_TRY(hada_reduce(workers->ranks, &others, 1, err));
    *differ = others > 0.0;
    return HADA_OK;
}

/* An array of the first rank, in the place of the own one; *changed: it was another. */
static hada_status take_first(const hada_communicator *ranks, float *values, size_t count, int *changed,
                              hada_error *err)
{
    const size_t bytes = count * sizeof *values;
    float *own = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(own = hada_alloc_raw(count, sizeof *own, "a copy of the parameters", err)));
    memcpy(own, values, bytes);
    HADA_TRY_OR_DONE(hada_broadcast(ranks, 0, values, bytes, err));
    *changed |= memcmp(own, values, bytes) != 0;
done:
    free(own);
    return status;
}

/* Devices of different kinds round differently, so that ranks would drift apart: all go on with what the first has. */
static hada_status agree(hada_snapshot *snapshot, hada_workers *workers, int group, hada_error *err)
{
    int changed = 0, differ = 0;
    if (hada_ranks(workers->ranks) == 1)
        return HADA_OK;
    HADA_TRY(compare(snapshot, workers, group, &differ, err));
    if (!differ)
        return HADA_OK;
    HADA_TRY(take_first(workers->ranks, snapshot->values[group],
                        hada_workers_floats(workers, group, HADA_CONTENT_VALUES), &changed, err));
    HADA_TRY(take_first(workers->ranks, snapshot->states[group],
                        hada_workers_floats(workers, group, HADA_CONTENT_STATE), &changed, err));
    if (changed)
        HADA_TRY(hada_snapshot_give(snapshot, workers, group, err));
    return HADA_OK;
}

hada_status hada_snapshot_take(hada_snapshot *snapshot, hada_workers *workers, const hada_train_progress *progress,
                               hada_error *err)
{
    for (int g = 0; g < workers->groups; g++) {
        if (!snapshot->dirty[g] || !hada_workers_have(workers, g))
            continue;
        HADA_TRY(hada_workers_read(workers, g, HADA_CONTENT_VALUES, snapshot->values[g], err));
        HADA_TRY(hada_workers_read(workers, g, HADA_CONTENT_STATE, snapshot->states[g], err));
        HADA_TRY(agree(snapshot, workers, g, err));
        snapshot->dirty[g] = 0;
    }
    snapshot->step = progress->step;
    memcpy(snapshot->group_steps, progress->group_steps, (size_t)workers->groups * sizeof *snapshot->group_steps);
    return HADA_OK;
}

hada_status hada_snapshot_give(const hada_snapshot *snapshot, hada_workers *workers, int group, hada_error *err)
{
    return hada_workers_write(workers, group, snapshot->values[group], snapshot->states[group], err);
}

hada_status hada_snapshot_restore(hada_snapshot *snapshot, hada_workers *workers, hada_train_progress *progress,
                                  hada_error *err)
{
    for (int g = 0; g < workers->groups; g++) {
        /* Batch norms change with every forward pass in training, not with updates alone. */
        if (snapshot->dirty[g] || g == HADA_GROUP_NET)
            HADA_TRY(hada_snapshot_give(snapshot, workers, g, err));
        snapshot->dirty[g] = 0;
    }
    progress->step = snapshot->step;
    memcpy(progress->group_steps, snapshot->group_steps, (size_t)workers->groups * sizeof *snapshot->group_steps);
    return HADA_OK;
}
