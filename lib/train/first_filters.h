/* Where the training of filters begins: the model's, or random ones. Internal. */
#ifndef HADA_TRAIN_FIRST_FILTERS_H
#define HADA_TRAIN_FIRST_FILTERS_H

#include "train/replica_shape.h"

/* Values of a depth's filters, all channels, in the order of the device. */
hada_status hada_first_filters(const hada_replica_shape *shape, const hada_replica_desc *desc, int depth, float *values,
                               hada_error *err);

#endif
