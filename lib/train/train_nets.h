/* The nets of a stage. Internal. */
#ifndef HADA_TRAIN_TRAIN_NETS_H
#define HADA_TRAIN_TRAIN_NETS_H

#include <hadalens/train.h>

#include "netlist/net_list.h"

/* NULL where the stage has none: the generator, its discriminator, VGG-16. */
typedef struct hada_train_nets {
    hada_net *net, *discriminator, *vgg;
} hada_train_nets;

hada_status hada_train_nets_make(hada_train_nets *nets, const hada_train_options *options, const hada_model *model,
                                 hada_error *err);
void hada_train_nets_free(hada_train_nets *nets);

#endif
