#include "command.h"
#include "evaluate_tell.h"
#include "option.h"

#include <hadalens/response.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

typedef struct settings {
    hada_cli_common common;
    hada_evaluate_task task;
    const char *distances, *window, *lpips, *lpips_heads, *encoding, *truth_encoding;
    int lpips_net;
} settings;

#define AT(member) HADA_CLI_AT(settings, member)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("Yardstick"),
    {HADA_OPTION_REAL, "peak", 0, "VALUE", "value that counts as full scale for PSNR and SSIM (default: 1)", NULL,
     AT(task.peak)},
    {HADA_OPTION_FLAG, "match-gain", 0, NULL, "multiply each result by the factor that fits best first",
     "For models made from a PSF, which do not know the scale of the scene.", AT(task.match_gain)},
    {HADA_OPTION_REAL, "tolerance", 0, "STEPS", "a distance is right within this many depth steps (default: 0.5)", NULL,
     AT(task.tolerance)},
    {HADA_OPTION_TEXT, "distances", 0, "LIST", "the camera's distances in mm, which say what a depth step is",
     "Without it they are read from NAME_stack.tif beside NAME_depth.tif.", AT(distances)},
    {HADA_OPTION_FLAG, "authors", 0, NULL, "show PSNR and SSIM also as the code of the 2022 paper computes them",
     "The mean of each pixel's PSNR, and SSIM with twice the data range. --json always has them.", AT(task.authors)},
    {HADA_OPTION_TEXT, "encoding", 0, "linear|srgb|P", "compare in this encoding (default: the truth's)",
     "Both are brought to it; the result says how its values stand for light.", AT(encoding)},
    {HADA_OPTION_TEXT, "truth-encoding", 0, "linear|srgb|P", "how the values of the truth stand for light",
     "Without it: what its file says, else as the scenes that the result's camera was learned from.",
     AT(truth_encoding)},
    {HADA_OPTION_REAL, "gate-pixels", 0, "P", "an emitter is found within so many pixels of the true one (default: 2)",
     NULL, AT(task.gate_pixels)},
    {HADA_OPTION_REAL, "gate-depths", 0, "D", "and within so many depths (default: 2.5)", NULL, AT(task.gate_depths)},
    HADA_CLI_GROUP("Where"),
    {HADA_OPTION_TEXT, "window", 0, "HxW[+ROW+COL]", "compare within this rectangle alone",
     "It stands at the centre where the row and column of its top left are not given. Nothing outside it is looked at.",
     AT(window)},
    {HADA_OPTION_TEXT, "mask", 0, "FILE", "compare only where this image is not 0",
     "A TIFF file of the size of the images, first page. SSIM and sharpness still see the neighbours of these pixels.",
     AT(task.mask)},
    HADA_CLI_GROUP("LPIPS"),
    {HADA_OPTION_TEXT, "lpips", 0, "FILE", "weights of VGG-16 or AlexNet (safetensors): adds the perceptual distance",
     "docs/reference/measures.md tells how to make the file from the packages torchvision and lpips; none comes with this "
     "program.",
     AT(lpips)},
    {HADA_OPTION_TEXT, "lpips-heads", 0, "FILE", "the linear heads, where they stand in a file of their own", NULL,
     AT(lpips_heads)},
    {HADA_OPTION_CHOICE, "lpips-net", 0, "vgg|alex", "insist on this net (default: what the file holds)", NULL,
     HADA_CLI_ONE_OF(settings, lpips_net, HADA_LPIPS_VGG, HADA_LPIPS_ALEX)},
    {0},
};

static void defaults(void *user)
{
    settings *set = user;
    hada_evaluate_task_init(&set->task);
    set->encoding = set->truth_encoding = "auto";
}

/* "HxW", or "HxW+ROW+COL". */
static int read_window(hada_evaluate_task *task, const char *text)
{
    char size[32];
    int used = 0, extent[2];
    const size_t length = strcspn(text, "+");
    if (length >= sizeof size)
        return 0;
    memcpy(size, text, length);
    size[length] = 0;
    if (!hada_cli_read_size(size, extent) || extent[0] < 1 || extent[1] < 1)
        return 0;
    task->window_rows = extent[0];
    task->window_cols = extent[1];
    return !text[length] || (sscanf(text + length, "+%9d+%9d%n", &task->window_row, &task->window_col, &used) == 2 &&
                             !text[length + (size_t)used] && task->window_row >= 0 && task->window_col >= 0);
}

static hada_status open_lpips(hada_cli *cli, const settings *set, hada_context **context, hada_lpips **lpips,
                              hada_error *err)
{
    static const char *const names[] = {"", "vgg", "alex"};
    HADA_TRY(hada_cli_open(cli, context, err));
    HADA_TRY(hada_lpips_create(lpips, *context, (hada_lpips_net)set->lpips_net, set->lpips, set->lpips_heads, err));
    json_object_set_new(cli->document, "lpips_net", json_string(names[hada_lpips_get_net(*lpips)]));
    return HADA_OK;
}

static hada_status evaluate(hada_cli *cli, settings *set, const char **paths, hada_error *err)
{
    double distances[4096];
    hada_status status = HADA_OK;
    hada_context *context = NULL;
    hada_evaluate_report *report = NULL;
    hada_evaluate_task *task = &set->task;
    task->distances_mm = distances;
    task->authors |= set->common.json;
    task->monitor = &cli->monitor;
    if (set->window && !read_window(task, set->window))
        HADA_TRY_OR_DONE(
            hada_cli_error(err, HADA_ERROR_ARGUMENT,
                           "--window %s is not a window; write rows x columns as in 192x192, or with the row and "
                           "column of its top left as in 192x192+10+20",
                           set->window));
    HADA_TRY_OR_DONE(hada_response_from_name(&task->encoding, set->encoding, err));
    HADA_TRY_OR_DONE(hada_response_from_name(&task->truth_encoding, set->truth_encoding, err));
    HADA_TRY_OR_DONE(hada_cli_read_distances("distances", set->distances, distances, 4096, &task->distances, err));
    if (set->lpips)
        HADA_TRY_OR_DONE(open_lpips(cli, set, &context, &task->lpips, err));
    HADA_TRY_OR_DONE(hada_evaluate_run(&report, paths[0], paths[1], task, err));
    hada_cli_evaluate_tell(cli, report, set->task.tolerance);
done:
    hada_evaluate_report_destroy(&report);
    hada_lpips_destroy(&task->lpips);
    if (context)
        hada_cli_close(cli, &context);
    return status;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    settings *set = user;
    hada_error err = {0};
    if (count != 2)
        return hada_cli_usage(cli, "two names are needed, the result and the truth, not %d", count);
    if (!(set->task.peak > 0) || !(set->task.tolerance > 0))
        return hada_cli_usage(cli, "--peak and --tolerance must be greater than zero");
    if (!(set->task.gate_pixels > 0) || !(set->task.gate_depths > 0))
        return hada_cli_usage(cli, "--gate-pixels and --gate-depths must be greater than zero");
    if ((set->lpips_heads || set->lpips_net) && !set->lpips)
        return hada_cli_usage(cli, "--lpips-heads and --lpips-net need --lpips FILE");
    return evaluate(cli, set, arguments, &err) ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens evaluate pictures camera/test/truth", "all results of a folder that have a truth."},
    {"hadalens evaluate pictures/a_aif.tif a.tif --match-gain", "one image, whatever its scale."},
    {"hadalens evaluate pictures/a_emitters.csv truth.csv", "emitters: recall, precision, errors."},
    {"hadalens evaluate pictures truth --window 192x192 --lpips vgg.safetensors", "the centre, and LPIPS as well."},
    {0},
};

const hada_cli_command hada_cli_evaluate = {
    .name = "evaluate",
    .summary = "compare results with the truth: PSNR, SSIM, MAE, LPIPS, sharpness, distances",
    .synopsis = "RESULT TRUTH [OPTION...]",
    .description =
        "RESULT and TRUTH are two files or two folders. In folders, files of the same name are compared, and "
        "NAME_aif.tif with NAME.tif. Files named NAME_depth.tif are distance maps in millimetres: pixels that are NaN "
        "in the result are not covered, those that are NaN in the truth are left out. Where the depth steps are known, maps "
        "and all-in-focus images are also judged at jumps of the true distances and away from them, pixels beyond the "
        "camera's distances apart, and NAME_confidence.tif beside a map by what it promises. In files named NAME_stack.tif "
        "the planes that are dark in the truth are left out of the means; --json also gives the PSNR over all planes. Two "
        "files that end in .csv are tables of emitters: columns x, y, z, and frame where there are several.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .defaults = defaults,
    .run = run,
    .uses_device = 1,
};
