/* Batches of depths that workers take from a frame: what engine asks for (engine/frame.h), for jobs. Internal.
 *
 * The worker that runs the frame takes from the near end, so that it can push what it computed to the focus at once;
 * those of other devices that help take from the far end and leave their planes in the result. */
#ifndef HADA_DISPATCH_BATCHES_H
#define HADA_DISPATCH_BATCHES_H

#include "dispatch/state.h"

extern const hada_batches hada_job_batches;

/* Whether a helper would find any. The caller holds the lock. */
int hada_batches_left(const hada_job *job);

/* For a helper; as those of hada_batches, from the far end. */
int hada_batches_take_far(hada_job *job, const hada_queue_worker *worker, int *first);
void hada_batches_put(hada_job *job, hada_queue_worker *worker, int first, int count, int done);

#endif
