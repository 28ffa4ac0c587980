#include "reconstruct.h"

#include <string.h>
#include <unistd.h>

typedef struct listener {
    hada_cli *cli;
    long frames, failed, passed_over;
    double began; /* when the first frame was begun; 0: none was */
} listener;

int hada_cli_check_watch(hada_cli *cli, const hada_cli_watch_settings *set, int files, const char *output,
                         int needs_all)
{
    if (!set->watch && (set->stream || set->idle > 0.0))
        return hada_cli_usage(cli, "--%s goes with --watch", set->stream ? "stream" : "idle");
    if (!set->watch)
        return HADA_EXIT_OK;
    if (files)
        return hada_cli_usage(cli, "--watch waits for frames; leave the files out, or --watch");
    if (needs_all)
        return hada_cli_usage(cli,
                              "--bracket, --resume and --strict need all files beforehand; leave them or --watch out");
    if (!output && !set->stream)
        return hada_cli_usage(cli, "say where the results shall go, with -o FOLDER, --stream mjpeg, or both");
    if (set->stream && cli->common->json)
        return hada_cli_usage(cli, "--stream and --json would both write to standard output; leave one out");
    if (set->stream && isatty(STDOUT_FILENO))
        return hada_cli_usage(cli, "--stream writes pictures to standard output; send it to a program that shows them, "
                                   "such as '| ffplay -f mjpeg -'");
    if (!strcmp(set->watch, "-") && isatty(STDIN_FILENO))
        return hada_cli_usage(cli, "--watch - takes frames from a pipe, such as 'rpicam-raw -t 0 -o - | hadalens ...'");
    return HADA_EXIT_OK;
}

/* With a stream standard output belongs to it. */
static void tell(void *user, const hada_live_state *state)
{
    listener *own = user;
    hada_error error = state->error ? *state->error : (hada_error){0};
    own->frames = state->frames;
    own->passed_over = state->passed_over;
    if (own->began <= 0.0)
        own->began = hada_cli_seconds() - state->seconds;
    if (state->event == HADA_LIVE_FAILED) {
        own->failed++;
        hada_cli_translate(error.message);
        hada_cli_warn(own->cli, "%s: %s", state->name, error.message);
    } else {
        hada_cli_detail(own->cli, "%s: %.2f s, %ld passed over", state->name, state->seconds, state->passed_over);
    }
}

static void sum_up(const listener *own, int streams)
{
    const double seconds = own->frames ? hada_cli_seconds() - own->began : 0.0;
    char text[160];
    snprintf(text, sizeof text, "%ld frame%s in %.1f s (%.3g a second), %ld passed over, %ld failed", own->frames,
             own->frames == 1 ? "" : "s", seconds, seconds > 0.0 ? (double)own->frames / seconds : 0.0,
             own->passed_over, own->failed);
    if (streams)
        hada_cli_detail(own->cli, "%s", text);
    else
        hada_cli_say(own->cli, "%s", text);
    json_object_update_new(own->cli->document, json_pack("{s:I, s:I, s:I, s:f}", "frames", (json_int_t)own->frames,
                                                         "failed", (json_int_t)own->failed, "passed_over",
                                                         (json_int_t)own->passed_over, "seconds", seconds));
}

int hada_cli_watch(hada_cli *cli, const hada_cli_watch_settings *set, hada_plan *plan, const hada_model *model,
                   const hada_files_task *files)
{
    hada_error err = {0};
    listener own = {.cli = cli};
    hada_live_task task;
    hada_live_task_init(&task);
    task.folder = strcmp(set->watch, "-") ? set->watch : NULL;
    task.input = task.folder ? -1 : STDIN_FILENO;
    task.files = files->output ? files : NULL;
    task.stream = (hada_live_stream)set->stream;
    task.output = set->stream ? STDOUT_FILENO : -1;
    task.frame_encoding = files->frame_encoding;
    task.idle_seconds = set->idle;
    task.tell = tell;
    task.user = &own;
    task.monitor = &cli->monitor;
    const hada_status status = hada_reconstruct_live(plan, model, &task, &err);
    if (status && hada_cli_interrupted())
        return HADA_EXIT_INTERRUPTED;
    if (status)
        return hada_cli_fail(cli, &err);
    sum_up(&own, set->stream);
    return hada_cli_interrupted() ? HADA_EXIT_INTERRUPTED : own.failed ? HADA_EXIT_SOME : HADA_EXIT_OK;
}
