/* What the options of a plan come to for a model: fixed before anything is allocated. Internal. */
#ifndef HADA_ENGINE_CONFIG_H
#define HADA_ENGINE_CONFIG_H

#include <hadalens/reconstruct.h>

#include "classic/classic.h"
#include "core/error.h"
#include "focus/focus.h"
#include "refine/pursuit.h"

typedef struct hada_plan_shape {
    int depths;               /* computed */
    int batch;                /* depths at once in the Hadamard stage, at most */
    int queues;               /* of each device */
    int refined;              /* 1: planes that explain the frame jointly, by refinement of the occupied depths or a
                                 classic method; 0: linear filters */
    int classic;              /* 1: by a classic method */
    double tv;                /* of refinement: weight of total variation */
    int steps;                /* refinement steps or iterations at most */
    int pursuit;              /* 1: the occupied depths are found */
    int half;                 /* filters on the device as half */
    int parts;                /* of the bank: filters or transfer functions */
    int dark;                 /* 1: a dark frame is taken off */
    int enhance;              /* 1: planes go through the model's net */
    int full_look;            /* of the pursuit: 1: on the whole grid */
    int pruned;               /* 1: inverse transforms compute the window alone */
    int bounded;              /* 1: max_error may change the planes */
    int measured;             /* 1: the energy of spectra is measured */
    int half_by_error;        /* 1: max_error chose half */
    int band_rows, band_cols; /* of the caller; 0, 0: all */
    hada_focus_options focus;
    hada_classic_shape method; /* of the classic method */
} hada_plan_shape;

/* HADA_ERROR_MODEL or HADA_ERROR_ARGUMENT where the model cannot do what is asked. */
hada_status hada_plan_shape_of(const hada_model *model, const hada_plan_options *options, hada_plan_shape *shape,
                               hada_error *err);

/* Values of one plane: channels x window. */
size_t hada_plane_values(const hada_model_info *info);

/* What the focus works on; its distances are for the caller to set. */
hada_focus_desc hada_plan_focus_of(const hada_model_info *info, const hada_plan_shape *shape);

/* What refines its planes. */
hada_refine_shape hada_plan_refine_of(const hada_model *model, const hada_plan_shape *shape);

/* The pursuit for a model. */
hada_pursuit_options hada_plan_pursuit_of(const hada_model *model, const hada_plan_shape *shape);

#endif
