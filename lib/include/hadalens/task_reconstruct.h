/* Hadalens: reconstructing files as the command 'reconstruct' does: frames of many files through a plan, read ahead
 * while others are computed, and their results in a folder.
 *
 * For each NAME.tif: NAME_stack.tif (a refocused image per depth, near to far, as ImageJ hyperstack with the
 * distances), NAME_aif.tif (everything in focus), NAME_depth.tif (distances in millimetres, NaN where nothing is in
 * focus) and NAME_preview.png (where the build draws pictures); where the first frame is a surface also
 * NAME_confidence.tif (float32, 0 to 1, NaN for frames that are none); where emitters are asked for NAME_emitters.csv,
 * and of a sequence NAME_tracks.csv.
 * A file of several frames is a sequence: its results have as many, the preview shows the first, and memory does not
 * grow with them. The files of an input appear under their names when all are whole; what is not finished is removed.
 *
 * Threads: a run uses the calling thread and those of the plan. */
#ifndef HADALENS_TASK_RECONSTRUCT_H
#define HADALENS_TASK_RECONSTRUCT_H

#include <hadalens/communicator.h>
#include <hadalens/emitters.h>
#include <hadalens/match.h>
#include <hadalens/monitor.h>
#include <hadalens/reconstruct.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Which frames are compared with the camera turned and magnified (hadalens/match.h). Where another way is better, or
 * the camera explains nothing, the monitor gets a note. */
typedef enum hada_files_match {
    HADA_FILES_MATCH_NONE = 0,
    HADA_FILES_MATCH_FIRST = 1, /* the first one, where planes are refined */
    HADA_FILES_MATCH_EACH = 2   /* the first one of each file */
} hada_files_match;

/* What is written for an input. */
typedef enum hada_output {
    HADA_OUTPUT_STACK = 0,
    HADA_OUTPUT_ALL_IN_FOCUS = 1,
    HADA_OUTPUT_DISTANCE_MAP = 2,
    HADA_OUTPUT_PREVIEW = 3,
    HADA_OUTPUTS = 4
} hada_output;

typedef struct hada_files_state hada_files_state;

/* The files of stack, all-in-focus image, distance map and confidence. */
typedef enum hada_files_format {
    HADA_FILES_TIFF = 0, /* NAME_stack.tif..., with metadata */
    HADA_FILES_NUMPY = 1 /* NAME_stack.npy (frames, depths, rows, cols, channels), the others (frames, rows, cols,
                            channels): always five and four dimensions, with nothing beside the values */
} hada_files_format;

typedef struct hada_files_task {
    size_t size;        /* sizeof(hada_files_task) */
    const char *output; /* the folder, made where it is missing; needed */
    int preview;        /* 1 (default): previews are drawn, where the build draws any */
    int bits;           /* per value of stack and all-in-focus image: 32 (default, float), 16 or 8 */
    double white;       /* value that becomes full scale in 8 and 16 bits; 1 by default */

    /* Called with what there is to tell; NULL: nobody asks. */
    void (*tell)(void *user, const hada_files_state *state);
    void *user;
    const hada_monitor *monitor;
    double encoding; /* how the values of stack and all-in-focus image stand for light (hadalens/response.h), which
                        their metadata state: HADA_AUTO (default) as the scenes that the model was learned from did
                        (scene_response), so that results compare with them. Results that are told are linear light. Of
                        a plan with a gamma G the values are light^G, and nothing else can be asked for */
    int resume;      /* 1: files whose results stand in the folder are passed over (HADA_FILES_THERE), to go on after an
                        interruption: whole ones of the plan's depths and size, not older than the file and the model
                        and, where they say it, made from these by their hashes;
                        with which other options they were made is not known. 0 (default): they are made anew */
    const hada_communicator *communicator; /* ranks that share the files: dealt to them in order, each writing its own;
                                              copied; NULL (default): none do. All ranks name the same files */
    double frame_encoding;  /* how the values of the frames stand for light (hadalens/response.h), which is made linear;
                               HADA_AUTO (default): as their files say (JPEG: sRGB), and where they say nothing as the
                               model knows (hada_model_info.frame_encoding), else linear */
    hada_files_match match; /* HADA_FILES_MATCH_FIRST by default */
    const hada_image *frame; /* in place of what the only path's file holds: hada_exposures_load(); NULL (default) */
    int picture; /* 1: the first all-in-focus image is also written as NAME_aif.png, in sRGB and 8 bits, where the build
                    draws pictures; 0 (default) */
    int emitters; /* 1: the emitters of each frame, all of which must be volumes, are written to NAME_emitters.csv
                     (docs/reference/files.md#emitters); 0 (default) */
    /* Emitters of a sequence are joined to tracks, in NAME_tracks.csv: hada_tracker_create() */
    double track_pixels, track_depths; /* 2 and 2.5 by default */
    int track_gap;                     /* 2 by default */
    double pixel_um; /* size of a pixel in the scene, at all depths, in micrometres: stated in the TIFF files; 0
                        (default): not known */
    hada_files_format format; /* HADA_FILES_TIFF by default. `resume` needs what TIFF files say */
} hada_files_task;
HADA_INIT(hada_files_task, HADA_STRUCT_FILES_TASK)

typedef enum hada_files_event {
    HADA_FILES_BEGINS = 1, /* a file's turn */
    HADA_FILES_FRAME = 2,  /* a frame is done and written */
    HADA_FILES_DONE = 3,   /* with its last frame: the file's results have their names */
    HADA_FILES_FAILED = 4, /* nothing of the file was left; the others go on, but for HADA_ERROR_CANCELLED */
    HADA_FILES_THERE = 5   /* its results are there already, and stay as they are */
} hada_files_event;

/* The library's; valid during the call. */
struct hada_files_state {
    hada_files_event event;
    int file; /* index of the path */
    const char *path, *name;
    int frames, frame;                 /* of the file, 0 where it could not be opened; the one at hand, from 0 on */
    const hada_result *result;         /* FRAME, DONE: of that frame */
    const char *outputs[HADA_OUTPUTS]; /* paths; NULL: not written */
    const hada_error *error;           /* FAILED: why, the path in front */
    const char *confidence;            /* path of the confidence map; NULL: not written */
    const char *picture;               /* path of the all-in-focus image for a display; NULL: not written */
    const hada_match *match;           /* FRAME: whether the camera belongs to it; NULL: not compared */
    const hada_emitters *emitters;     /* FRAME, DONE: of that frame; NULL: not asked for */
    const char *emitters_table;        /* path of their table; NULL: not written */
    const char *tracks_table;          /* DONE: path of that of tracks; NULL: not written */
    int tracks;                        /* DONE: how many there are */
};

/* Frames that hada_reconstruct_files() holds at a time: one for each queue, one that is read, one that is written. */
HADA_API int hada_files_ahead(const hada_plan *plan);

/* Reconstructs all frames of some files with a plan that was made from `model`. *failed (may be NULL): files of this
 * rank that could not be done; they do not stop the others and are no failure of the call. HADA_ERROR_ARGUMENT where
 * two paths would write the same files; HADA_ERROR_CANCELLED where the monitor wanted to stop. */
HADA_API hada_status hada_reconstruct_files(hada_plan *plan, const hada_model *model, const char *const *paths,
                                            int count, const hada_files_task *task, int *failed, hada_error *err);

/* Steps of refinement that keep up with a camera. */
typedef struct hada_pace {
    size_t size;          /* sizeof(hada_pace), set by the caller */
    int steps;            /* for hada_plan_options.refine: the most that keep up, or 1; as given where all steps do, or
                             nothing is refined */
    double seconds;       /* a frame takes with them, with reading; more than 1 / fps: they do not keep up */
    double seconds_whole; /* with all steps */
    double change;        /* of the planes, to all steps: root of the sum of squares, as a part of them; 0: none */
} hada_pace;

/* Finds them: plans with these options but for `refine` take the first five frames of the files (two at least), of
 * which the first one is not timed. Of the task, frame_encoding and monitor count. What is found depends on how fast
 * the machine is then; results with these steps depend on their number alone. */
HADA_API hada_status hada_files_pace(hada_pace *pace, hada_context *const *contexts, int context_count,
                                     const hada_model *model, const hada_plan_options *options,
                                     const char *const *paths, int count, const hada_files_task *task, double fps,
                                     hada_error *err);

/* Merges all pages of some files, exposures of one scene (hada_image_merge_exposures()): a frame for
 * hada_files_task.frame, and weights for hada_plan_options.pixel_weights. Both images are created by the call.
 * encoding: as hada_files_task.frame_encoding; mosaic: of pages of one channel. The monitor (may be NULL) gets a
 * message with the length of each exposure. */
HADA_API hada_status hada_exposures_load(hada_image *frame, hada_image *weights, const char *const *paths, int count,
                                         double encoding, hada_mosaic mosaic, const hada_monitor *monitor,
                                         hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
