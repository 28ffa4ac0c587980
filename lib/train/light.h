/* What the sensor sees of a scene at one depth, by the learned transfer functions. Internal. */
#ifndef HADA_TRAIN_LIGHT_H
#define HADA_TRAIN_LIGHT_H

#include "filter/bank.h"

typedef struct hada_light {
    hada_slot *slot;
    int channels;
    hada_fft *forward, *inverse; /* the window into a spectrum; a spectrum into the frame */
    hada_buffer image, spectrum; /* channels x the frame (the window before); channels x a spectrum */
    float *room;                 /* the frame, on the host */
    size_t frame, window;        /* floats */
} hada_light;

hada_status hada_light_create(hada_light *light, hada_slot *slot, const hada_model_info *info, hada_error *err);
void hada_light_destroy(hada_light *light);

/* frame += crop(PSF * scene); `scene` may be below zero. The bank holds transfer functions. */
hada_status hada_light_add(hada_light *light, const hada_bank *bank, int depth, const hada_image *scene,
                           hada_image *frame, hada_error *err);

#endif
