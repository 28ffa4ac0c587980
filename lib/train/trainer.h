/* The parts of a trainer. Internal.
 *
 * A trainer has a worker for each device: a slot, an engine and, where the stage needs one, a maker of planes. A step
 * is made of waves: each worker takes up to at_once samples of a wave, in a thread of its own where there are several.
 * What a checkpoint holds is hada_progress, the values, which are the same on all workers, and the optimiser's states:
 * each worker updates a share of the values of a net, has the states of these alone, and gives the new values to the
 * others. */
#ifndef HADA_TRAIN_TRAINER_H
#define HADA_TRAIN_TRAINER_H

#include "netlist/net_list.h"
#include "train/crew.h"
#include "train/engine.h"
#include "train/examples.h"
#include "train/planes.h"

/* Where training stands, beside the values. */
typedef struct hada_progress {
    uint64_t step;         /* steps done */
    uint64_t place;        /* places of the order that were passed */
    uint64_t *group_steps; /* updates of each group */
    int halvings;          /* of the rates: one for each rollback */
    int bad;               /* rollbacks since the last good step */
} hada_progress;

/* The last good values and states on the host; groups that were updated since are dirty. */
typedef struct hada_snapshot {
    uint64_t step;
    uint64_t *group_steps;
    float **values, **states;
    unsigned char *dirty;
} hada_snapshot;

typedef struct hada_worker {
    hada_slot *slot;
    hada_engine *engine;
    hada_planes *planes;  /* NULL where the stage needs none */
    hada_sample *samples; /* of the wave: `count` */
    hada_example *own;    /* examples of the wave that are not kept elsewhere */
    int count;
    hada_terms terms;
    unsigned char *touched; /* depths, of the step */
    float *values;          /* of a group, while workers exchange them */
    float *room;            /* for a depth's filters, where there are several workers */
    double squares;         /* the sum of squares of this worker's part of a gradient */
    hada_status status;
    hada_error error;
} hada_worker;

struct hada_trainer {
    hada_train_options options; /* its augment is the next member */
    hada_augment augment;
    const hada_model *model;
    hada_model_info info;
    hada_pairs pairs, held_out;
    hada_net *net, *critic, *vgg; /* net and critic: first values; NULL where the stage has none */
    hada_worker *workers;
    int worker_count, groups;
    hada_crew *crew;           /* where there are several workers */
    hada_examples known, held; /* held.kept NULL: nothing is held out */
    hada_feed *feed;           /* NULL: to be started at progress.place */
    hada_fed **fed;            /* of the wave */
    hada_progress progress;
    hada_snapshot snapshot;
    pthread_mutex_t reading; /* of held-out pairs */
    uint64_t fingerprint;    /* of the model's filters */
};

/* trainer_options.c. The caller's options taken over; options->augment becomes `augment`. What is left open is filled
 * in: the form, the net's size, at_once stays 0 where it was. */
hada_status hada_train_options_settle(hada_train_options *options, hada_augment *augment,
                                      const hada_train_options *callers, const hada_model *model, hada_error *err);
int hada_stage_has_net(hada_stage stage);
int hada_stage_has_critic(const hada_train_options *options);
int hada_stage_has_planes(hada_stage stage);
/* Nothing but the pair itself decides what the engine sees (flips of planes apart), so it can be kept. */
int hada_stage_keeps(const hada_augment *augment);
/* Ways in which a scene is flipped: features of each are kept. */
enum { HADA_FLIPPED_WAYS = 4 };
/* The share of the rates at a step (counted from 0), before any rollback. */
double hada_train_rate(const hada_train_options *options, uint64_t step);

/* trainer_nets.c */
typedef struct hada_train_nets {
    hada_net *net, *critic, *vgg;
} hada_train_nets;
hada_status hada_train_nets_make(hada_train_nets *nets, const hada_train_options *options, const hada_model *model,
                                 hada_error *err);
void hada_train_nets_free(hada_train_nets *nets);

/* trainer_work.c. Runs `work` for every worker: in threads where there are several, and returns the first failure in
 * their order. */
typedef hada_status (*hada_work)(hada_trainer *trainer, int worker, void *user, hada_error *err);
hada_status hada_workers_run(hada_trainer *trainer, hada_work work, void *user, hada_error *err);

/* What the stage's engine sees of a pair: takes the scene over, and the raw frame where it needs it. */
hada_status hada_example_make(hada_example *out, hada_trainer *trainer, hada_worker *worker, int depth, hada_image *raw,
                              hada_image *scene, hada_error *err);

/* trainer_exchange.c; nothing to do for one worker. A group's gradients become their sum, in the workers' order, which
 * every worker keeps of the part that it updates (filters: all of it); adds the sum of its squares to *squares. */
hada_status hada_train_sum_gradients(hada_trainer *trainer, int group, double *squares, hada_error *err);
/* Gives each worker the values of a net that the others have updated; running statistics of batch norms become their
 * means. Filters are the same everywhere. */
hada_status hada_train_share_values(hada_trainer *trainer, int group, hada_error *err);
/* Values or states of a group, in room for hada_engine_count() floats: states stand with the workers that need them. */
hada_status hada_trainer_read(hada_trainer *trainer, int group, hada_content content, float *out, hada_error *err);

/* trainer_snapshot.c */
hada_status hada_snapshot_create(hada_trainer *trainer, hada_error *err);
void hada_snapshot_free(hada_trainer *trainer);
hada_status hada_snapshot_take(hada_trainer *trainer, hada_error *err); /* dirty groups, progress */
hada_status hada_snapshot_restore(hada_trainer *trainer, hada_error *err);
/* Gives the snapshot's values and states of a group to all workers. */
hada_status hada_snapshot_give(hada_trainer *trainer, int group, hada_error *err);

/* Whether a group has any values; a depth's filters: HADA_GROUP_FILTERS + z. */
int hada_trainer_has(const hada_trainer *trainer, int group);

#endif
