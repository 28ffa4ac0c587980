/* Pairs for training in a fixed order, changed on their way, ready ahead of time. Internal.
 *
 * Which pair stands at which place, and how it is changed, are pure functions of the seed and the place: resuming needs
 * nothing but the number of places that were passed. */
#ifndef HADA_TRAIN_FEED_H
#define HADA_TRAIN_FEED_H

#include <hadalens/train.h>

#include "train/train_pairs.h"

/* Scenes of several depths, made of pairs that have one each.
 *
 * Light adds up: a captured frame becomes that of another scene when the learned camera adds what is new in it and
 * takes away what is gone. Noise, dark level, and what the camera leaves unexplained of the pair stay as they were
 * captured. Which scene a pair becomes is a function of the seed, the pair and the variant alone. */

/* Depths that are explained together, at most; scenes made of a pair in so many ways, variants 1 ... (0: as captured).
 */
enum { HADA_COMPOSED_DEPTHS = 6, HADA_COMPOSED_VARIANTS = 8 };

/* What becomes of a pair's frame. count 0: nothing. */
typedef struct hada_composed {
    int count; /* depths that refinement is told, ascending: the scene's, sometimes with a
                  neighbour that is dark */
    int depth[HADA_COMPOSED_DEPTHS];
    hada_image light[HADA_COMPOSED_DEPTHS]; /* what the scene has there and the pair's had not, over the window; below
                                               zero where it is gone; empty: no change */
    int whole;                              /* 1: the sum of all planes is to be seen; 0: the plane of the
                                               pair's depth */
} hada_composed;
void hada_composed_free(hada_composed *composed);

/* The variant of the pair at a place of the endless list: 0 for a share of 1 - `share` of them, drawn by the seed. */
int hada_compose_variant(const hada_dataset *pairs, uint64_t seed, uint64_t place, double share);

/* How a pair's frame changes, and in *scene, where the pair's own is given (window), what its plane (or the sum of all)
 * then is. planes_only: the sum is never to be seen. Reads other pairs. */
hada_status hada_compose(hada_composed *out, const hada_dataset *pairs, const hada_model_info *info, uint64_t seed,
                         int depth, int pair, int variant, int planes_only, hada_image *scene, hada_error *err);

/* Changes of a pair on its way: functions of (seed, place) alone. */

/* Changes a pair by (seed, place): shift, flips, exposure, noise, in this order. `dark` is the level of the raw frame
 * that is no light, and not scaled (hada_model_info; negative counts as 0). */
hada_status hada_augment_pair(const hada_augment *augment, double dark, uint64_t seed, uint64_t place, hada_image *raw,
                              hada_image *scene, hada_error *err);

/* plane_flips: flips a reconstructed plane and its scene together; returns the sides as hada_augment counts them. */
int hada_augment_plane(const hada_augment *augment, uint64_t seed, uint64_t place, hada_image *plane,
                       hada_image *scene);

/* Whether options make sense for a camera; the message says what to change. */
hada_status hada_augment_check(const hada_augment *augment, const hada_model_info *info, hada_error *err);

/* A ring that a thread of its own fills in order. */
typedef struct hada_feed hada_feed;
typedef struct hada_fed {
    uint64_t place;
    int depth, pair, variant;
    hada_image raw, scene; /* owned by the feed until the next call; empty where `known` said so */
    hada_composed composed;
} hada_fed;

typedef struct hada_feed_desc {
    const hada_dataset *pairs;
    const hada_model_info *info;
    hada_augment augment;
    double compose;        /* share of pairs that become scenes of several depths */
    int planes_only;       /* of which the sum is never to be seen */
    uint64_t seed, first;  /* place to begin at */
    int ahead;             /* pairs kept in memory, with those handed out */
    int batch, skip, take; /* of each `batch` places, `take` behind the first `skip`; batch 0: all */
    /* Whether the caller keeps what it makes of a pair, which then isn't read again; asked from the feed's thread.
     * NULL: every pair is read. */
    int (*known)(void *user, int depth, int pair, int variant);
    void *user;
} hada_feed_desc;
hada_status hada_feed_create(hada_feed **out, const hada_feed_desc *desc, hada_error *err);
void hada_feed_destroy(hada_feed **feed);

/* The next `count` pairs (at most `ahead`), in order: pointers in `out`, good until the next call. An error of reading
 * a pair is given when its turn comes, and again ever after. */
hada_status hada_feed_take(hada_feed *feed, int count, hada_fed **out, hada_error *err);

#endif
