/* What `train` prints and puts into the document. */
#ifndef HADA_CLI_TRAIN_TELL_H
#define HADA_CLI_TRAIN_TELL_H

#include "cli.h"

#include <hadalens/task_train.h>

typedef struct hada_cli_train_listener {
    hada_cli *cli;
    const hada_cli_contexts *devices;
    int headed; /* the table's head is printed */
} hada_cli_train_listener;

/* As hada_train_task asks for it; `user` is a listener. */
void hada_cli_train_tell(void *user, const hada_train_state *state);

#endif
