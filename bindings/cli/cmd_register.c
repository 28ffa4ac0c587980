#include "option.h"
#include "shared.h"

#include <hadalens/folder.h>
#include <hadalens/task_register.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct settings {
    hada_cli_common common;
    hada_dataset_options scan;
    hada_register_task task;
    const char *output, *magnification;
    int window[2];
} settings;

#define AT(member) HADA_CLI_AT(settings, member)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("Result"),
    {HADA_OPTION_TARGET, "output", 'o', "DATASET", "write a data set with registered scenes; without it, only report",
     "Raw frames are taken over as they are, as hard links where that goes. Transforms that would move no pixel of a "
     "scene by more than the precision reached are not applied.",
     AT(output)},
    {HADA_OPTION_SIZE, "window", 0, "HxW", "size of the registered scenes (default: what they fill, within the frame)",
     NULL, AT(window)},
    HADA_CLI_GROUP("Search"),
    {HADA_OPTION_TEXT, "magnification", 0, "MIN,MAX", "pixels of the frame per pixel of a scene file",
     "Default: such that the scene's longer side has 0.15 to 2.5 times that of the frame.", AT(magnification)},
    {HADA_OPTION_REAL, "rotation", 0, "DEGREES", "rotation beside quarter turns, to either side (default: 15)", NULL,
     AT(task.most_rotation_deg)},
    {HADA_OPTION_FLAG, "no-offset", 0, NULL, "leave the shifts between depths as they are", NULL,
     AT(task.keep_offsets)},
    {HADA_OPTION_CHOICE, "bayer", 0, "auto|none|rggb|bggr|grbg|gbrg",
     "colour filter mosaic of raw frames of one channel (default: auto)",
     "The colours of the first two rows and columns. auto: as raw files say (DNG), else none. The frames stay as they are.",
     HADA_CLI_ONE_OF(settings, scan.mosaic, HADA_MOSAIC_AUTO, HADA_MOSAIC_NONE, HADA_MOSAIC_RGGB, HADA_MOSAIC_BGGR,
                     HADA_MOSAIC_GRBG, HADA_MOSAIC_GBRG)},
    {HADA_OPTION_FLAG, "skip-incomplete", 0, NULL, "leave out files without their partner", NULL,
     AT(scan.skip_incomplete)},
    {0},
};

static void defaults(void *user)
{
    settings *set = user;
    hada_dataset_options_init(&set->scan);
    hada_register_task_init(&set->task);
}

/* "0.5,2" */
static hada_status read_magnification(const char *text, hada_register_task *task, hada_error *err)
{
    char *copy = hada_cli_text("%s", text), *comma = strchr(copy, ',');
    if (comma)
        *comma++ = 0;
    const int good = comma && hada_cli_read_real(copy, &task->least_magnification) &&
                     hada_cli_read_real(comma, &task->most_magnification) && task->least_magnification > 0;
    free(copy);
    return good ? HADA_OK
                : hada_cli_error(err, HADA_ERROR_ARGUMENT,
                                 "--magnification %s is not a range; write two numbers as in 0.5,2", text);
}

static hada_status write_registered(hada_cli *cli, const settings *set, const hada_dataset *data,
                                    const hada_register_report *report, const hada_register_task *task, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(data);
    int rows, cols;
    HADA_TRY(hada_register_write(report, data, set->output, task, &rows, &cols, err));
    hada_cli_say(cli, "%s: %d %s at %d %s, scenes of %dx%d", set->output, info->pairs,
                 info->pairs == 1 ? "pair" : "pairs", info->depths, info->depths == 1 ? "distance" : "distances", rows,
                 cols);
    json_object_set_new(cli->document, "output", hada_cli_json_text(set->output));
    json_object_set_new(cli->document, "window", json_pack("[i, i]", rows, cols));
    return HADA_OK;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    settings *set = user;
    hada_error err = {0};
    hada_dataset *data = NULL;
    hada_register_report *report = NULL;
    hada_status status = HADA_OK;
    if (count != 1)
        return hada_cli_usage(cli, "one data set is needed, not %d", count);
    if (set->output && !hada_path_is_vacant(set->output))
        return hada_cli_usage(cli, "%s is there already; give -o the name of a new folder", set->output);
    set->task.window_rows = set->window[0];
    set->task.window_cols = set->window[1];
    set->task.monitor = &cli->monitor;
    if (set->magnification)
        HADA_TRY_OR_DONE(read_magnification(set->magnification, &set->task, &err));
    HADA_TRY_OR_DONE(hada_dataset_scan(&data, arguments[0], &set->scan, &err));
    HADA_TRY_OR_DONE(hada_register_run(&report, data, &set->task, &err));
    hada_cli_tell_registered(cli, data, report);
    if (set->output)
        HADA_TRY_OR_DONE(write_registered(cli, set, data, report, &set->task, &err));
done:
    hada_register_report_destroy(&report);
    hada_dataset_destroy(&data);
    return status ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens register captures", "how do the scenes stand on the sensor?"},
    {"hadalens register captures -o camera && hadalens fit camera -o camera.model", "put them right, then learn."},
    {0},
};

const hada_cli_command hada_cli_register = {
    .name = "register",
    .summary = "find how scenes stand on the sensor, from the pairs alone, and put them right",
    .synopsis = "DATASET [-o DATASET2] [OPTION...]",
    .description =
        "For pairs captured from a display, whose scene files are the pictures that were shown: finds for each depth "
        "how they are turned, mirrored, magnified and slanted on the sensor, without knowing the camera's PSF, and shifts "
        "between the depths. Only with the right transform does one convolution explain all pairs; 'explained' says "
        "how much of the frames' structure it explains when learned from the other pairs, 'otherwise' how much the "
        "best transform in another orientation does.\n\n"
        "A shift that all depths share cannot be found, nor does it matter: the PSF takes it up. The first depth "
        "stays where it is; the others are moved so that their PSFs are scaled copies of its PSF about the middle of "
        "the frame. Two pairs per depth are the least, five or more are better.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .defaults = defaults,
    .run = run,
};
