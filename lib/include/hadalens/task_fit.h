/* Hadalens: learning a camera as the command 'fit' does, from a data set, from saved sums, or from its point spread
 * functions: the same steps, the same choices, the same bits.
 *
 * Over hadalens/fit.h this adds what has to be decided: which pairs are scored, whether filters are judged in the
 * window (several looks at every pair) or refinement, which does without them, is so much better that this is left out.
 *
 * Among ranks (task->fit->communicator, hadalens/communicator.h) each rank calls with the same data set and task and
 * gets the same model; the first one writes save_sums.
 *
 * Threads: a run uses the calling thread; several may run at once on contexts of their own. */
#ifndef HADALENS_TASK_FIT_H
#define HADALENS_TASK_FIT_H

#include <hadalens/dataset.h>
#include <hadalens/fit.h>
#include <hadalens/model.h>
#include <hadalens/monitor.h>
#include <hadalens/survey.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hada_fit_task {
    size_t size; /* sizeof(hada_fit_task) */

    /* How to fit; NULL: hada_fit_options_init(). An open scene_response is that of the first file of `merge`; without
     * one, what the pairs say (hadalens/survey.h); linear where fit->leave_one_out is 0. Depths, distances, channels
     * and the frame's size are the data set's, and so is the window unless window_rows x window_cols is set: then it is
     * cut from scenes that are as large as the frame. `boundary` here is not looked at, but the one below. */
    const hada_fit_options *fit;
    int boundary; /* a hada_boundary; 0 (default): circular where camera.json says so, that of merged sums, else found
                     from the pairs (hada_fit_find_boundary()) */
    int half;     /* 1: the model's filters in half precision */
    const char *const *merge; /* files of sums to add, from the same camera and depths */
    int merge_count;
    const char *save_sums; /* a file for the sums over all pairs; NULL: none */
    const hada_monitor *monitor;
    hada_exposure exposure; /* HADA_EXPOSURE_AUTO (default): found, with the response of the scenes; not looked for
                               where fit->leave_one_out is 0 */
    int resume;          /* 1: goes on after an interruption, with save_sums: pairs that it holds, or what each rank had
                            saved on the way beside it (save_sums.RANK-of-RANKS), are not added again; the bits are
                            those of a run without interruption. Files that are not there are no error */
    double save_seconds; /* between saves on the way, at least; 60 by default */
    int all_pairs;       /* 0 (default): pairs that contradict the others of their depth (a frame that is cut off, or of
                            another scene) are left out, with a note to the monitor. They are looked for in depths with 4 to
                            32 pairs, unless fit->leave_one_out is 0. Scenes that were cut off at white are filled in from
                            their frames. 1: all pairs are taken, as they are */
} hada_fit_task;
HADA_INIT(hada_fit_task, HADA_STRUCT_FIT_TASK)

/* What the choices were made from. Owned by the caller: hada_fit_report_destroy(). */
typedef struct hada_fit_report {
    const hada_fit_scores *scores;        /* what was compared */
    const int64_t *pairs;                 /* in the sums of each depth, those of merged files counted */
    const hada_survey *survey;            /* what the pairs said before the fit; NULL: they were not asked */
    const unsigned char *const *left_out; /* left_out[depth][pair] of the data set: 1 where it was left out, since it
                                             spoilt what the others of its depth say; NULL: none was */
} hada_fit_report;
HADA_API void hada_fit_report_destroy(hada_fit_report **report);

/* Learns a camera from all pairs of a data set; `data` NULL: from the sums of task->merge alone, where nothing can be
 * left out. `task` may be NULL with `data`. *report may be left out (NULL). */
HADA_API hada_status hada_fit_run(hada_model **out, hada_fit_report **report, hada_context *context,
                                  const hada_dataset *data, const hada_fit_task *task, hada_error *err);

typedef struct hada_psf_task {
    size_t size;                 /* sizeof(hada_psf_task) */
    const hada_psf_options *psf; /* how to make the model; NULL: hada_psf_options_init() */
    const double *distances_mm;  /* of the depths, near to far; NULL: what names, files or a list beside them say, else,
                                    of one depth, not known (0) */
    int distances;
    int colour;              /* 1: a grey PSF serves red, green and blue alike */
    int half;                /* 1: the model's filters in half precision */
    double frame_encoding;   /* how the values of the pages stand for light (hadalens/response.h), which is made linear;
                                HADA_AUTO (default): as their files say (JPEG: sRGB), linear where they say nothing */
    const char *const *more; /* further files, as if they were in one folder */
    int more_count;
    const char *frame; /* a frame of the camera: psf->frame_rows and frame_cols, colour or grey, mosaic; NULL: none */
    /* Depths that were not measured, by the law of magnification: the distance between mask and sensor, and those at
     * which the point spread functions were taken (NULL: what names, files or a list beside them say); distances_mm are
     * those of the model then. 0 and psf_distances_mm given: the mask's is found from two or more of them. */
    double mask_distance_mm;
    const double *psf_distances_mm;
    int psf_distances;
    const hada_monitor *monitor;  /* is told what was done to them, and what is wrong with them */
    const hada_image *flat_frame; /* an evenly lit sensor, its dark level taken off, of the camera's frames' size, with
                                     their channels or one for all: pages of that size are divided by it, and the model
                                     keeps it for frames. NULL (default): none */
    int every;    /* of one file's pages each so many-th is taken, from the first on; distances are those of all; 1 by
                     default */
    int recentre; /* 1: what the law of magnification does not explain of the way that four or more depths wander is
                     taken off, for the bead or the stage drifts; 0 (default): they are kept as they are, and the
                     monitor is told how far they wander */
    const hada_image *dark_frame; /* of the camera's frames, which the model keeps; NULL (default): none */
} hada_psf_task;
HADA_INIT(hada_psf_task, HADA_STRUCT_PSF_TASK)

/* A model from point spread functions. `path` is a file with a page per depth, near to far, or a folder with folders
 * z<distance>mm, of which each holds captures of one depth (pages and files are averaged), or with files; so are `more`
 * files. Files are one for each depth where there are as many distances (distances.txt in a folder or, of one file, its
 * name with .txt, names z<distance>mm..., options), and of the same depth, averaged, otherwise. `task` may be NULL. */
HADA_API hada_status hada_psf_run(hada_model **out, hada_context *context, const char *path, const hada_psf_task *task,
                                  hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
