/* Frames of many files on their way through a plan: read ahead while others are computed, and handed out in order.
 * Memory holds only so many frames at a time, however long the sequences are. Internal. */
#ifndef HADA_TASKS_FRAME_STREAM_H
#define HADA_TASKS_FRAME_STREAM_H

#include <hadalens/job.h>
#include <hadalens/monitor.h>
#include <hadalens/tiff.h>

/* A frame, or a file that could not be opened. */
typedef struct hada_streamed {
    int file;        /* index of the path */
    int frames;      /* that the file holds; 0: it could not be opened */
    int frame;       /* of the file, from 0 on */
    hada_pixels raw; /* in the form in which the file has it; owned */
    hada_result result;
    hada_job *job;
    hada_status status; /* of reading and of computing */
    hada_error error;
} hada_streamed;

typedef struct hada_stream {
    hada_plan *plan;
    const hada_model *model;
    const char *const *paths;
    int count;
    const hada_monitor *monitor;

    hada_tiff_reader *reader; /* of the file that is being read */
    int file, frame;          /* to be read next */
    int skipped;              /* of files before this one nothing more is read */
    hada_streamed *ring;      /* frames in flight: `used` of them from `first` on */
    int ahead, first, used, handed_out;
} hada_stream;

/* `ahead`: frames in memory at a time. All that is handed in must stay. */
hada_status hada_stream_begin(hada_stream *stream, hada_plan *plan, const hada_model *model, const char *const *paths,
                              int count, int ahead, const hada_monitor *monitor, hada_error *err);

/* The next frame in order, when it is done or has failed; it stays until the next call. NULL: there are no more, or the
 * caller wants to stop. */
hada_streamed *hada_stream_next(hada_stream *stream);

/* The other frames of a file are not wanted. Those in flight may still be handed out. */
void hada_stream_skip(hada_stream *stream, int file);

/* Cancels what is in flight and frees; an empty stream is fine. */
void hada_stream_end(hada_stream *stream);

#endif
