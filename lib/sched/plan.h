/* What a plan holds. Internal. */
#ifndef HADA_SCHED_PLAN_H
#define HADA_SCHED_PLAN_H

#include <hadalens/reconstruct.h>

#include "filter/bank.h"
#include "filter/hadamard.h"
#include "focus/focus.h"
#include "refine/admm.h"
#include "refine/pursuit.h"

/* What the options come to for a model: fixed before anything is allocated. */
typedef struct hada_plan_shape {
    int depths;  /* computed */
    int batch;   /* depths at once in the Hadamard stage */
    int refined; /* 1: planes by refinement of the occupied depths; 0: linear filters */
    int steps;   /* refinement steps at most */
    int pursuit; /* 1: the occupied depths are found */
    int half;    /* filters on the device as half */
    int parts;   /* of the bank: filters or transfer functions */
    hada_focus_options focus;
} hada_plan_shape;

/* HADA_ERROR_MODEL or HADA_ERROR_ARGUMENT where the model cannot do what is asked. */
hada_status hada_plan_shape_of(const hada_model *model, const hada_plan_options *options, hada_plan_shape *shape,
                               hada_error *err);

struct hada_plan {
    hada_context *context;
    const hada_model *model;
    hada_plan_options options; /* its pointers are not kept: the arrays below are */
    hada_plan_shape shape;
    int *depths;           /* indices into the model */
    double *distances;     /* per computed depth */
    unsigned char *listed; /* per computed depth: named by HADA_OCCUPIED_LIST */
    int *occupied;         /* room for a list of computed depths */
    double *levels;        /* per channel: the dark level of the frame in hand */
    hada_image dark_frame; /* empty where none */
    hada_slot *slot;
    hada_hadamard *stage;
    hada_bank *bank;
    hada_buffer prior;
    hada_refiner *refiner;
    hada_pursuit *pursuit;
    hada_buffer planes;   /* linear: [depth][channel][window] */
    hada_buffer pictures; /* all-in-focus image, then distance map */
    hada_focus *focus;
};

/* Values of one plane: channels x window. */
size_t hada_plan_plane(const hada_plan *plan);

/* What the focus of a plan works on; its distances are for the caller to set. */
hada_focus_desc hada_plan_focus_of(const hada_model_info *info, const hada_plan_shape *shape);

/* The pursuit for a model and a number of depths, and making it. */
hada_pursuit_options hada_plan_pursuit_of(const hada_model *model, int depths);
hada_status hada_plan_make_pursuit(hada_plan *plan, hada_error *err);

/* Finds which computed depths the frame in the stage occupies: plan->occupied[0 .. *count - 1], ascending. */
hada_status hada_plan_find_occupied(hada_plan *plan, int *count, hada_error *err);

#endif
