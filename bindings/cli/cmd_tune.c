#include "option.h"

#include <hadalens/model.h>
#include <hadalens/tune.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST = HADA_CLI_TEXTS + 1 }; /* sizes: one of the model */

typedef struct settings {
    hada_cli_common common;
    const char *output;
    const char *model;
    hada_cli_texts sizes;
    int rounds;
} settings;

#define AT(member) HADA_CLI_AT(settings, member)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("Measurement"),
    {HADA_OPTION_TARGET, "output", 'o', "FILE", "the tuning file to write or to bring up to date (needed)",
     "Lines about other devices and shapes stay as they are.", AT(output)},
    {HADA_OPTION_TEXT, "model", 'm', "MODEL", "measure the transforms of this model", NULL, AT(model)},
    {HADA_OPTION_TEXTS, "size", 0, "HxW", "rows and columns of the transforms; may be given more than once",
     "Default, without --model: 256x256, 512x512 and 1024x1024. Transforms have the size of a model's grid: the frame's "
     "with the boundary 'circular', a larger one with 'padded'. The JSON document of 'fit' has it as grid.",
     AT(sizes)},
    {HADA_OPTION_COUNT, "rounds", 0, "N", "how often each transform is timed (default: 15)", NULL, AT(rounds)},
    {0},
};

typedef struct work {
    int sizes[MOST][2], size_count;
} work;

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
    if (!set->sizes.count && !set->model) { /* the usual sizes */
        todo->size_count = 3;
        memcpy(todo->sizes, usual, sizeof usual);
    }
    return HADA_OK;
}

/* The transforms of a model. */
static hada_status read_model(const char *path, work *todo, hada_error *err)
{
    hada_model *model = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_model_load(&model, path, err));
    const hada_model_info *info = hada_model_get_info(model);
    todo->sizes[todo->size_count][0] = info->grid_rows;
    todo->sizes[todo->size_count++][1] = info->grid_cols;
done:
    hada_model_destroy(&model);
    return status;
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
                 hada_cli_number(text[3], "%.3f", row->clfft.inverse_ms),
                 hada_enum_name(HADA_ENUM_TUNE_BACKEND, (int)row->before),
                 hada_enum_name(HADA_ENUM_TUNE_BACKEND, (int)row->chosen));
    if (*row->own.reason)
        hada_cli_say(cli, "    own: %s", row->own.reason);
    if (*row->clfft.reason)
        hada_cli_say(cli, "    clfft: %s", row->clfft.reason);
}

static json_t *row_json(const hada_tune_row *row)
{
    return json_pack("{s:i, s:i, s:i, s:o, s:o, s:s, s:s}", "rows", row->rows, "cols", row->cols, "batch", row->batch,
                     "own", time_json(&row->own), "clfft", time_json(&row->clfft), "before",
                     hada_enum_name(HADA_ENUM_TUNE_BACKEND, (int)row->before), "chosen",
                     hada_enum_name(HADA_ENUM_TUNE_BACKEND, (int)row->chosen));
}

static hada_status tune_transforms(hada_cli *cli, const settings *set, hada_context *context, const work *todo,
                                   hada_error *err)
{
    hada_tune_row rows[MOST];
    hada_status status = HADA_OK;
    hada_cli_progress progress;
    json_t *all = json_array();
    json_object_set_new(cli->document, "sizes", all);
    hada_cli_progress_begin(cli, &progress, "transforms", todo->size_count);
    for (int i = 0; i < todo->size_count; i++) {
        const int rounds = set->rounds ? set->rounds : HADA_AUTO;
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
        HADA_TRY_OR_DONE(hada_tune_save(context, set->output, rows, (size_t)todo->size_count, err));
done:
    hada_cli_progress_end(cli);
    return status;
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
    if (read_sizes(set, &todo, &err))
        return hada_cli_usage(cli, "%s", err.message);
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_cli_open(cli, &context, &err));
    if (set->model)
        HADA_TRY_OR_DONE(read_model(set->model, &todo, &err));
    HADA_TRY_OR_DONE(tune_transforms(cli, set, context, &todo, &err));
    hada_cli_say(cli, "\nMilliseconds, medians of a batch. Wrote %s; it is used where HADALENS_TUNING names it.",
                 set->output);
    json_object_set_new(cli->document, "output", hada_cli_json_text(set->output));
done:
    hada_cli_close(cli, &context);
    return status ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens tune -o tuning.txt -m camera.model",
     "measures the transforms of a model, on the device that would be used."},
    {"hadalens tune -o tuning.txt --size 480x640", "measures the transforms of one size."},
    {"HADALENS_TUNING=tuning.txt hadalens reconstruct *.tif -m camera.model -o pictures", "works by it."},
    {0},
};

const hada_cli_command hada_cli_tune = {
    .name = "tune",
    .summary = "measure which transforms are faster on a device, and write a tuning file",
    .synopsis = "-o FILE [-m MODEL] [--size HxW]... [OPTION...]",
    .description =
        "Times the own transforms against those of clFFT in turns and writes the faster one for each size. What does "
        "not take a size, or does not give the known answers, is left out.\n\n"
        "Nothing is ever measured without this command: shipped tables decide, or the tuning file that the "
        "environment variable HADALENS_TUNING names, so that results stay the same from run to run. Compiling "
        "clFFT's kernels for a new size can take half a minute.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .run = run,
    .uses_device = 1,
};
