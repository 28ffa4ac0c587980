/* The inside of a trainer: its modules, composed. Internal.
 *
 * A step is made of waves: each worker takes up to at_once samples of a wave, in a thread of its own where there are
 * several; ranks share the pairs of a step, each with waves of its own. What a checkpoint holds is hada_train_progress,
 * the values, and the optimiser's states. */
#ifndef HADA_TRAIN_TRAINER_H
#define HADA_TRAIN_TRAINER_H

#include <hadalens/train.h>

#include "netlist/net_list.h"
#include "train/feed.h"
#include "train/workers.h"

/* The options of a training, what its stage needs, and its nets. */

/* The caller's options taken over; options->augment becomes `augment`. What is left open is filled in: the form, the
 * net's size; at_once stays open where it was. */
hada_status hada_train_options_settle(hada_train_options *options, hada_augment *augment,
                                      const hada_train_options *callers, const hada_model *model, hada_error *err);

/* Whether a new net could take, beside a plane, what the others hold. */
int hada_train_may_see_others(const hada_train_options *options, const hada_model_info *info);

int hada_stage_has_discriminator(const hada_train_options *options);
int hada_stage_has_planes(hada_stage stage);

/* Nothing but the pair itself decides what a replica takes of it (flips of planes apart), so it can be kept. */
int hada_stage_keeps(const hada_augment *augment);

/* Ways in which a scene is flipped: features of each are kept. */
enum { HADA_FLIPPED_WAYS = 4 };

/* The share of the rates at a step (counted from 0), before any rollback. */
double hada_train_rate(const hada_train_options *options, uint64_t step);

/* Changes first weights such that the net gives its input back, where that is above zero: in the convolutions at full
 * size some channels pass the input on, and the last convolution looks at them alone. All other weights stay random,
 * and everything is trained from there. Returns 0 and changes nothing where the list offers no such way (a batch norm
 * stands in it, or other channels come out than go in). */
int hada_net_start_as_identity(hada_net *net);

/* NULL where the stage has none: the generator, its discriminator, VGG-16. */
typedef struct hada_train_nets {
    hada_net *net, *discriminator, *vgg;
} hada_train_nets;

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
    hada_model *model; /* held, not changed */
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
