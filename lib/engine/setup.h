/* What a plan knows before any frame comes, on the host and whatever the device: what the options come to for a model,
 * fixed before anything is allocated, and lists and images made from it. Read-only once it is made. Internal. */
#ifndef HADA_ENGINE_SETUP_H
#define HADA_ENGINE_SETUP_H

#include <hadalens/reconstruct.h>

#include "classic/classic.h"
#include "filter/gains.h"
#include "focus/focus.h"
#include "net/enhance.h"
#include "refine/pursuit.h"

typedef struct hada_config {
    int depths;                  /* computed */
    int batch;                   /* depths at once in the Hadamard stage, at most */
    int batch_whole;             /* 1: all of them where launches cost more than memory: on a GPU that works alone */
    int queues;                  /* of each device */
    int joint;                   /* 1: planes that explain the frame jointly, by refinement of the occupied depths or a
                                    classic method; 0: linear filters */
    int classic;                 /* 1: by a classic method */
    hada_refine_weights weights; /* of refinement */
    int choose;                  /* 1: the weight of total variation is found from frames */
    int keep;                    /* 1: and kept for those after it, until their noise is another */
    int warm;                    /* 1: frames go on from the one before */
    hada_boundary boundary;      /* of joint planes: weights of pixels need the data step of a sensor that crops */
    int outside;                 /* 1: refinement explains light from outside the window as well */
    int weighs;                  /* 1: pixels of a frame may have weights */
    hada_frame_kind kind;        /* what the caller or the model says of frames */
    hada_mosaic mosaic;          /* of frames of one channel that are not binned; HADA_MOSAIC_NONE: there are none */
    double share;                /* of refined planes, the rest being those of the linear filters; 1: refined alone */
    int steps;                   /* refinement steps or iterations at most */
    int saturated_steps;         /* the same for frames with many saturated values */
    double crosstalk;            /* share at which a plane halves beside another one; 0: none does */
    int parting;                 /* 1: several depths take more steps, until they no longer change */
    int pursuit;                 /* 1: the occupied depths are found */
    hada_scene scene;         /* what it may be taken for; planes where it cannot be a surface; a volume is found by a
                                 classic method */
    int volume;               /* 1: a frame may be found to be a volume; 2: before its depths are looked for */
    int half;                 /* filters on the device as half */
    int bank;                 /* contents of the bank: HADA_BANK_FILTERS, HADA_BANK_OTFS, or both */
    int dark;                 /* 1: a dark frame is taken off */
    int enhance;              /* 1: planes go through the model's net */
    int full_grid;            /* of the pursuit: 1: no small grids */
    int pruned;               /* 1: inverse transforms compute the window alone */
    int bounded;              /* 1: max_error may change the planes */
    int measured;             /* 1: the energy of spectra is measured */
    int half_by_error;        /* 1: max_error chose half */
    int band_rows, band_cols; /* of the caller; 0, 0: all */
    hada_focus_options focus;
    hada_classic_shape method; /* of the classic method */
} hada_config;

/* Values of one plane: channels x window. */
size_t hada_plane_values(const hada_model_info *info);

/* Iterations of Richardson-Lucy that a volume takes. */
enum { HADA_VOLUME_ITERATIONS = 120 };

/* The method that finds volumes, of all computed depths; its grid may become smaller. */
hada_status hada_config_volume(const hada_config *config, const hada_model_info *info, hada_classic_shape *shape,
                               hada_error *err);

/* What refines the planes of a pipeline. */
hada_refine_shape hada_config_refine(const hada_config *config, const hada_model *model);

typedef struct hada_setup {
    hada_model *model;         /* held, not changed */
    hada_plan_options options; /* its pointers are not kept: the arrays below are */
    hada_config config;
    int *depths;                  /* indices into the model */
    double *distances;            /* per computed depth, mm */
    unsigned char *listed;        /* per computed depth: named by HADA_OCCUPIED_LIST */
    hada_noise_share noise_share; /* hada_model_noise_share(); none where the caller set a weight */
    hada_classic_camera camera;   /* of the listed depths, for a classic method */
    hada_image dark_frame;        /* empty where none */
    int bad_pixels;               /* 1: frames may have some, which are looked for */
    hada_image pixel_weights;     /* of all channels, the largest one 1; empty where none */
    const hada_image *flat;       /* what pixels make of the same light, of all channels: the caller's or the model's;
                                     NULL where neither has any */
    hada_image own_flat;
    hada_gains *gains;            /* of the listed depths; NULL where spectra are not measured */
    int *same_dark, *same_filter; /* per channel: the first one with the same dark frame, the same filters */
} hada_setup;

/* What the memory of a plan depends on: config, depths, distances and the dark frame; filters are not read. `context`:
 * of the first device. What a failure leaves half made is for hada_setup_free(). */
hada_status hada_setup_begin(hada_setup *setup, hada_context *context, const hada_model *model,
                             const hada_plan_options *options, hada_error *err);
/* All of it. */
hada_status hada_setup_make(hada_setup *setup, hada_context *context, const hada_model *model,
                            const hada_plan_options *options, hada_error *err);
void hada_setup_free(hada_setup *setup);

#endif
