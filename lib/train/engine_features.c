/* Features of the scenes of a call: from the store where it has them all, else into it as they are computed. */
#include "train/engine_parts.h"

static size_t image_bytes(const hada_engine *engine)
{
    return engine->features.image_stride * sizeof(float);
}

hada_status hada_engine_features_make(hada_engine *engine, const hada_engine_desc *desc, hada_error *err)
{
    return hada_features_create(&engine->kept, engine->shape.vgg ? desc->scenes : 0, engine->features.image_stride,
                                desc->feature_bytes, err);
}

hada_status hada_engine_features_find(hada_engine *engine, int *found, hada_error *err)
{
    const int images = engine->shape.at_once;
    hada_buffer *buffer = &engine->buffers[ENGINE_FEATURES];
    hada_status status = HADA_OK;
    *found = 1;
    for (int i = 0; i < images; i++)
        *found &= hada_features_find(&engine->kept, engine->samples[i].scene_number) != NULL;
    for (int i = 0; !status && *found && i < images; i++)
        status = hada_buffer_write(buffer, engine->slot, (size_t)i * image_bytes(engine),
                                   hada_features_find(&engine->kept, engine->samples[i].scene_number),
                                   image_bytes(engine), err);
    return status;
}

hada_status hada_engine_features_keep(hada_engine *engine, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < engine->shape.at_once; i++) {
        const size_t scene = engine->samples[i].scene_number;
        float *room = hada_features_room(&engine->kept, scene);
        if (!room)
            continue;
        status = hada_buffer_read(&engine->buffers[ENGINE_FEATURES], engine->slot, (size_t)i * image_bytes(engine),
                                  room, image_bytes(engine), err);
        if (status)
            hada_features_drop(&engine->kept, scene);
    }
    return status;
}
