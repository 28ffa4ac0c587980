/* Several devices: their gradients become one, in a fixed order, and what each has updated goes to all; the gradients
 * of ranks, each the sum over its devices, then become one in theirs. Internal. Nothing to do for one worker of one
 * rank. */
#ifndef HADA_TRAIN_EXCHANGE_H
#define HADA_TRAIN_EXCHANGE_H

#include "train/workers.h"

/* A group's gradients become their sum, in the workers' order, which every worker keeps of the part that it updates
 * (filters: all of it); adds the sum of its squares to *squares. */
hada_status hada_exchange_gradients(hada_workers *workers, int group, double *squares, hada_error *err);

/* Gives each worker the values of a net that the others have updated; running statistics of batch norms become their
 * means. Filters are the same everywhere. */
hada_status hada_exchange_values(hada_workers *workers, int group, hada_error *err);

#endif
