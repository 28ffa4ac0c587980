/* What the files of `reconstruct` share. */
#ifndef HADA_CLI_RECONSTRUCT_H
#define HADA_CLI_RECONSTRUCT_H

#include <hadalens/reconstruct.h>
#include <hadalens/task_live.h>
#include <hadalens/task_reconstruct.h>

#include "cli.h"
#include "option.h"

/* What is printed and put into the document. */

typedef struct hada_cli_files_listener {
    hada_cli *cli;
    json_t *entry, *frames; /* of the file at hand; owned by the document */
    double before;          /* when the file before was done */
    int failed, code;       /* files, and the exit code for them */
    int strange;            /* frames that the camera does not belong to, of those that were compared */
} hada_cli_files_listener;

/* As hada_files_task asks for it; `user` is a listener. */
void hada_cli_files_tell(void *user, const hada_files_state *state);

/* The options that choose and steer a classic method. */

/* Beside hada_method: the model's optics, transposed, in place of its filters. */
enum { HADA_CLI_MATCHED = -1 };

typedef struct hada_cli_method_settings {
    int method, prior, iterations, inner, levels, plain;
    double stop, seconds, weight, tv, step, lambda;
    const char *mu;
} hada_cli_method_settings;

/* What the members hold when no option is given. */
void hada_cli_method_defaults(hada_cli_method_settings *set);

/* Into the options of a plan; HADA_ERROR_ARGUMENT where options do not go together. */
hada_status hada_cli_read_method(const hada_cli_method_settings *set, hada_classic_options *out, hada_error *err);

/* "all", "none" or a list such as "prune,channels" to HADA_SKIP_... */
hada_status hada_cli_read_skip(const char *text, unsigned *skip, hada_error *err);

/* reconstruct --watch: frames as they come. */

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
