/* What `reconstruct` prints and puts into the document. */
#ifndef HADA_CLI_RECONSTRUCT_TELL_H
#define HADA_CLI_RECONSTRUCT_TELL_H

#include "cli.h"

#include <hadalens/task_reconstruct.h>

typedef struct hada_cli_files_listener {
    hada_cli *cli;
    json_t *entry, *frames; /* of the file at hand; owned by the document */
    double before;          /* when the file before was done */
    int failed, code;       /* files, and the exit code for them */
    int strange;            /* frames that the camera does not belong to, of those that were compared */
} hada_cli_files_listener;

/* As hada_files_task asks for it; `user` is a listener. */
void hada_cli_files_tell(void *user, const hada_files_state *state);

#endif
