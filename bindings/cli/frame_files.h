/* The inputs of a reconstruction, one after the other: their results written, reported, and failures told. */
#ifndef HADA_CLI_FRAME_FILES_H
#define HADA_CLI_FRAME_FILES_H

#include "cli.h"

#include <hadalens/reconstruct.h>

/* Where results go, and how. */
typedef struct hada_cli_frame_settings {
    const char *folder, *model;
    int preview, bits;
    double white;
} hada_cli_frame_settings;

/* Reconstructs all frames of all files, up to `ahead` at a time; a bad file does not stop the others. Returns the exit
 * code; the document's "files" tell the rest. */
int hada_cli_frame_files(hada_cli *cli, hada_plan *plan, const hada_model *model,
                         const hada_cli_frame_settings *settings, int count, const char **paths, char **names,
                         int ahead);

#endif
