/* Hadalens: frames as they come, from a camera's pipe or a folder that it fills, the newest first; what comes of them
 * goes to files, or as a stream of pictures to a program that shows them.
 *
 * Threads: a run uses the calling thread, one that reads the pipe, and those of the plan. */
#ifndef HADALENS_TASK_LIVE_H
#define HADALENS_TASK_LIVE_H

#include <hadalens/task_reconstruct.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A stream of all-in-focus images for a display, in sRGB. White is what one pixel in a thousand exceeds, followed over
 * some frames so that pictures do not flicker. */
typedef enum hada_live_stream {
    HADA_LIVE_STREAM_NONE = 0,
    HADA_LIVE_STREAM_MJPEG = 1, /* JPEG pictures one after the other: ffplay -f mjpeg - */
    HADA_LIVE_STREAM_RGB24 = 2  /* red, green, blue of each pixel of the window, without headers */
} hada_live_stream;

typedef enum hada_live_event {
    HADA_LIVE_FRAME = 1, /* a frame is done */
    HADA_LIVE_FAILED = 2 /* it could not be done; the others go on, but for HADA_ERROR_CANCELLED */
} hada_live_event;

/* The library's; valid during the call. */
typedef struct hada_live_state {
    hada_live_event event;
    const char *name;          /* of the file without its ending, or frame000001 and so on */
    long frames, passed_over;  /* so far: done, and left out since newer ones had come */
    double seconds;            /* that this frame took, from its reading to its writing */
    const hada_result *result; /* FRAME */
    const hada_error *error;   /* FAILED */
} hada_live_state;

typedef struct hada_live_task {
    size_t size;        /* sizeof(hada_live_task) */
    const char *folder; /* frames are the files that appear here, or change; NULL (default): they come from `input`.
                           With `files` the newest file is done first and older ones when there is time; without, older
                           ones are left out. A file that was there before counts as well */
    int input; /* a file descriptor, which stays the caller's; frames lie as hada_headerless_set() says. Of a pipe the
                  newest frame is done and those before it are left out; of an ordinary file all are done. -1 (default)
                */
    const hada_files_task *files; /* results as hada_reconstruct_files() writes them; its members tell, user, monitor,
                                     resume, communicator, match and frame are not used. NULL (default): no files */
    hada_live_stream stream;      /* HADA_LIVE_STREAM_NONE by default */
    int output;                   /* the file descriptor that it goes to, which stays the caller's; -1 (default) */
    double frame_encoding;        /* as in hada_files_task */
    double idle_seconds;          /* ends when nothing has come for so long; 0 (default): waits for ever */
    void (*tell)(void *user, const hada_live_state *state); /* NULL (default): nobody asks */
    void *user;
    const hada_monitor *monitor;
} hada_live_task;
HADA_INIT(hada_live_task, HADA_STRUCT_LIVE_TASK)

/* Reconstructs frames with a plan that was made from `model`, until the pipe ends, nothing has come for idle_seconds,
 * or the monitor wants to stop, which is no error here. HADA_ERROR_FILE_WRITE where nobody reads the stream any more.
 */
HADA_API hada_status hada_reconstruct_live(hada_plan *plan, const hada_model *model, const hada_live_task *task,
                                           hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
