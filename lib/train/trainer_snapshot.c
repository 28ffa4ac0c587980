/* The last good values, on the host. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "train/trainer.h"

int hada_trainer_has(const hada_trainer *trainer, int group)
{
    return hada_engine_count(trainer->workers->engine, group, HADA_CONTENT_VALUES) > 0;
}

static size_t count_of(const hada_trainer *trainer, int group, hada_content content)
{
    return hada_engine_count(trainer->workers->engine, group, content);
}

hada_status hada_snapshot_create(hada_trainer *trainer, hada_error *err)
{
    hada_snapshot *shot = &trainer->snapshot;
    const size_t groups = (size_t)trainer->groups;
    hada_status status = hada_alloc((void **)&shot->values, groups, sizeof *shot->values, "a snapshot", err);
    if (!status)
        status = hada_alloc((void **)&shot->states, groups, sizeof *shot->states, "a snapshot", err);
    if (!status)
        status = hada_alloc((void **)&shot->dirty, groups, 1, "a snapshot", err);
    if (!status)
        status = hada_alloc((void **)&shot->group_steps, groups, sizeof *shot->group_steps, "a snapshot", err);
    for (int g = 0; !status && g < trainer->groups; g++) {
        status = hada_alloc_raw((void **)&shot->values[g], count_of(trainer, g, HADA_CONTENT_VALUES), sizeof(float),
                                "a copy of the parameters", err);
        if (!status)
            status = hada_alloc_raw((void **)&shot->states[g], count_of(trainer, g, HADA_CONTENT_STATE), sizeof(float),
                                    "a copy of the optimiser's state", err);
        shot->dirty[g] = 1;
    }
    return status ? status : hada_snapshot_take(trainer, err);
}

void hada_snapshot_free(hada_trainer *trainer)
{
    hada_snapshot *shot = &trainer->snapshot;
    for (int g = 0; g < trainer->groups; g++) {
        if (shot->values)
            free(shot->values[g]);
        if (shot->states)
            free(shot->states[g]);
    }
    free(shot->values);
    free(shot->states);
    free(shot->dirty);
    free(shot->group_steps);
    *shot = (hada_snapshot){0};
}

hada_status hada_snapshot_take(hada_trainer *trainer, hada_error *err)
{
    hada_snapshot *shot = &trainer->snapshot;
    hada_status status = HADA_OK;
    for (int g = 0; !status && g < trainer->groups; g++) {
        if (!shot->dirty[g] || !hada_trainer_has(trainer, g))
            continue;
        status = hada_trainer_read(trainer, g, HADA_CONTENT_VALUES, shot->values[g], err);
        if (!status)
            status = hada_trainer_read(trainer, g, HADA_CONTENT_STATE, shot->states[g], err);
        shot->dirty[g] = (unsigned char)(status != HADA_OK);
    }
    if (status)
        return status;
    shot->step = trainer->progress.step;
    memcpy(shot->group_steps, trainer->progress.group_steps, (size_t)trainer->groups * sizeof *shot->group_steps);
    return HADA_OK;
}

static hada_status give_one(hada_trainer *trainer, int worker, void *user, hada_error *err)
{
    const int group = *(const int *)user;
    hada_engine *engine = trainer->workers[worker].engine;
    hada_status status = hada_engine_write(engine, group, HADA_CONTENT_VALUES, trainer->snapshot.values[group], err);
    return status ? status : hada_engine_write(engine, group, HADA_CONTENT_STATE, trainer->snapshot.states[group], err);
}

hada_status hada_snapshot_give(hada_trainer *trainer, int group, hada_error *err)
{
    return hada_trainer_has(trainer, group) ? hada_workers_run(trainer, give_one, &group, err) : HADA_OK;
}

hada_status hada_snapshot_restore(hada_trainer *trainer, hada_error *err)
{
    hada_snapshot *shot = &trainer->snapshot;
    hada_status status = HADA_OK;
    for (int g = 0; !status && g < trainer->groups; g++) {
        /* Batch norms change with every look at pairs, not with updates alone. */
        if (shot->dirty[g] || g == HADA_GROUP_NET)
            status = hada_snapshot_give(trainer, g, err);
        if (!status)
            shot->dirty[g] = 0;
    }
    if (status)
        return status;
    trainer->progress.step = shot->step;
    memcpy(trainer->progress.group_steps, shot->group_steps, (size_t)trainer->groups * sizeof *shot->group_steps);
    return HADA_OK;
}
