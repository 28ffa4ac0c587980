/* One worker for each device: a slot, a replica and, where the stage needs one, a maker of planes. Internal.
 *
 * The values of all groups are the same on all workers; each updates a share of the values of a net, has the
 * optimiser's states of these alone, and gives the new values to the others (below). Ranks have the same
 * values too, and each updates all of them. */
#ifndef HADA_TRAIN_WORKERS_H
#define HADA_TRAIN_WORKERS_H

#include "core/callers.h"
#include "train/examples.h"
#include "train/replica.h"

typedef struct hada_worker {
    hada_slot *slot;
    hada_replica *replica;
    hada_planes *planes;  /* NULL where the stage needs none */
    hada_sample *samples; /* of the wave */
    hada_example *own;    /* examples of the wave that are not kept elsewhere */
    int at_once;          /* room for so many */
    hada_terms terms;
    unsigned char *touched; /* depths, of the step */
    float *values;          /* of a group, while workers exchange them */
    float *room;            /* for a depth's filters, where there are several workers */
    double squares;         /* the sum of squares of this worker's part of a gradient */
    hada_status status;
    hada_error error;
} hada_worker;

typedef struct hada_worker_task hada_worker_task;

typedef struct hada_workers {
    hada_worker *worker;
    int count, groups;              /* groups of parameters */
    hada_worker_task *tasks;        /* of each worker, in threads of their own */
    const hada_communicator *ranks; /* that have workers as well; NULL: none */
    hada_buckets buckets;           /* of a single worker among ranks */
} hada_workers;

/* A worker on each context. ranks: that have such workers too, NULL: none; desc: of all replicas, but for their number;
 * planes: whether they make planes. */
hada_status hada_workers_create(hada_workers *workers, hada_context *const *contexts, int count,
                                const hada_communicator *ranks, const hada_replica_desc *desc, int planes,
                                hada_error *err);
void hada_workers_destroy(hada_workers *workers);

static inline hada_parameters *hada_worker_parameters(const hada_worker *worker)
{
    return hada_replica_parameters(worker->replica);
}

/* Runs `work` for every worker: in threads where there are several, and returns the first failure in their order. */
typedef hada_status (*hada_work)(hada_workers *workers, int number, void *user, hada_error *err);
hada_status hada_workers_run(hada_workers *workers, hada_work work, void *user, hada_error *err);

/* Floats of a group; whether it has any values. A depth's filters: HADA_GROUP_FILTERS + z. */
size_t hada_workers_floats(const hada_workers *workers, int group, hada_content content);
int hada_workers_have(const hada_workers *workers, int group);

/* Values or states of a group, in room for hada_workers_floats(): states stand with the workers that need them. */
hada_status hada_workers_read(hada_workers *workers, int group, hada_content content, float *out, hada_error *err);

/* Values and states of a group, to all workers. */
hada_status hada_workers_write(hada_workers *workers, int group, const float *values, const float *states,
                               hada_error *err);

/* Exchange: the gradients of several devices become one, in a fixed order, and each device receives what the others
 * have updated; the gradients of ranks, each the sum over its devices, then become one in the order of the ranks. One
 * worker of one rank has nothing to exchange.
 *
 * A group's gradients become their sum, in the workers' order, which every worker keeps of the part that it updates
 * (filters: all of it); adds the sum of its squares to *squares. */
hada_status hada_exchange_gradients(hada_workers *workers, int group, double *squares, hada_error *err);

/* Gives each worker the values of a net that the others have updated; running statistics of batch norms become their
 * means. Filters are the same everywhere. */
hada_status hada_exchange_values(hada_workers *workers, int group, hada_error *err);

/* Where training stands, beside the values. */
typedef struct hada_train_progress {
    uint64_t step;         /* steps done */
    uint64_t place;        /* places of the order that were passed */
    uint64_t *group_steps; /* updates of each group */
    int halvings;          /* of the rates: one for each rollback */
    int bad;               /* rollbacks since the last good step */
    uint64_t failed;       /* step of the last rollback, and rollbacks without getting there; not in checkpoints */
    int stuck;
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
