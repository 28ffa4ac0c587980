/* Changes of a pair on its way: functions of (seed, place) alone. Internal. */
#ifndef HADA_TRAIN_AUGMENT_H
#define HADA_TRAIN_AUGMENT_H

#include <hadalens/train.h>

/* Changes a pair by (seed, place): shift, flips, exposure, noise, in this order. `dark` is the level of the raw frame
 * that is no light, and not scaled (hada_model_info; negative counts as 0). */
hada_status hada_augment_pair(const hada_augment *augment, double dark, uint64_t seed, uint64_t place, hada_image *raw,
                              hada_image *scene, hada_error *err);

/* plane_flips: flips a reconstructed plane and its scene together; returns the sides as hada_augment counts them. */
int hada_augment_plane(const hada_augment *augment, uint64_t seed, uint64_t place, hada_image *plane,
                       hada_image *scene);

/* Whether options make sense for a camera; the message says what to change. */
hada_status hada_augment_check(const hada_augment *augment, const hada_model_info *info, hada_error *err);

#endif
