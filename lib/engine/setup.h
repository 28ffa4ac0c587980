/* What a plan knows before any frame comes, on the host and whatever the device. Read-only once it is made. Internal.
 */
#ifndef HADA_ENGINE_SETUP_H
#define HADA_ENGINE_SETUP_H

#include "engine/config.h"
#include "filter/gains.h"

typedef struct hada_setup {
    const hada_model *model;
    hada_plan_options options; /* its pointers are not kept: the arrays below are */
    hada_config config;
    int *depths;                  /* indices into the model */
    double *distances;            /* per computed depth, mm */
    unsigned char *listed;        /* per computed depth: named by HADA_OCCUPIED_LIST */
    double noise_share;           /* hada_model_noise_share(); 0 where a weight was told */
    hada_classic_camera camera;   /* of the listed depths, for a classic method */
    hada_image dark_frame;        /* empty where none */
    hada_gains *gains;            /* of the listed depths; NULL where spectra are not measured */
    int *same_dark, *same_filter; /* per channel: the first one with the same dark frame, the same filters */
} hada_setup;

/* `context`: of the first device. What a failure leaves half made is for hada_setup_free(). */
hada_status hada_setup_make(hada_setup *setup, hada_context *context, const hada_model *model,
                            const hada_plan_options *options, hada_error *err);
void hada_setup_free(hada_setup *setup);

#endif
