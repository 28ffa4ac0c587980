/* Hadalens: registering a data set as the command 'register' does: how the scenes of each depth stand on the sensor,
 * what of that is applied, and a data set with registered scenes.
 *
 * Threads: a run uses the calling thread; several may run at once. */
#ifndef HADALENS_TASK_REGISTER_H
#define HADALENS_TASK_REGISTER_H

#include <hadalens/dataset.h>
#include <hadalens/monitor.h>
#include <hadalens/register.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hada_register_task {
    size_t size;                                    /* sizeof(hada_register_task) */
    double least_magnification, most_magnification; /* searched; HADA_AUTO (default): what makes the scene's longer side
                                                       0.15 and 2.5 times that of the frame */
    double most_rotation_deg;     /* searched, to either side of the quarter turns: 15 by default, at most 45 */
    int keep_offsets;             /* 1: shifts between the depths are left as they are; 0 (default): found */
    int window_rows, window_cols; /* of the registered scenes; 0 (default): what they fill, within the frame */
    const hada_monitor *monitor;
} hada_register_task;
HADA_INIT(hada_register_task, HADA_STRUCT_REGISTER_TASK)

/* What was found for a depth, and what of it is applied: a transform that would move no pixel of a scene by more than
 * the precision reached is not, but for flips and quarter turns. Owned by the
 * report. */
typedef struct hada_registered_depth {
    const hada_registration *found, *applied;
    int pairs;                  /* looked at */
    int scene_rows, scene_cols; /* of the files */
    double displacement;   /* pixels of the frame that the farthest pixel of a scene moves by, flips and quarter turns
                              aside */
    double likeness;       /* of the PSF to that of the depth before, 0 to 1; NaN: not compared */
    int offset_unknown;    /* 1: the PSFs are too little alike to tell the shift from the depth before */
    int rough;             /* 1: so little is explained that the figures are rough */
    int other_orientation; /* 1: not that of the first depth */
    int stands_right;      /* 1: nothing is applied */
} hada_registered_depth;

/* Owned by the caller: hada_register_report_destroy(). Later versions may add members to a depth, at its end. */
typedef struct hada_register_report {
    const hada_registered_depth *const *depths; /* ended by NULL */
} hada_register_report;

/* Finds the transforms of all depths, of two pairs or more each, of which at most 8 are used, evenly spread: raw frames
 * of one size, of at least 32 pixels on the longer side, and scenes of one size. A shift that all depths share cannot
 * be found; the PSF absorbs it. HADA_ERROR_DATASET where the pairs do not tell: a single one, scenes without structure,
 * or no transform that explains them clearly better than those of other orientations do.
 * docs/explanation/learning-a-camera.md */
HADA_API hada_status hada_register_run(hada_register_report **out, const hada_dataset *data,
                                       const hada_register_task *task, hada_error *err);
HADA_API void hada_register_report_destroy(hada_register_report **report);

/* Writes a data set with registered scenes into a folder that is not there yet, or empty; it appears whole or not at
 * all. Raw frames are taken over as they are, as hard links where that goes. *rows and *cols (may be NULL): the size of
 * the scenes. */
HADA_API hada_status hada_register_write(const hada_register_report *report, const hada_dataset *data,
                                         const char *folder, const hada_register_task *task, int *rows, int *cols,
                                         hada_error *err);

/* From now on the data set and its parts give out registered scenes; nothing is written. Nobody else uses them
 * meanwhile. Pairs that they have kept in memory are dropped, so that it is done once, before a fit. Its pairs are
 * files (HADA_ERROR_UNSUPPORTED otherwise: hada_register_apply() registers images). *rows and *cols (may be NULL): the
 * size of the scenes. */
HADA_API hada_status hada_register_place(const hada_register_report *report, hada_dataset *data,
                                         const hada_register_task *task, int *rows, int *cols, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
