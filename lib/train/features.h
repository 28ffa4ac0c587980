/* What VGG-16 makes of scenes, kept on the host: they are compared with in every step that shows them. Internal.
 *
 * A store belongs to a replica, since features have the layout and the bits of its device. */
#ifndef HADA_TRAIN_FEATURES_H
#define HADA_TRAIN_FEATURES_H

#include <hadalens/status.h>
#include <stddef.h>

typedef struct hada_features {
    float **kept;       /* of scene number 1 ... count; NULL: not kept */
    size_t count;       /* 0: nothing is kept */
    size_t floats;      /* of a scene's features */
    size_t bytes, most; /* that are kept; that may be */
} hada_features;

hada_status hada_features_create(hada_features *features, size_t scenes, size_t floats, size_t most, hada_error *err);
void hada_features_free(hada_features *features);

/* NULL: not kept; also for scene 0, which stands for all that change. */
const float *hada_features_find(const hada_features *features, size_t scene);

/* Room for a scene's features, which counts as kept; NULL: none is left, it is there already, or it is scene 0. */
float *hada_features_room(hada_features *features, size_t scene);
void hada_features_drop(hada_features *features, size_t scene);

#endif
