#include "train/step_images.h"

/* All are zero at first: halos, and what fills up tensors, stay so. */
hada_status hada_step_images_create(hada_step_images *images, hada_slot *slot, const hada_replica_shape *shape,
                                    hada_error *err)
{
    *images = (hada_step_images){.slot = slot, .shape = shape};
    for (int i = 0; i < HADA_STEP_PLACES; i++) {
        const size_t bytes = shape->bytes[i];
        if (!bytes)
            continue;
        HADA_TRY(hada_buffer_create(&images->place[i], slot->context, bytes, "the images of a step", err));
        HADA_TRY(hada_buffer_clear(&images->place[i], slot, 0, bytes, err));
    }
    return HADA_OK;
}

void hada_step_images_destroy(hada_step_images *images)
{
    for (int i = 0; i < HADA_STEP_PLACES; i++)
        hada_buffer_destroy(&images->place[i]);
}

hada_planar hada_step_plain(const hada_tensor *tensor, cl_mem mem, size_t offset)
{
    const size_t plane = (size_t)tensor->rows * (size_t)tensor->cols;
    return (hada_planar){.mem = mem,
                         .offset = offset,
                         .image_stride = plane * (size_t)tensor->channels,
                         .channel_stride = plane,
                         .row_stride = (size_t)tensor->cols};
}

hada_status hada_step_upload(hada_step_images *images, hada_step_place place, const hada_image *image, int number,
                             hada_error *err)
{
    const hada_replica_shape *shape = images->shape;
    const size_t bytes = (place == HADA_STEP_PLANES ? shape->input : shape->plane) * sizeof(float);
    hada_slot_stage(images->slot, "upload");
    return hada_buffer_write(&images->place[place], images->slot, (size_t)number * bytes, image->data, bytes, err);
}
