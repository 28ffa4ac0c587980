/* The images and numbers of a training step on a device, by name. Internal. */
#ifndef HADA_TRAIN_STEP_IMAGES_H
#define HADA_TRAIN_STEP_IMAGES_H

#include "train/replica_shape.h"

typedef struct hada_step_images {
    hada_slot *slot;
    const hada_replica_shape *shape;
    hada_buffer place[HADA_STEP_PLACES]; /* those that the stage needs */
} hada_step_images;

hada_status hada_step_images_create(hada_step_images *images, hada_slot *slot, const hada_replica_shape *shape,
                                    hada_error *err);
void hada_step_images_destroy(hada_step_images *images);

static inline cl_mem hada_step_mem(const hada_step_images *images, hada_step_place place)
{
    return images->place[place].mem;
}

/* A tensor's plain floats, from `offset` on, image after image. */
hada_planar hada_step_plain(const hada_tensor *tensor, cl_mem mem, size_t offset);

/* One image of the window to its place among those of a call. */
hada_status hada_step_upload(hada_step_images *images, hada_step_place place, const hada_image *image, int number,
                             hada_error *err);

#endif
