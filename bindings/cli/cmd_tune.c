#include "command.h"

#include <hadalens/tune.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

enum { MOST = HADA_CLI_TEXTS };

typedef struct settings {
    hada_cli_common common;
    const char *output;
    hada_cli_texts sizes;
    int rounds;
} settings;

#define AT(member) offsetof(settings, member)
static const hada_cli_option options[] = {
    {HADA_OPTION_GROUP, NULL, 0, NULL, "Measurement", NULL, 0},
    {HADA_OPTION_TEXT, "output", 'o', "FILE", "the tuning file to write or to bring up to date (needed)",
     "Lines about other devices and sizes stay as they are.", AT(output)},
    {HADA_OPTION_TEXTS, "size", 0, "HxW", "rows and columns of the transforms; may be given more than once",
     "Default: 256x256, 512x512 and 1024x1024. Transforms have the size of a model's grid: the frame's with the "
     "boundary 'circular', a larger one with 'padded'. The JSON document of 'fit' tells it as grid.",
     AT(sizes)},
    {HADA_OPTION_COUNT, "rounds", 0, "N", "how often each is timed (default: 15)", NULL, AT(rounds)},
    {0},
};

static hada_status read_sizes(const settings *set, int sizes[][2], int *count, hada_error *err)
{
    static const int usual[3][2] = {{256, 256}, {512, 512}, {1024, 1024}};
    *count = set->sizes.count;
    for (int i = 0; i < *count; i++)
        if (!hada_cli_read_size(set->sizes.items[i], sizes[i]) || sizes[i][0] < 1 || sizes[i][1] < 1)
            return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                                  "--size %s is not a size; write rows x columns as in 480x640", set->sizes.items[i]);
    if (!*count) {
        *count = 3;
        memcpy(sizes, usual, sizeof usual);
    }
    return HADA_OK;
}

static json_t *time_json(const hada_tune_time *time)
{
    return json_pack("{s:o, s:o, s:s}", "forward_ms", hada_cli_real(time->forward_ms), "inverse_ms",
                     hada_cli_real(time->inverse_ms), "reason", time->reason);
}

static const char *milliseconds(char *text, double value)
{
    if (isnan(value))
        return "-";
    snprintf(text, 16, "%.3f", value);
    return text;
}

static void print_row(hada_cli *cli, const hada_tune_row *row)
{
    char text[4][16], size[32];
    snprintf(size, sizeof size, "%dx%d", row->rows, row->cols);
    hada_cli_say(cli, "%-12s  %5d  %10s  %10s  %10s  %10s  %-6s  %s", size, row->batch,
                 milliseconds(text[0], row->own.forward_ms), milliseconds(text[1], row->own.inverse_ms),
                 milliseconds(text[2], row->clfft.forward_ms), milliseconds(text[3], row->clfft.inverse_ms),
                 hada_tune_backend_name(row->before), hada_tune_backend_name(row->chosen));
    if (*row->own.reason)
        hada_cli_say(cli, "    own: %s", row->own.reason);
    if (*row->clfft.reason)
        hada_cli_say(cli, "    clfft: %s", row->clfft.reason);
}

static hada_status tune(hada_cli *cli, const settings *set, hada_context *context, hada_error *err)
{
    int sizes[MOST][2], count;
    hada_tune_row rows[MOST];
    hada_status status = read_sizes(set, sizes, &count, err);
    json_t *all = json_array();
    json_object_set_new(cli->document, "sizes", all);
    hada_cli_progress progress;
    hada_cli_progress_begin(cli, &progress, "measuring", count);
    for (int i = 0; !status && i < count; i++) {
        status = hada_cli_check_signals(err);
        if (!status)
            status = hada_tune_fft(context, sizes[i][0], sizes[i][1], set->rounds, &rows[i], err);
        if (status)
            break;
        if (!i)
            hada_cli_say(cli, "%-12s  %5s  %10s  %10s  %10s  %10s  %-6s  %s", "size", "batch", "own fwd", "own inv",
                         "clfft fwd", "clfft inv", "before", "chosen");
        print_row(cli, &rows[i]);
        json_array_append_new(
            all, json_pack("{s:i, s:i, s:i, s:o, s:o, s:s, s:s}", "rows", rows[i].rows, "cols", rows[i].cols, "batch",
                           rows[i].batch, "own", time_json(&rows[i].own), "clfft", time_json(&rows[i].clfft), "before",
                           hada_tune_backend_name(rows[i].before), "chosen", hada_tune_backend_name(rows[i].chosen)));
        hada_cli_progress_step(cli, NULL);
    }
    hada_cli_progress_end(cli);
    if (!status)
        status = hada_tune_save(context, set->output, rows, (size_t)count, err);
    if (!status) {
        hada_cli_say(cli, "\nMilliseconds for a batch, medians. Wrote %s; it serves where HADALENS_TUNING names it.",
                     set->output);
        json_object_set_new(cli->document, "output", json_string(set->output));
    }
    return status;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    const settings *set = user;
    hada_error err = {0};
    hada_context *context = NULL;
    int sizes[MOST][2], n;
    if (count)
        return hada_cli_usage(cli, "'%s' is one word too many; sizes are given with --size", arguments[0]);
    if (!set->output)
        return hada_cli_usage(cli, "the tuning file is missing; give it with -o FILE");
    if (read_sizes(set, sizes, &n, &err))
        return hada_cli_usage(cli, "%s", err.message);
    hada_status status = hada_cli_open(cli, &context, &err);
    if (!status)
        status = tune(cli, set, context, &err);
    hada_cli_close(cli, &context);
    return status ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens tune -o tuning.txt --size 480x640", "measures one size on the device that would be used."},
    {"HADALENS_TUNING=tuning.txt hadalens reconstruct *.tif -m camera.model -o pictures", "works by it."},
    {0},
};

const hada_cli_command hada_cli_tune = {
    .name = "tune",
    .summary = "measure which transforms are faster on a device, and write a tuning file",
    .synopsis = "-o FILE [--size HxW]... [OPTION...]",
    .description =
        "Times the own transforms against those of clFFT, which take turns, and writes the faster one for each size. "
        "A back end that cannot serve a size, or fails its check with known answers, is left out.\n\n"
        "Nothing is ever measured without this command: a shipped table decides, or the tuning file that the "
        "environment variable HADALENS_TUNING names, so that results stay the same from run to run. Compiling clFFT's "
        "kernels for a new size can take half a minute.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .run = run,
    .uses_device = 1,
};
