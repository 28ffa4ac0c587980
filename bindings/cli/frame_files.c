#include "frame_files.h"
#include "frame_outputs.h"
#include "frame_report.h"
#include "frame_stream.h"

#include <stdio.h>

/* A run over all files, and the file whose results are being written. */
typedef struct work {
    hada_cli *cli;
    const hada_model *model;
    const hada_cli_frame_settings *settings;
    const char **paths;
    char **names;
    hada_cli_stream stream;

    hada_cli_outputs out;
    json_t *entry, *frames, *outputs; /* NULL between files */
    double before;                    /* when the file before was done */
    int failed, code;
} work;

static hada_status check_size(void *user, const hada_tiff_info *file, hada_error *err)
{
    const work *w = user;
    const hada_model_info *info = hada_model_get_info(w->model);
    if (file->rows == info->raw_rows && file->cols == info->raw_cols && file->channels == info->channels)
        return HADA_OK;
    return hada_cli_error(err, HADA_ERROR_MODEL,
                          "this frame has %dx%d pixels of %d %s, but the model %s is of a camera with %dx%d pixels of "
                          "%d; take the model that was fitted to this camera",
                          file->rows, file->cols, file->channels, file->channels == 1 ? "channel" : "channels",
                          w->settings->model, info->raw_rows, info->raw_cols, info->channels);
}

static hada_status begin_file(work *w, const hada_cli_frame *frame, hada_error *err)
{
    static const char *const keys[] = {"stack", "all_in_focus", "distance_map", "preview"};
    const hada_cli_frame_settings *set = w->settings;
    w->entry = json_object();
    w->frames = json_array();
    w->outputs = json_object();
    json_object_set_new(w->entry, "input", json_string(w->paths[frame->file]));
    json_array_append(json_object_get(w->cli->document, "files"), w->entry);
    if (!frame->frames)
        return HADA_OK; /* could not be opened */
    w->cli->progress->total += frame->frames - 1;
    hada_status status = hada_cli_outputs_begin(&w->out, set->folder, w->names[frame->file], set->model, set->preview,
                                                frame->frames, set->bits, set->white, err);
    for (int k = 0; !status && k < HADA_CLI_OUTPUTS; k++)
        if (w->out.path[k])
            json_object_set_new(w->outputs, keys[k], json_string(w->out.path[k]));
    return status;
}

static void leave_file(work *w)
{
    hada_cli_outputs_end(&w->out);
    json_decref(w->entry);
    json_decref(w->frames);
    json_decref(w->outputs);
    w->entry = w->frames = w->outputs = NULL;
}

static void report_file(work *w, const hada_cli_frame *frame)
{
    char words[400];
    const double now = hada_cli_seconds(), seconds = now - w->before;
    const char *name = w->names[frame->file];
    hada_cli_frame_words(&frame->result, words, sizeof words);
    if (frame->frames > 1)
        hada_cli_say(w->cli, "%s: %d frames, %.2f s each; the last: %s", name, frame->frames, seconds / frame->frames,
                     words);
    else
        hada_cli_say(w->cli, "%s: %s; %.2f s", name, words, seconds);
    json_object_set(w->entry, "outputs", w->outputs);
    json_object_set(w->entry, "frames", w->frames);
    json_object_set_new(w->entry, "seconds", json_real(seconds));
    json_object_set_new(w->entry, "ok", json_true());
    w->before = now;
}

static void fail_file(work *w, const hada_cli_frame *frame, hada_error *err)
{
    const int code = hada_cli_exit_code(err->status);
    if (frame->frames > 1)
        hada_cli_prefix(err, "frame %d of %d: ", frame->frame + 1, frame->frames);
    hada_cli_prefix(err, "%s: ", w->paths[frame->file]);
    hada_cli_print_error(w->cli, err);
    json_object_set_new(w->entry, "ok", json_false());
    json_object_set_new(w->entry, "error", hada_cli_error_json(err));
    w->code = !w->failed || w->code == code ? code : HADA_EXIT_SOME;
    w->failed++;
    w->before = hada_cli_seconds();
    hada_cli_stream_skip(&w->stream, frame->file);
    leave_file(w);
}

/* Writes a frame, the file's last one with all that ends a file. */
static void take_frame(work *w, hada_cli_frame *frame)
{
    hada_error err = frame->error;
    hada_status status = HADA_OK;
    if (!w->entry)
        status = begin_file(w, frame, &err);
    if (!status && frame->status) {
        err = frame->error;
        status = frame->status;
    }
    if (!status)
        status = hada_cli_outputs_add(&w->out, &frame->raw, &frame->result, &err);
    if (!status) {
        json_array_append_new(w->frames, hada_cli_frame_json(&frame->result));
        if (frame->frame == frame->frames - 1) {
            status = hada_cli_outputs_finish(&w->out, &err);
            if (!status)
                report_file(w, frame);
            if (!status)
                leave_file(w);
        }
    }
    hada_cli_progress_step(w->cli, NULL);
    if (status)
        fail_file(w, frame, &err);
}

int hada_cli_frame_files(hada_cli *cli, hada_plan *plan, const hada_model *model,
                         const hada_cli_frame_settings *settings, int count, const char **paths, char **names,
                         int ahead)
{
    hada_error err = {0};
    hada_cli_progress progress;
    work w = {.cli = cli, .model = model, .settings = settings, .paths = paths, .names = names};
    int bad = -1; /* the file that failed last: its other frames in flight are passed over */
    json_object_set_new(cli->document, "files", json_array());
    if (hada_cli_stream_begin(&w.stream, plan, paths, count, ahead, check_size, &w, &err))
        return hada_cli_fail(cli, &err);
    hada_cli_progress_begin(cli, &progress, "frames", count);
    w.before = hada_cli_seconds();
    for (hada_cli_frame *frame; (frame = hada_cli_stream_next(&w.stream));) {
        if (frame->file == bad)
            continue;
        const int failed = w.failed;
        take_frame(&w, frame);
        if (w.failed > failed)
            bad = frame->file;
    }
    if (w.entry) { /* a signal came in the midst of a sequence */
        hada_cli_check_signals(&err);
        json_object_set_new(w.entry, "ok", json_false());
        json_object_set_new(w.entry, "error", hada_cli_error_json(&err));
        leave_file(&w);
    }
    hada_cli_stream_end(&w.stream);
    hada_cli_progress_end(cli);
    if (hada_cli_interrupted()) {
        hada_cli_check_signals(&err);
        hada_cli_print_error(cli, &err);
        return HADA_EXIT_INTERRUPTED;
    }
    if (w.failed && count > 1)
        fprintf(stderr, "hadalens %s: %d of %d files failed\n", cli->command, w.failed, count);
    return w.code;
}
