/* Batches of depths that lanes take from a frame. Internal.
 *
 * The lane that has the frame takes from the near end, so that it can push what it computed to the focus at once;
 * lanes of other devices that help take from the far end and leave their planes in the result. Where nothing else
 * is said the functions lock the board. */
#ifndef HADA_DISPATCH_BATCHES_H
#define HADA_DISPATCH_BATCHES_H

#include "engine/pipeline.h"

/* What task->depths holds. */
enum {
    HADA_DEPTH_FREE = 0,
    HADA_DEPTH_TAKEN = 1,
    HADA_DEPTH_HOME = 2, /* its plane is in the result */
    HADA_DEPTH_EMPTY = 3 /* its plane is not computed: nothing is there */
};

/* All depths with wanted[z] become free for `owner` and its helpers; the others are empty. */
void hada_batches_open(hada_task *task, const unsigned char *wanted);

/* No lane may take any more; waits until none is at it. */
void hada_batches_close(hada_task *task);

/* Takes depths *first ... *first + result - 1 for a lane; 0: none is free. Never more than the lane's batch, and less
 * where other lanes wait for work. */
int hada_batches_take(hada_task *task, const hada_lane *lane, int helps, int *first);

/* Their planes are in the result (HADA_DEPTH_HOME), or they are not computed after all (HADA_DEPTH_FREE). */
void hada_batches_put(hada_task *task, hada_lane *lane, int first, int count, int state);

/* Whether a helper would find any. The caller holds the lock. */
int hada_batches_left(const hada_task *task);

/* How many depths from `first` on have their plane in the result. `wait`: where a helper has the first in hand, until
 * it is done with it; then 0 means that it is free again. */
int hada_batches_home(hada_task *task, int first, int wait);

#endif
