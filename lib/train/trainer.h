/* The inside of a trainer: its modules, composed. Internal.
 *
 * A step is made of waves: each worker takes up to at_once samples of a wave, in a thread of its own where there are
 * several; ranks share the pairs of a step, each with waves of its own. What a checkpoint holds is hada_train_progress,
 * the values, and the optimiser's states. */
#ifndef HADA_TRAIN_TRAINER_H
#define HADA_TRAIN_TRAINER_H

#include "train/feed.h"
#include "train/train_options.h"
#include "train/workers.h"

/* Pairs to validate with; NULL: nothing is held out. */
typedef struct hada_held_out {
    const hada_dataset *pairs;
    hada_examples examples;
    pthread_mutex_t reading;
} hada_held_out;

struct hada_trainer {
    hada_train_options options; /* its augment and communicator are the next members */
    hada_augment augment;
    hada_communicator ranks;
    const hada_model *model;
    hada_model_info info;
    hada_train_nets nets; /* net and discriminator: first values */
    const hada_dataset *pairs;
    hada_examples known; /* of them */
    hada_held_out held_out;
    hada_workers workers;
    hada_feed *feed;  /* NULL: to be started at progress.place */
    hada_fed **fed;   /* of the wave */
    int first, share; /* this rank's pairs of a step, of options.batch */
    hada_train_progress progress;
    hada_snapshot snapshot;
    const hada_monitor *monitor; /* asked within a validation; NULL: nobody */
};

/* Whether the net only says whose light is whose: then it learns from planes of several depths alone. */
static inline int hada_trainer_shares(const hada_trainer *trainer)
{
    return trainer->nets.net && trainer->nets.net->shares;
}

#endif
