/* One device's copy of what is trained, and a step on it: forward, losses, backward. Internal.
 *
 * Gradients of several calls of hada_replica_backward() add up until they are cleared (train/parameters.h).
 *
 * Among ranks a net's gradient goes in buckets: each is read as soon as backward has made it, and exchanged while the
 * device goes on with the layers before. */
#ifndef HADA_TRAIN_REPLICA_H
#define HADA_TRAIN_REPLICA_H

#include "core/callers.h"
#include "train/step.h"

/* Floats of a bucket, at least: what an exchange costs beside its bytes is little then. */
enum { HADA_BUCKET = 1 << 20 };

typedef struct hada_bucket {
    size_t first, count;
    cl_event event; /* complete: it has been read */
} hada_bucket;

typedef struct hada_buckets {
    const hada_communicator *ranks;
    hada_parameters *parameters;
    float *values; /* the gradient on the host */
    size_t from;   /* what stands behind it is in buckets */
    hada_bucket *bucket;
    int count, full; /* full: all ranks' gradient stands in `values` */
} hada_buckets;

/* Nothing is made, and *buckets stays empty, where there is one rank, or no net is trained; nor on a CPU whose ranks
 * exchange through memory: its cores would leave the backward pass for what they can do as well afterwards, in the
 * place where the gradient stands. */
hada_status hada_buckets_create(hada_buckets *buckets, const hada_communicator *ranks, hada_parameters *parameters,
                                hada_error *err);
void hada_buckets_free(hada_buckets *buckets);

typedef struct hada_replica hada_replica;

hada_status hada_replica_bytes(const hada_context *context, const hada_replica_desc *desc, size_t *bytes,
                               hada_error *err);
hada_status hada_replica_create(hada_replica **out, hada_slot *slot, const hada_replica_desc *desc, hada_error *err);
void hada_replica_destroy(hada_replica **replica);

hada_parameters *hada_replica_parameters(hada_replica *replica);

/* What VGG-16 makes of scenes, as far as it is kept. */
hada_features *hada_replica_features(hada_replica *replica);

/* Forward and backward of up to at_once samples. `weight`: of each sample in the step's mean (1 / batch). `step` names
 * the random numbers of dropout, for the call (images are counted from its first); discriminator_only: only the
 * discriminator's gradients are wanted. Terms are known when it returns. `touched` (per depth, may be NULL) is set to 1
 * where a depth's filters have a gradient.
 *
 * Gradients add up sample by sample in order, the same bits at every run. Batch norms take the statistics of the
 * samples of a call, so nets that have them depend on at_once; a call with fewer than at_once samples takes as long as
 * a full one (the samples are repeated to fill up, for the statistics alone). */
hada_status hada_replica_backward(hada_replica *replica, const hada_sample *samples, int count, double weight,
                                  uint64_t step, int discriminator_only, hada_terms *terms, unsigned char *touched,
                                  hada_error *err);

/* The next backward pass of the net ends a step's gradient: it goes to the other ranks layer by layer, through
 * `buckets`; NULL: it does not. */
void hada_replica_share(hada_replica *replica, hada_buckets *buckets);

/* Forward alone, as reconstruction does it: batch norms with their running statistics, no dropout, and what is below
 * zero becomes zero (training takes what the net and, in FILTERS, the filters give without that). `before` (FILTERS:
 * the linear plane; else the input; may be NULL) and `after` are created by the call at the window's size where
 * they are empty; FILTERS has the same in both. */
hada_status hada_replica_forward(hada_replica *replica, const hada_sample *sample, hada_image *before,
                                 hada_image *after, hada_error *err);

#endif
