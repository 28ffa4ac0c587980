/* What a frame on its way through a plan does not need (docs/skipping.md). Internal. */
#ifndef HADA_ENGINE_SKIP_H
#define HADA_ENGINE_SKIP_H

#include "engine/config.h"
#include "filter/gains.h"

typedef struct hada_lane hada_lane;
typedef struct hada_task hada_task;

/* What a plan knows before any frame comes. */
typedef struct hada_plan_skip {
    hada_gains *gains; /* of the depths that count; NULL where spectra are not measured */
    int *same_dark;    /* per channel: the first one whose dark frame is the same */
    int *same_filter;  /* per channel: the first one whose filters are the same at all depths */
} hada_plan_skip;

/* `depths`: the computed ones (indices into the model), of which listed[] count. */
hada_status hada_plan_skip_make(hada_plan_skip *skip, const hada_context *context, const hada_model *model,
                                const hada_plan_shape *shape, const int *depths, const unsigned char *listed,
                                const hada_image *dark, hada_error *err);
void hada_plan_skip_free(hada_plan_skip *skip);

/* What was found for a frame. All lanes that work on it read the same. */
typedef struct hada_task_skip {
    int *spectra, *planes;    /* per channel, as in hada_hadamard_part */
    int channels;             /* whose planes are not computed */
    int band_rows, band_cols; /* of the inverse transforms; 0, 0: all */
    double change;            /* of the stack, at most, under max_error: absolute L2 over all pixels */
    double band_change;       /* the same for the band that the caller chose */
    double norm;              /* of the stack, where max_error is above 0 */
    int limited;              /* 1: max_error left frequencies out */
    int again;                /* 1: bounded kinds are off, since their bound was not kept */
} hada_task_skip;

hada_status hada_task_skip_begin(hada_task *task, hada_error *err);
void hada_task_skip_end(hada_task *task);

/* Channels that are black or equal, once the levels are known. */
void hada_task_skip_channels(hada_task *task);

/* A lane's own part of skipping, once its stage is made, and the bytes of that. */
hada_status hada_lane_skip_make(hada_lane *lane, hada_error *err);
uint64_t hada_lane_skip_bytes(const hada_context *context, const hada_model_info *info, const hada_plan_shape *shape,
                              int batch);

/* Frequencies, once the spectrum stands in the lane's stage. */
hada_status hada_lane_skip_frequencies(hada_lane *lane, hada_task *task, hada_error *err);

/* Makes the lane's stage do what the task needs. */
void hada_lane_skip_apply(hada_lane *lane, const hada_task *task);

/* Whether planes must come from filters other than those of the bank, and computing them: as hada_hadamard_run(). */
int hada_task_skip_dense(const hada_task *task);
hada_status hada_lane_skip_dense(hada_lane *lane, int first, int count, hada_error *err);

/* After the planes came home: whether they must be computed again, since what was left out may have changed the stack
 * by more than max_error. */
int hada_task_skip_again(hada_task *task);

/* A change of the stack by at most `change`, relative to what the stack would be without it, which is at least its norm
 * - change: L2 over all pixels. Infinite where nothing can be said. */
double hada_skip_relative(double change, double norm);

/* Into the task's report. */
void hada_task_skip_report(hada_task *task);

#endif
