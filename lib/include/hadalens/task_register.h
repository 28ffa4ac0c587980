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
    size_t size;                         /* sizeof(hada_register_task) */
    const hada_register_options *search; /* NULL: hada_register_options_init() */
    int keep_offsets;                    /* 1: shifts between the depths are left as they are; 0 (default): found */
    int window_rows, window_cols;        /* of the registered scenes; 0 (default): what they fill, within the frame */
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

typedef struct hada_register_report hada_register_report;

/* Finds the transforms of all depths. The report is the caller's: hada_register_report_destroy(). */
HADA_API hada_status hada_register_run(hada_register_report **out, const hada_dataset *data,
                                       const hada_register_task *task, hada_error *err);
HADA_API const hada_registered_depth *hada_register_report_depth(const hada_register_report *report, int depth);
HADA_API void hada_register_report_destroy(hada_register_report **report);

/* Writes a data set with registered scenes into a folder that is not there yet, or empty; it appears whole or not at
 * all. Raw frames are taken over as they are, as hard links where that goes. *rows and *cols (may be NULL): the size of
 * the scenes. */
HADA_API hada_status hada_register_write(const hada_register_report *report, const hada_dataset *data,
                                         const char *folder, const hada_register_task *task, int *rows, int *cols,
                                         hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
