/* Nets that begin as they should end: close to what they are given. Internal. */
#ifndef HADA_TRAIN_IDENTITY_H
#define HADA_TRAIN_IDENTITY_H

#include "netlist/net_list.h"

/* Changes first weights such that the net gives its input back, where that is above zero: in the convolutions at full
 * size some channels pass the input on, and the last convolution looks at them alone. All other weights stay random,
 * and everything is trained from there. Returns 0 and changes nothing where the list offers no such way (a batch norm
 * stands in it, or other channels come out than go in). */
int hada_net_start_as_identity(hada_net *net);

#endif
