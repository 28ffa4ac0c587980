/* The options of a training, what its stage needs, and its nets. Internal. */
#ifndef HADA_TRAIN_TRAIN_OPTIONS_H
#define HADA_TRAIN_TRAIN_OPTIONS_H

#include <hadalens/train.h>

#include "netlist/net_list.h"

/* The caller's options taken over; options->augment becomes `augment`. What is left open is filled in: the form, the
 * net's size; at_once stays open where it was. */
hada_status hada_train_options_settle(hada_train_options *options, hada_augment *augment,
                                      const hada_train_options *callers, const hada_model *model, hada_error *err);

/* Whether a new net could take, beside a plane, what the others hold. */
int hada_train_may_see_others(const hada_train_options *options, const hada_model_info *info);

int hada_stage_has_net(hada_stage stage);
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

hada_status hada_train_nets_make(hada_train_nets *nets, const hada_train_options *options, const hada_model *model,
                                 hada_error *err);
void hada_train_nets_free(hada_train_nets *nets);

#endif
