/* reconstruct --watch: frames as they come. */
#ifndef HADA_CLI_WATCH_H
#define HADA_CLI_WATCH_H

#include "cli.h"

#include <hadalens/task_live.h>

typedef struct hada_cli_watch_settings {
    const char *watch; /* a folder, or "-"; NULL: not asked for */
    int stream;
    double idle;
} hada_cli_watch_settings;

/* Whether the settings can be followed; an exit code, 0 where they can. output: the folder for results, or NULL;
 * needs_all: 1: another option needs all files beforehand. */
int hada_cli_check_watch(hada_cli *cli, const hada_cli_watch_settings *set, int files, const char *output,
                         int needs_all);
/* The exit code. */
int hada_cli_watch(hada_cli *cli, const hada_cli_watch_settings *set, hada_plan *plan, const hada_model *model,
                   const hada_files_task *files);

#endif
