/* The files that belong to one input of a reconstruction. Internal. */
#ifndef HADA_TASKS_FRAME_OUTPUTS_H
#define HADA_TASKS_FRAME_OUTPUTS_H

#include <hadalens/task_reconstruct.h>
#include <hadalens/tiff.h>

/* Files of an input: those of hada_output, and the confidence of surfaces. */
enum { HADA_OUTPUT_CONFIDENCE = HADA_OUTPUTS, HADA_OUTPUT_FILES = HADA_OUTPUTS + 1 };

typedef struct hada_outputs {
    char *path[HADA_OUTPUT_FILES];               /* the preview's is NULL where none is wanted */
    hada_tiff_writer *writer[HADA_OUTPUT_FILES]; /* NULL: the preview's, and that of confidence where the first frame is
                                                    no surface */
    hada_image unknown;                          /* confidence of frames that are none */
    char *title;
    int frames, bits;
    double white;
    double encoding;       /* of the files; 0: a gamma that is no response */
    int convert;           /* 1: results are light, and get it on their way */
    double scene_response; /* the model's */
    int has_confidence;    /* 1: the file of confidence is written */
    int written;           /* frames so far */
    int finished;
} hada_outputs;

/* For an input of `frames` frames, with results called NAME_...; gamma: the exponent that the plan applied. */
hada_status hada_outputs_begin(hada_outputs *out, const hada_files_task *task, const char *name,
                               const hada_model_info *model, double gamma, int frames, hada_error *err);
/* Adds a frame; the first one is shown in the preview. */
hada_status hada_outputs_add(hada_outputs *out, const hada_pixels *raw, const hada_result *result, hada_error *err);
/* Whether an input's results are there, all of them: the stack gets its name last. */
int hada_outputs_are_there(const hada_files_task *task, const char *name);
/* Gives the files their names: all of them, or none. */
hada_status hada_outputs_finish(hada_outputs *out, hada_error *err);
/* Removes what was written when it was not finished; frees. */
void hada_outputs_end(hada_outputs *out);

#endif
