#include "train/features.h"

#include <stdlib.h>

#include "core/alloc.h"

hada_status hada_features_create(hada_features *features, size_t scenes, size_t floats, size_t most, hada_error *err)
{
    *features = (hada_features){.floats = floats, .most = most};
    if (!scenes)
        return HADA_OK;
    hada_status status =
        hada_allocated(features->kept = hada_alloc(scenes, sizeof *features->kept, "the list of scenes", err));
    features->count = status ? 0 : scenes;
    return status;
}

void hada_features_free(hada_features *features)
{
    for (size_t i = 0; i < features->count; i++)
        free(features->kept[i]);
    free(features->kept);
    *features = (hada_features){0};
}

const float *hada_features_find(const hada_features *features, size_t scene)
{
    return scene && scene <= features->count ? features->kept[scene - 1] : NULL;
}

float *hada_features_room(hada_features *features, size_t scene)
{
    const size_t bytes = features->floats * sizeof(float);
    if (!scene || scene > features->count || features->kept[scene - 1] || bytes > features->most - features->bytes)
        return NULL;
    float **at = &features->kept[scene - 1];
    /* training goes on without what does not fit */
    if (hada_allocated(*at = hada_alloc_raw(features->floats, sizeof(float), "features", NULL)))
        return NULL;
    features->bytes += bytes;
    return *at;
}

void hada_features_drop(hada_features *features, size_t scene)
{
    free(features->kept[scene - 1]);
    features->kept[scene - 1] = NULL;
    features->bytes -= features->floats * sizeof(float);
}
