/* Scenes of several depths, made of pairs that have one each. Internal.
 *
 * Light adds up: a captured frame becomes that of another scene when the learned camera adds what is new in it and
 * takes away what is gone. Noise, dark level, and what the camera leaves unexplained of the pair stay as they were
 * captured. Which scene a pair becomes is a function of the seed, the pair and the variant alone. */
#ifndef HADA_TRAIN_COMPOSE_H
#define HADA_TRAIN_COMPOSE_H

#include "train/train_pairs.h"

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

#endif
