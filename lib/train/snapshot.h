/* Where training stands, and the last good values and states on the host. Internal. */
#ifndef HADA_TRAIN_SNAPSHOT_H
#define HADA_TRAIN_SNAPSHOT_H

#include "train/workers.h"

/* Where training stands, beside the values. */
typedef struct hada_train_progress {
    uint64_t step;         /* steps done */
    uint64_t place;        /* places of the order that were passed */
    uint64_t *group_steps; /* updates of each group */
    int halvings;          /* of the rates: one for each rollback */
    int bad;               /* rollbacks since the last good step */
} hada_train_progress;

typedef struct hada_snapshot {
    uint64_t step;
    uint64_t *group_steps;
    float **values, **states;
    unsigned char *dirty; /* groups that were updated since */
    int groups;
} hada_snapshot;

hada_status hada_snapshot_create(hada_snapshot *snapshot, hada_workers *workers, const hada_train_progress *progress,
                                 hada_error *err);
void hada_snapshot_free(hada_snapshot *snapshot);

/* Dirty groups, and progress. */
hada_status hada_snapshot_take(hada_snapshot *snapshot, hada_workers *workers, const hada_train_progress *progress,
                               hada_error *err);
hada_status hada_snapshot_restore(hada_snapshot *snapshot, hada_workers *workers, hada_train_progress *progress,
                                  hada_error *err);

/* Gives the snapshot's values and states of a group to all workers. */
hada_status hada_snapshot_give(const hada_snapshot *snapshot, hada_workers *workers, int group, hada_error *err);

#endif
