#include "command.h"

#include <hadalens/model.h>
#include <hadalens/tune.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST = HADA_CLI_TEXTS, HADA_TUNE_NAME = 32 };
#define LEAST_SECONDS 1e-6 /* for a convolution when the time is up: its first variant alone */

typedef struct settings {
    hada_cli_common common;
    const char *output;
    const char *model;
    hada_cli_texts sizes, nets;
    int rounds;
    double seconds;
} settings;

#define AT(member) HADA_CLI_AT(settings, member)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("Measurement"),
    {HADA_OPTION_TARGET, "output", 'o', "FILE", "the tuning file to write or to bring up to date (needed)",
     "Lines about other devices and shapes stay as they are.", AT(output)},
    {HADA_OPTION_TEXT, "model", 'm', "MODEL", "measure what this model needs: its transforms and the net in it", NULL,
     AT(model)},
    {HADA_OPTION_TEXTS, "size", 0, "HxW", "rows and columns of the transforms; may be given more than once",
     "Default, without --model and --net: 256x256, 512x512 and 1024x1024. Transforms have the size of a model's grid: "
     "the frame's with the "
     "boundary 'circular', a larger one with 'padded'. The JSON document of 'fit' tells it as grid.",
     AT(sizes)},
    {HADA_OPTION_TEXTS, "net", 0, "NAME:HxW", "measure the convolutions of a preset net; may be given more than once",
     "Default, without --model and --size: compact:512x512 and paper:256x256.", AT(nets)},
    {HADA_OPTION_COUNT, "rounds", 0, "N", "how often each transform is timed (default: 15)", NULL, AT(rounds)},
    {HADA_OPTION_REAL, "seconds", 0, "S", "about how long convolutions may take in all (default: 300)",
     "Compiling counts, and takes most of a first run; what the plain convolutions take comes on top. Variants for "
     "which there is no time are left out.",
     AT(seconds)},
    {0},
};

/* A net whose convolutions are measured. */
typedef struct job {
    char name[HADA_TUNE_NAME];
    hada_net *net;
    int rows, cols;
} job;

typedef struct work {
    const char *output;
    int rounds;
    int sizes[MOST + 1][2], size_count;
    job jobs[MOST + 1];
    int job_count;
} work;

/* Without anything asked for, the usual sizes and nets are measured. */
static int asks_nothing(const settings *set)
{
    return !set->sizes.count && !set->nets.count && !set->model;
}

static hada_status read_sizes(const settings *set, work *todo, hada_error *err)
{
    static const int usual[3][2] = {{256, 256}, {512, 512}, {1024, 1024}};
    todo->size_count = set->sizes.count;
    for (int i = 0; i < todo->size_count; i++) {
        int *size = todo->sizes[i];
        if (!hada_cli_read_size(set->sizes.items[i], size) || size[0] < 1 || size[1] < 1)
            return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                                  "--size %s is not a size; write rows x columns as in 480x640", set->sizes.items[i]);
    }
    if (asks_nothing(set)) {
        todo->size_count = 3;
        memcpy(todo->sizes, usual, sizeof usual);
    }
    return HADA_OK;
}

/* "compact:512x512". `cli` NULL: only whether it can be read. */
static hada_status read_net(const char *text, const hada_cli *cli, work *todo, hada_error *err)
{
    job *one = &todo->jobs[todo->job_count];
    const char *colon = strchr(text, ':');
    const size_t length = colon ? (size_t)(colon - text) : 0;
    int size[2];
    if (!length || length >= sizeof one->name || !hada_cli_read_size(colon + 1, size) || size[0] < 1 || size[1] < 1)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                              "--net %s is not a net and a size; write them as in compact:512x512", text);
    if (!cli)
        return HADA_OK;
    snprintf(one->name, sizeof one->name, "%.*s", (int)length, text);
    one->rows = size[0];
    one->cols = size[1];
    hada_status status = hada_net_create_preset(&one->net, one->name, 3, 1, err);
    todo->job_count += !status;
    return status;
}

static hada_status read_nets(const settings *set, const hada_cli *cli, work *todo, hada_error *err)
{
    static const char *const usual[2] = {"compact:512x512", "paper:256x256"};
    const int none = asks_nothing(set), count = none ? 2 : set->nets.count;
    for (int i = 0; i < count; i++)
        HADA_TRY(read_net(none ? usual[i] : set->nets.items[i], cli, todo, err));
    return HADA_OK;
}

/* A copy of a model's net, with the size at which it runs. */
static hada_status read_enhance(const hada_model *model, work *todo, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    job *one = &todo->jobs[todo->job_count];
    char *description = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_net_describe(hada_model_get_enhance(model), &description, err));
    HADA_TRY_OR_DONE(hada_net_create(&one->net, description, 1, err));
    snprintf(one->name, sizeof one->name, "the model's net");
    one->rows = info->enhance_rows ? info->enhance_rows : info->window_rows;
    one->cols = info->enhance_cols ? info->enhance_cols : info->window_cols;
    todo->job_count++;
done:
    hada_text_destroy(&description);
    return status;
}

/* The transforms of a model, and its net if it has one. */
static hada_status read_model(const char *path, work *todo, hada_error *err)
{
    hada_model *model = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_model_load(&model, path, err));
    const hada_model_info *info = hada_model_get_info(model);
    todo->sizes[todo->size_count][0] = info->grid_rows;
    todo->sizes[todo->size_count++][1] = info->grid_cols;
    if (info->enhance)
        HADA_TRY_OR_DONE(read_enhance(model, todo, err));
done:
    hada_model_destroy(&model);
    return status;
}

static hada_status find_work(const hada_cli *cli, const settings *set, work *todo, hada_error *err)
{
    HADA_TRY(read_sizes(set, todo, err));
    HADA_TRY(read_nets(set, cli, todo, err));
    if (set->model)
        HADA_TRY(read_model(set->model, todo, err));
    return HADA_OK;
}

static json_t *time_json(const hada_tune_time *time)
{
    return json_pack("{s:o, s:o, s:s}", "forward_ms", hada_cli_real(time->forward_ms), "inverse_ms",
                     hada_cli_real(time->inverse_ms), "reason", time->reason);
}

static void print_row(hada_cli *cli, const hada_tune_row *row)
{
    hada_cli_digits text[4];
    char size[32];
    snprintf(size, sizeof size, "%dx%d", row->rows, row->cols);
    hada_cli_say(cli, "%-12s  %5d  %10s  %10s  %10s  %10s  %-6s  %s", size, row->batch,
                 hada_cli_number(text[0], "%.3f", row->own.forward_ms),
                 hada_cli_number(text[1], "%.3f", row->own.inverse_ms),
                 hada_cli_number(text[2], "%.3f", row->clfft.forward_ms),
                 hada_cli_number(text[3], "%.3f", row->clfft.inverse_ms), hada_tune_backend_name(row->before),
                 hada_tune_backend_name(row->chosen));
    if (*row->own.reason)
        hada_cli_say(cli, "    own: %s", row->own.reason);
    if (*row->clfft.reason)
        hada_cli_say(cli, "    clfft: %s", row->clfft.reason);
}

static json_t *row_json(const hada_tune_row *row)
{
    return json_pack("{s:i, s:i, s:i, s:o, s:o, s:s, s:s}", "rows", row->rows, "cols", row->cols, "batch", row->batch,
                     "own", time_json(&row->own), "clfft", time_json(&row->clfft), "before",
                     hada_tune_backend_name(row->before), "chosen", hada_tune_backend_name(row->chosen));
}

static hada_status tune_transforms(hada_cli *cli, hada_context *context, const work *todo, hada_error *err)
{
    hada_tune_row rows[MOST];
    hada_status status = HADA_OK;
    hada_cli_progress progress;
    json_t *all = json_array();
    json_object_set_new(cli->document, "sizes", all);
    hada_cli_progress_begin(cli, &progress, "transforms", todo->size_count);
    for (int i = 0; i < todo->size_count; i++) {
        const int rounds = todo->rounds ? todo->rounds : HADA_AUTO;
        HADA_TRY_OR_DONE(hada_cli_check_signals(err));
        HADA_TRY_OR_DONE(hada_tune_fft(context, todo->sizes[i][0], todo->sizes[i][1], rounds, &rows[i], err));
        if (!i)
            hada_cli_say(cli, "%-12s  %5s  %10s  %10s  %10s  %10s  %-6s  %s", "size", "batch", "own fwd", "own inv",
                         "clfft fwd", "clfft inv", "before", "chosen");
        print_row(cli, &rows[i]);
        json_array_append_new(all, row_json(&rows[i]));
        hada_cli_progress_step(cli, NULL);
    }
    if (todo->size_count)
        HADA_TRY_OR_DONE(hada_tune_save(context, todo->output, rows, (size_t)todo->size_count, err));
done:
    hada_cli_progress_end(cli);
    return status;
}

static void print_conv(hada_cli *cli, const hada_tune_conv_row *row, json_t *all)
{
    hada_cli_digits text[2];
    hada_cli_say(cli, "%-30s  %9s  %9s  %3d  %s%s", row->shape, hada_cli_number(text[0], "%.3f", row->before_ms),
                 hada_cli_number(text[1], "%.3f", row->chosen_ms), row->measured, row->chosen,
                 strcmp(row->before, row->chosen) ? "" : " (as before)");
    if (row->refused)
        hada_cli_say(cli, "    %d left out as wrong; the last: %s", row->refused, row->reason);
    json_array_append_new(all, json_pack("{s:s, s:i, s:s, s:o, s:s, s:o, s:i, s:i, s:i, s:s}", "shape", row->shape,
                                         "layers", row->layers, "before", row->before, "before_ms",
                                         hada_cli_real(row->before_ms), "chosen", row->chosen, "chosen_ms",
                                         hada_cli_real(row->chosen_ms), "measured", row->measured, "refused",
                                         row->refused, "skipped", row->skipped, "reason", row->reason));
}

/* Written after each convolution: what was measured stays when the rest is broken off. */
static hada_status tune_net(hada_cli *cli, hada_context *context, const work *todo, const job *net, double seconds,
                            json_t *all, hada_error *err)
{
    hada_tune_conv_row *rows = NULL;
    size_t count = 0;
    int skipped = 0;
    double before = 0, chosen = 0;
    hada_cli_progress progress;
    const double end = hada_cli_seconds() + seconds;
    hada_status status = hada_tune_net(context, net->net, net->rows, net->cols, &rows, &count, err);
    hada_cli_progress_begin(cli, &progress, "convolutions", (int)count);
    HADA_TRY_OR_DONE(status);
    for (size_t i = 0; i < count; i++) {
        const double left = (end - hada_cli_seconds()) / (double)(count - i);
        HADA_TRY_OR_DONE(hada_cli_check_signals(err));
        HADA_TRY_OR_DONE(hada_tune_conv(context, &rows[i], left > LEAST_SECONDS ? left : LEAST_SECONDS, err));
        HADA_TRY_OR_DONE(hada_tune_save_convs(context, todo->output, &rows[i], 1, err));
        if (!i)
            hada_cli_say(cli, "\n%s, %d x %d pixels\n%-30s  %9s  %9s  %3s  %s", net->name, net->rows, net->cols,
                         "convolution", "before", "chosen", "of", "chosen");
        print_conv(cli, &rows[i], all);
        skipped += rows[i].skipped;
        before += rows[i].layers * rows[i].before_ms;
        chosen += rows[i].layers * rows[i].chosen_ms;
        hada_cli_progress_step(cli, NULL);
    }
    hada_cli_say(cli, "%-30s  %9.3f  %9.3f", "all layers", before, chosen);
    if (skipped)
        hada_cli_say(cli,
                     "%d variants were left out for lack of time; --seconds gives more, and a second run finds their "
                     "programs compiled",
                     skipped);
done:
    hada_cli_progress_end(cli);
    hada_tune_convs_destroy(&rows);
    return status;
}

static hada_status tune(hada_cli *cli, const settings *set, hada_context *context, hada_error *err)
{
    work todo = {.output = set->output, .rounds = set->rounds};
    json_t *all = json_array();
    hada_status status = find_work(cli, set, &todo, err);
    status = status ? status : tune_transforms(cli, context, &todo, err);
    json_object_set_new(cli->document, "convolutions", all);
    HADA_TRY_OR_DONE(status);
    const double end = hada_cli_seconds() + set->seconds;
    for (int i = 0; i < todo.job_count; i++) {
        const double left = (end - hada_cli_seconds()) / (todo.job_count - i);
        HADA_TRY_OR_DONE(tune_net(cli, context, &todo, &todo.jobs[i], left, all, err));
    }
    hada_cli_say(cli,
                 "\nMilliseconds, medians: transforms of a batch, convolutions of one image. Wrote %s; it serves where "
                 "HADALENS_TUNING names it.",
                 set->output);
    json_object_set_new(cli->document, "output", hada_cli_json_text(set->output));
done:
    for (int i = 0; i < todo.job_count; i++)
        hada_net_destroy(&todo.jobs[i].net);
    return status;
}

static void defaults(void *user)
{
    ((settings *)user)->seconds = 300;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    const settings *set = user;
    hada_error err = {0};
    hada_context *context = NULL;
    work todo = {0};
    if (count)
        return hada_cli_usage(cli, "'%s' is one word too many; sizes are given with --size", arguments[0]);
    if (!set->output)
        return hada_cli_usage(cli, "the tuning file is missing; give it with -o FILE");
    if (read_sizes(set, &todo, &err) || read_nets(set, NULL, &todo, &err))
        return hada_cli_usage(cli, "%s", err.message);
    if (!(set->seconds > 0))
        return hada_cli_usage(cli, "--seconds is a time above 0");
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_cli_open(cli, &context, &err));
    HADA_TRY_OR_DONE(tune(cli, set, context, &err));
done:
    hada_cli_close(cli, &context);
    return status ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens tune -o tuning.txt -m camera.model", "measures what a model needs, on the device that would be used."},
    {"hadalens tune -o tuning.txt --size 480x640", "measures the transforms of one size."},
    {"HADALENS_TUNING=tuning.txt hadalens reconstruct *.tif -m camera.model -o pictures", "works by it."},
    {0},
};

const hada_cli_command hada_cli_tune = {
    .name = "tune",
    .summary = "measure which transforms and convolutions are faster on a device, and write a tuning file",
    .synopsis = "-o FILE [-m MODEL] [--size HxW]... [--net NAME:HxW]... [OPTION...]",
    .description =
        "Times the own transforms against those of clFFT, which take turns, and writes the faster one for each size; "
        "and for each convolution of a net the methods, tile sizes and shares of work that can serve it. What cannot "
        "serve, or fails its check (known answers, the plain convolution), is left out.\n\n"
        "Nothing is ever measured without this command: shipped tables decide, or the tuning file that the "
        "environment variable HADALENS_TUNING names, so that results stay the same from run to run. Compiling "
        "clFFT's kernels for a new size can take half a minute.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .defaults = defaults,
    .run = run,
    .uses_device = 1,
};
