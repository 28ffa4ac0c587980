/* The files that belong to one input: NAME_stack.tif, NAME_aif.tif, NAME_depth.tif, NAME_preview.png. */
#ifndef HADA_CLI_FRAME_OUTPUTS_H
#define HADA_CLI_FRAME_OUTPUTS_H

#include "cli.h"

#include <hadalens/reconstruct.h>
#include <hadalens/tiff.h>

enum { HADA_CLI_STACK, HADA_CLI_AIF, HADA_CLI_DEPTH, HADA_CLI_PREVIEW, HADA_CLI_OUTPUTS };

typedef struct hada_cli_outputs {
    char *path[HADA_CLI_OUTPUTS]; /* the preview's is NULL when none is wanted */
    hada_tiff_writer *writer[HADA_CLI_PREVIEW];
    char *title;
    int frames, bits;
    double white; /* value that becomes full scale in 8 and 16 bits */
    int written;  /* frames so far */
} hada_cli_outputs;

hada_status hada_cli_outputs_begin(hada_cli_outputs *out, const char *folder, const char *name, const char *model,
                                   int preview, int frames, int bits, double white, hada_error *err);
/* Adds a frame; the first one is shown in the preview. */
hada_status hada_cli_outputs_add(hada_cli_outputs *out, const hada_image *raw, const hada_result *result,
                                 hada_error *err);
/* Gives the files their names: all of them, or none. */
hada_status hada_cli_outputs_finish(hada_cli_outputs *out, hada_error *err);
/* Removes what was written when it was not finished; frees. */
void hada_cli_outputs_end(hada_cli_outputs *out);

#endif
