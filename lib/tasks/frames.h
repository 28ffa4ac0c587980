/* Frames of many files on their way through a plan: read ahead while others are computed, and handed out in order.
 * Memory holds only so many frames at a time, however long the sequences are. Internal. */
#ifndef HADA_TASKS_FRAMES_H
#define HADA_TASKS_FRAMES_H

#include <hadalens/job.h>
#include <hadalens/monitor.h>
#include <hadalens/response.h>
#include <hadalens/task_reconstruct.h>
#include <hadalens/tiff.h>

#include "core/outfile.h"
#include "io/encode.h"
#include "io/text.h"

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
    double encoding; /* of the frames: hada_tiff_read_light() */
    const hada_monitor *monitor;
    const hada_image *given; /* in place of the only file's; may be set after hada_stream_begin(). NULL: none */

    hada_tiff_reader *reader; /* of the file that is being read */
    int file, frame;          /* to be read next */
    int skipped;              /* of files before this one nothing more is read */
    hada_streamed *ring;      /* frames in flight: `used` of them from `first` on */
    int ahead, first, used, handed_out;
} hada_stream;

/* Whether frames as a file holds them are such as the plan takes: size, channels, mosaic. */
hada_status hada_frames_check(const hada_plan *plan, const hada_model *model, const hada_tiff_info *info,
                              hada_error *err);

/* Opens a file of such frames. Where it does not state their encoding, it is the model's. */
hada_status hada_frames_open(hada_tiff_reader **reader, const char *path, const hada_plan *plan,
                             const hada_model *model, hada_error *err);

/* Says that values are encoded for displays, or that their steps are coarser than the noise. */
void hada_tell_values(const hada_monitor *monitor, const char *path, const hada_tiff_reader *reader, double encoding,
                      const hada_pixels *frame);

/* `ahead`: frames in memory at a time. All that is handed in must stay. */
hada_status hada_stream_begin(hada_stream *stream, hada_plan *plan, const hada_model *model, const char *const *paths,
                              int count, double encoding, int ahead, const hada_monitor *monitor, hada_error *err);

/* The next frame in order, when it is done or has failed; it stays until the next call. NULL: there are no more, or the
 * caller wants to stop. */
hada_streamed *hada_stream_next(hada_stream *stream);

/* The other frames of a file are not wanted. Those in flight may still be handed out. */
void hada_stream_skip(hada_stream *stream, int file);

/* Cancels what is in flight and frees; an empty stream is fine. */
void hada_stream_end(hada_stream *stream);

/* The files that belong to one input of a reconstruction. Internal. */

/* Files of an input: those of hada_output, the confidence of surfaces, the all-in-focus image for a display, and the
 * tables of emitters and of tracks. */
enum {
    HADA_OUTPUT_CONFIDENCE = HADA_OUTPUTS,
    HADA_OUTPUT_PICTURE,
    HADA_OUTPUT_EMITTERS,
    HADA_OUTPUT_TRACKS,
    HADA_OUTPUT_FILES
};

/* An emitter of a sequence. */
typedef struct hada_tracked {
    int track, frame;
    hada_emitter emitter;
} hada_tracked;

/* Hashes of the files that results are made from, as results name them; "" where one of them is no file. */
enum { HADA_MADE_FROM = 34 };
hada_status hada_made_from(char text[HADA_MADE_FROM], const char *frame, uint64_t model, hada_error *err);

typedef struct hada_outputs {
    char *path[HADA_OUTPUT_FILES]; /* NULL: preview, picture and tables where none are wanted */
    hada_files_format format;
    hada_tiff_writer *writer[HADA_OUTPUT_FILES]; /* NULL: those of PNG files, and of confidence where the first frame is
                                                    no surface */
    hada_numpy_writer array[HADA_OUTPUT_FILES];  /* in their place */
    hada_outfile table;                          /* of emitters */
    int has_table;                               /* 1: it is open */
    hada_tracker *tracker;                       /* NULL: no tracks are wanted */
    hada_tracked *tracked;                       /* by frame */
    size_t tracked_count;
    int tracks;
    hada_image unknown; /* confidence of frames that are none */
    char *title;
    char made_from[HADA_MADE_FROM]; /* "": unknown */
    int frames, bits;
    double white, pixel_um;
    double encoding;       /* of the files; 0: a gamma that is no response */
    int convert;           /* 1: results are light, and get it on their way */
    double shown;          /* the exponent with which pictures show results: HADA_AUTO where these are light */
    double scene_response; /* the model's */
    int has_confidence;    /* 1: the file of confidence is written */
    int has_map;           /* 1: the distance map is */
    int written;           /* frames so far */
    int finished;
} hada_outputs;

/* Whether results can be written as the task asks. */
hada_status hada_outputs_check(const hada_files_task *task, hada_error *err);
/* For an input of `frames` frames through the plan, with results called NAME_...; the caller fills in made_from. */
hada_status hada_outputs_begin(hada_outputs *out, const hada_files_task *task, const hada_plan *plan, const char *name,
                               int frames, hada_error *err);
/* Adds a frame; the first one is shown in the preview. emitters: NULL where none are asked for. */
hada_status hada_outputs_add(hada_outputs *out, const hada_pixels *raw, const hada_result *result,
                             const hada_emitters *emitters, hada_error *err);
/* Whether an input's results are there: all of them, whole, of the plan's depths and size, and not older than the input
 * at `path` and the file of the model, and, where they say it, made from these. model: the hash of its file. */
int hada_outputs_are_there(const hada_files_task *task, const hada_plan *plan, const char *name, const char *path,
                           uint64_t model);
/* Gives the files their names: all of them, or none. */
hada_status hada_outputs_finish(hada_outputs *out, hada_error *err);
/* Removes what was written when it was not finished; frees. */
void hada_outputs_end(hada_outputs *out);

#endif
