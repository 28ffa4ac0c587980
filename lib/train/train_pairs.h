/* The pairs to learn from: read and checked, and their order. Internal. */
#ifndef HADA_TRAIN_TRAIN_PAIRS_H
#define HADA_TRAIN_TRAIN_PAIRS_H

#include <hadalens/train.h>

/* Pairs of all depths. */
uint64_t hada_pairs_total(const hada_dataset *pairs);

/* The depth and the number within it of the pair that is the `index`-th over all depths, near to far. */
void hada_pairs_find(const hada_dataset *pairs, uint64_t index, int *depth, int *pair);

/* Its inverse: the number of a pair over all depths, from 0 on. */
size_t hada_pairs_number(const hada_dataset *pairs, int depth, int pair);

/* Reads and checks a pair, brings its scene to light (the model's scene_response), and cuts the centre out of a scene
 * that has the raw frame's size. Errors name the pair. */
hada_status hada_pairs_read(const hada_dataset *pairs, const hada_model_info *info, int depth, int pair,
                            hada_image *raw, hada_image *scene, hada_error *err);

/* The pair at a place of the endless list: all pairs of all depths once, shuffled by (seed, round), then all of them
 * again in another order. At least one pair is needed. */
void hada_order_pair(const hada_dataset *pairs, uint64_t seed, uint64_t place, int *depth, int *pair);

/* Reads and checks a pair, with its scene brought to light. hada_pairs_crop(): cuts the centre out of a scene that has
 * the raw frame's size. hada_pairs_name(): puts the pair's name before a message. */
hada_status hada_pairs_load(const hada_dataset *pairs, const hada_model_info *info, int depth, int pair,
                            hada_image *raw, hada_image *scene, hada_error *err);
hada_status hada_pairs_crop(const hada_model_info *info, hada_image *scene, hada_error *err);
void hada_pairs_name(const hada_model_info *info, int depth, int pair, hada_error *err);

#endif
