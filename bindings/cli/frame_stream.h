/* Frames of many files on their way through a plan: read ahead while others are computed, and handed out in order.
 * Memory holds only so many frames at a time, however long the sequences are. */
#ifndef HADA_CLI_FRAME_STREAM_H
#define HADA_CLI_FRAME_STREAM_H

#include "cli.h"

#include <hadalens/job.h>
#include <hadalens/tiff.h>

/* A frame, or a file that could not be opened. */
typedef struct hada_cli_frame {
    int file;   /* index of the path */
    int frames; /* that the file holds; 0: it could not be opened */
    int frame;  /* of the file, from 0 on */
    hada_image raw;
    hada_result result;
    hada_job *job;
    hada_status status; /* of reading and of computing */
    hada_error error;
} hada_cli_frame;

/* Whether a file's frames can be computed at all. */
typedef hada_status (*hada_cli_frame_check)(void *user, const hada_tiff_info *info, hada_error *err);

typedef struct hada_cli_stream {
    hada_plan *plan;
    const char **paths;
    int count;
    hada_cli_frame_check check;
    void *user;

    hada_tiff_reader *reader; /* of the file that is being read */
    int file, frame;          /* to be read next */
    int skipped;              /* of files before this one nothing more is read */
    hada_cli_frame *ring;     /* frames in flight: `used` of them from `first` on */
    int ahead, first, used, handed_out;
} hada_cli_stream;

/* `ahead`: frames in memory at a time. The plan, the paths and `user` must stay. */
hada_status hada_cli_stream_begin(hada_cli_stream *stream, hada_plan *plan, const char **paths, int count, int ahead,
                                  hada_cli_frame_check check, void *user, hada_error *err);

/* The next frame in order, when it is done or has failed; it stays until the next call. NULL: there are no more, or a
 * signal came (hada_cli_interrupted()). */
hada_cli_frame *hada_cli_stream_next(hada_cli_stream *stream);

/* The other frames of a file are not wanted. Those in flight may still be handed out. */
void hada_cli_stream_skip(hada_cli_stream *stream, int file);

/* Cancels what is in flight and frees; an empty stream is fine. */
void hada_cli_stream_end(hada_cli_stream *stream);

#endif
