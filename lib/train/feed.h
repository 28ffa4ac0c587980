/* Pairs for training in a fixed order, changed on their way, ready ahead of time. Internal.
 *
 * Which pair stands at which place, and how it is changed, are pure functions of the seed and the place: resuming needs
 * nothing but the number of pairs that were taken. */
#ifndef HADA_TRAIN_FEED_H
#define HADA_TRAIN_FEED_H

#include <hadalens/train.h>

/* The pair at a place of the endless list: all pairs of all depths once, shuffled by (seed, round), then all of them
 * again in another order. */
void hada_order_pair(const hada_pairs *pairs, uint64_t seed, uint64_t place, int *depth, int *pair);

/* Changes a pair by (seed, place) as the options say; window sizes as in a model. */
hada_status hada_augment_pair(const hada_augment *augment, uint64_t seed, uint64_t place, hada_image *raw,
                              hada_image *scene, hada_error *err);

/* A ring that a thread of its own fills in order. */
typedef struct hada_feed hada_feed;
typedef struct hada_fed {
    int depth, pair;
    hada_image raw, scene; /* owned by the feed until the next call */
} hada_fed;

typedef struct hada_feed_desc {
    const hada_pairs *pairs;
    const hada_model_info *info;
    hada_augment augment;
    uint64_t seed, first; /* place to begin at */
    int ahead;            /* pairs kept ready */
} hada_feed_desc;
hada_status hada_feed_create(hada_feed **out, const hada_feed_desc *desc, hada_error *err);
void hada_feed_destroy(hada_feed **feed);

/* The next `count` pairs, in order; an error of reading a pair is given here and names it. */
hada_status hada_feed_take(hada_feed *feed, int count, hada_fed *out, hada_error *err);

#endif
