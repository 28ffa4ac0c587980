/* A net's gradient on its way to other ranks, in buckets: each is read as soon as backward has made it, and exchanged
 * while the device goes on with the layers before. Internal. */
#ifndef HADA_TRAIN_BUCKETS_H
#define HADA_TRAIN_BUCKETS_H

#include "core/callers.h"
#include "train/parameters.h"

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

/* Before the backward pass that ends a step's gradient; `ready` is hada_graph_ready, with the buckets. */
void hada_buckets_begin(hada_buckets *buckets);
hada_status hada_buckets_ready(void *buckets, size_t from, hada_error *err);

/* After it was enqueued: waits for each bucket and adds it up over ranks. */
hada_status hada_buckets_exchange(hada_buckets *buckets, hada_error *err);

#endif
