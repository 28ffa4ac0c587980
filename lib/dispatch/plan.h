/* What a plan holds. Internal. */
#ifndef HADA_DISPATCH_PLAN_H
#define HADA_DISPATCH_PLAN_H

#include "dispatch/frame_cache.h"
#include "engine/config.h"
#include "engine/skip.h"

typedef struct hada_share hada_share;
typedef struct hada_board hada_board;

struct hada_plan {
    const hada_model *model;
    hada_plan_options options; /* its pointers are not kept: the arrays below are */
    hada_plan_shape shape;
    int *depths;                /* indices into the model */
    double *distances;          /* per computed depth */
    unsigned char *listed;      /* per computed depth: named by HADA_OCCUPIED_LIST */
    hada_classic_camera camera; /* of the listed depths, for a classic method */
    hada_image dark_frame;      /* empty where none */
    hada_plan_skip skip;
    hada_frames frames;
    hada_share **shares; /* one a context */
    hada_lane **lanes;   /* queues of the first device, of the second, ... */
    int share_count, lane_count;
    hada_board *board;
};

#endif
