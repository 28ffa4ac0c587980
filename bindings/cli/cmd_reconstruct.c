#include "command.h"
#include "folder.h"
#include "frame_files.h"
#include "method_options.h"
#include "model_words.h"
#include "skip_words.h"

#include <hadalens/job.h>

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct settings {
    hada_cli_common common;
    const char *model, *output, *depths, *occupied, *refine, *refine_tv, *dark, *skip;
    int bits, half, repair, no_enhance, no_preview, batch, queues;
    double gamma, white, max_error, band;
    hada_cli_method_settings method;
} settings;

#define AT(member) HADA_CLI_AT(settings, member)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("Input and output"),
    {HADA_OPTION_TEXT, "model", 'm', "MODEL", "the camera, from 'hadalens fit'", NULL, AT(model)},
    {HADA_OPTION_TEXT, "output", 'o', "FOLDER", "where the results go; made when missing", NULL, AT(output)},
    {HADA_OPTION_CHOICE, "bits", 0, "8|16|32", "bits per value of stack and all-in-focus image (default: 32, float)",
     "8 and 16 bits hold 0 to 1 (see --white) and cut off what is beyond. The distance map is always float.", AT(bits)},
    {HADA_OPTION_REAL, "white", 0, "VALUE", "value that becomes full scale in 8 and 16 bits (default: 1)", NULL,
     AT(white)},
    {HADA_OPTION_REAL, "gamma", 0, "G", "exponent on the finished images (default: 1, linear)", NULL, AT(gamma)},
    {HADA_OPTION_FLAG, "no-preview", 0, NULL, "write no NAME_preview.png", NULL, AT(no_preview)},

    HADA_CLI_GROUP("Reconstruction"),
    {HADA_OPTION_TEXT, "depths", 0, "LIST", "depths to compute (default: all)",
     "Slices counted from 1 (near), such as 1,3-5, or distances, such as 100mm,250mm.", AT(depths)},
    {HADA_OPTION_TEXT, "occupied", 0, "auto|all|LIST", "depths at which the scene has something (default: auto)",
     "auto finds the few depths that explain the frame; the others are dark then. LIST as for --depths.", AT(occupied)},
    {HADA_OPTION_TEXT, "refine", 0, "N|auto|0", "refinement steps on the occupied depths (default: auto)",
     "auto takes what the fit measured to pay for this camera. 0: the linear filters alone, the quickest; the default "
     "with "
     "--method matched.",
     AT(refine)},
    {HADA_OPTION_TEXT, "refine-tv", 0, "W|auto|0", "weight of total variation in refinement (default: auto)",
     "auto takes what the fit measured to pay, which goes with the noise; more is smoother.", AT(refine_tv)},
    {HADA_OPTION_TEXT, "dark", 0, "FILE|auto|none|LEVEL", "dark level of the frames (default: what the model says)",
     "FILE: a dark frame of the camera; auto: each frame's own; LEVEL: a share of full scale.", AT(dark)},
    {HADA_OPTION_FLAG, "repair", 0, NULL, "fill NaN and infinite pixels from their neighbours",
     "Without it such a frame is refused.", AT(repair)},
    {HADA_OPTION_FLAG, "no-enhance", 0, NULL, "leave out the net that the model holds", NULL, AT(no_enhance)},
    {HADA_OPTION_FLAG, "half", 0, NULL, "keep the filters in half precision on the device", NULL, AT(half)},
    {HADA_OPTION_REAL, "max-error", 0, "E", "relative change of the stack that may be traded for time (default: 0)",
     "Root of the sum of squares over all pixels, such as 0.01. Acts with --refine 0; each frame says what was "
     "skipped and how much it may have changed.",
     AT(max_error)},
    {HADA_OPTION_TEXT, "skip", 0, "all|none|LIST", "what may be skipped where a scene does not need it (default: all)",
     "LIST of prune, depths, frequencies, half, channels, frames, tiles. Without --max-error only what is exact.",
     AT(skip)},
    {HADA_OPTION_REAL, "band", 0, "B", "share of the sensor's Nyquist frequency that is used (default: 1)",
     "With --refine 0, for optics that resolve less than the sensor: 0.7 leaves half of the frequencies.", AT(band)},
    {HADA_OPTION_COUNT, "batch", 0, "N", "depths computed at once (default: by memory)", NULL, AT(batch)},
    {HADA_OPTION_COUNT, "queues", 0, "N", "frames at once on each device (default: 1)",
     "With two, the transfers of one frame overlap with computing another; each takes memory of its own. For several "
     "devices give a list of them, such as 0,1, or cpu/2 for the CPU in two halves.",
     AT(queues)},

    HADA_CLI_GROUP("Other methods, on the model's transfer functions"),
    {HADA_OPTION_CHOICE, "method", 0, "hadamard|matched|wiener|rl|fista|admm", "what to do (default: hadamard)",
     "hadamard: the model's own filters, then --refine. matched: the transposed optics. wiener: the linear filter for "
     "all depths jointly. rl (Richardson-Lucy), fista and admm iterate, without --refine and without looking for the "
     "occupied depths: all of --depths, or those of --occupied.",
     AT(method.method)},
    {HADA_OPTION_COUNT, "iterations", 0, "N", "iterations at most (default: 100)", NULL, AT(method.iterations)},
    {HADA_OPTION_REAL, "stop", 0, "R", "stop when the planes change by less than this share, twice (default: never)",
     NULL, AT(method.stop)},
    {HADA_OPTION_REAL, "seconds", 0, "S", "stop after so much time for a frame (default: never)",
     "The result then depends on how fast the machine is.", AT(method.seconds)},
    {HADA_OPTION_CHOICE, "prior", 0, "none|tv|wavelet|haar", "beside non-negativity (default: admm tv, else none)",
     "tv: total variation. For fista also Haar wavelets, translation-invariant (wavelet) or orthonormal (haar).",
     AT(method.prior)},
    {HADA_OPTION_REAL, "weight", 0, "W", "weight of the prior (default: 0.003; rl, wavelet 0.005)", NULL,
     AT(method.weight)},
    {HADA_OPTION_REAL, "tv", 0, "W", "the same as --prior tv --weight W", NULL, AT(method.tv)},
    {HADA_OPTION_CHOICE, "support", 0, "window|grid", "where light may come from (default: admm grid, else window)",
     NULL, AT(method.support)},
    {HADA_OPTION_REAL, "lambda", 0, "L", "noise that wiener reckons with, in mean |OTF|^2 (default: 0.1)", NULL,
     AT(method.lambda)},
    {HADA_OPTION_FLAG, "no-accelerate", 0, NULL, "rl: without Biggs and Andrews' acceleration", NULL, AT(method.plain)},
    {HADA_OPTION_REAL, "step", 0, "S", "fista: step of the gradient, below 2 (default: 1)", NULL, AT(method.step)},
    {HADA_OPTION_COUNT, "inner", 0, "N", "fista: iterations of the tv step (default: 5)", NULL, AT(method.inner)},
    {HADA_OPTION_COUNT, "levels", 0, "N", "fista: levels of wavelets (default: 3)", NULL, AT(method.levels)},
    {HADA_OPTION_TEXT, "mu", 0, "M1,M2,M3", "admm: weights of the splits of data, gradient and planes", NULL,
     AT(method.mu)},
    {0},
};

static void defaults(void *user)
{
    settings *set = user;
    set->occupied = "auto";
    set->refine_tv = "auto";
    set->skip = "all";
    set->band = 1;
    set->bits = 3;
    set->gamma = 1;
    set->white = 1;
    hada_cli_method_defaults(&set->method);
}

/* What stays the same over all files. */
typedef struct job {
    hada_cli *cli;
    const settings *set;
    hada_cli_contexts devices;
    hada_model *model;
    hada_plan *plan;
    hada_classic_options classic;
    hada_cli_dark dark;
    int *depths, *occupied;
} job;

static hada_status read_options(job *work, hada_plan_options *plan, hada_error *err)
{
    const settings *set = work->set;
    const hada_model_info *info = hada_model_get_info(work->model);
    hada_status status = HADA_OK;
    hada_plan_options_init(plan);
    hada_classic_options_init(&work->classic);
    work->depths = calloc((size_t)info->depths, sizeof *work->depths);
    work->occupied = calloc((size_t)info->depths, sizeof *work->occupied);
    if (!work->depths || !work->occupied)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (set->depths) {
        status = hada_cli_read_depths("depths", set->depths, info->distances_mm, info->depths, work->depths,
                                      &plan->depth_count, err);
        plan->depths = work->depths;
    }
    if (!status && !strcmp(set->occupied, "all")) {
        plan->occupied = HADA_OCCUPIED_ALL;
    } else if (!status && strcmp(set->occupied, "auto")) {
        plan->occupied = HADA_OCCUPIED_LIST;
        status = hada_cli_read_depths("occupied", set->occupied, info->distances_mm, info->depths, work->occupied,
                                      &plan->occupied_count, err);
        plan->occupied_list = work->occupied;
    }
    /* The transposed optics are a way of their own: refinement would take their place. */
    const char *refine = set->method.method == HADA_CLI_METHOD_MATCHED ? "0" : "auto";
    if (!status)
        status = hada_cli_read_refine(set->refine ? set->refine : refine, &plan->refine, err);
    if (!status)
        status = hada_cli_read_refine_tv(set->refine_tv, &plan->refine_tv, err);
    if (!status && set->dark) {
        status = hada_cli_read_dark(&work->dark, set->dark, err);
        plan->dark = work->dark.kind;
        plan->dark_level = work->dark.level;
        plan->dark_frame = work->dark.kind == HADA_DARK_FRAME ? &work->dark.frame : NULL;
    }
    if (!status)
        status = hada_cli_read_skip(set->skip, &plan->skip, err);
    if (!status)
        status = hada_cli_read_method(&set->method, &work->classic, err);
    plan->classic = &work->classic;
    plan->max_error = set->max_error;
    plan->band = set->band;
    plan->repair_not_finite = set->repair;
    plan->half = set->half;
    plan->enhance = !set->no_enhance;
    plan->batch = set->batch;
    plan->queues = set->queues;
    plan->gamma = set->gamma;
    return status;
}

/* matched in place of the model's own filters. */
static hada_status change_form(job *work, hada_error *err)
{
    hada_model *other = NULL;
    if (work->set->method.method != HADA_CLI_METHOD_MATCHED)
        return HADA_OK;
    hada_status status = hada_model_with_form(&other, work->model, HADA_FORM_MATCHED, 0, err);
    if (status)
        return status;
    hada_model_destroy(&work->model);
    work->model = other;
    return HADA_OK;
}

/* Frames in memory at a time: one for each queue, one that is read and one that is written. */
static int frames_ahead(const hada_plan *plan)
{
    return hada_plan_queues(plan, NULL, 0) + 2;
}

static void tell_memory(const job *work, uint64_t device, uint64_t host)
{
    char device_text[16], host_text[16];
    hada_cli_detail(work->cli, "this takes %s on the device and %s of ordinary memory",
                    hada_cli_bytes(device_text, device), hada_cli_bytes(host_text, host));
    json_object_set_new(work->cli->document, "memory",
                        json_pack("{s:I, s:I}", "device_bytes", (json_int_t)device, "host_bytes", (json_int_t)host));
}

static hada_status make_plan(job *work, const hada_plan_options *wanted, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(work->model);
    uint64_t all = 0, device = 0, host = 0;
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < work->devices.count; i++) {
        status = hada_plan_estimate(work->devices.contexts[i], work->model, wanted, &device, &host, err);
        all += device;
    }
    if (!status)
        status =
            hada_plan_create_on(&work->plan, work->devices.contexts, work->devices.count, work->model, wanted, err);
    if (!status) {
        const uint64_t raw = 4 * (uint64_t)info->channels * (uint64_t)info->raw_rows * (uint64_t)info->raw_cols;
        tell_memory(work, all, (uint64_t)frames_ahead(work->plan) * (host + raw));
    }
    return status;
}

static hada_status prepare(job *work, hada_error *err)
{
    hada_plan_options plan;
    hada_status status = hada_model_load(&work->model, work->set->model, err);
    if (status)
        hada_cli_prefix(err, "%s: ", work->set->model);
    if (!status)
        status = change_form(work, err);
    if (!status)
        status = read_options(work, &plan, err);
    if (!status)
        status = hada_folder_ensure(work->set->output, err);
    if (!status)
        status = hada_cli_open_all(work->cli, &work->devices, err);
    return status ? status : make_plan(work, &plan, err);
}

static int run_files(job *work, int count, const char **paths, char **names)
{
    static const int bits[] = {8, 8, 16, 32};
    const settings *set = work->set;
    const hada_cli_frame_settings frames = {.folder = set->output,
                                            .model = set->model,
                                            .preview = !set->no_preview && hada_cli_pictures(work->cli),
                                            .bits = bits[set->bits],
                                            .white = set->white};
    return hada_cli_frame_files(work->cli, work->plan, work->model, &frames, count, paths, names,
                                frames_ahead(work->plan));
}

/* The output names; two inputs must not write the same files. */
static int make_names(hada_cli *cli, int count, const char **paths, char **names)
{
    for (int i = 0; i < count; i++) {
        names[i] = hada_cli_stem(paths[i]);
        for (int k = 0; names[i] && k < i; k++)
            if (!strcmp(names[i], names[k]))
                return hada_cli_usage(cli,
                                      "%s and %s would both write %s_stack.tif; reconstruct them into different "
                                      "folders",
                                      paths[k], paths[i], names[i]);
    }
    return HADA_EXIT_OK;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    const settings *set = user;
    hada_error err = {0};
    job work = {.cli = cli, .set = set};
    if (!count)
        return hada_cli_usage(cli, "name at least one raw frame");
    if (!set->model)
        return hada_cli_usage(cli, "say which camera took the frames, with -m MODEL ('hadalens fit' makes one)");
    if (!set->output)
        return hada_cli_usage(cli, "say where the results shall go, with -o FOLDER");
    if (!(set->gamma > 0) || !(set->white > 0))
        return hada_cli_usage(cli, "--gamma and --white must be greater than zero");
    if (!(set->max_error >= 0 && set->max_error < 1) || !(set->band > 0 && set->band <= 1))
        return hada_cli_usage(cli, "--max-error takes 0 to below 1, --band a share above 0 and at most 1");
    char **names = calloc((size_t)count, sizeof *names);
    int code = names ? make_names(cli, count, arguments, names) : HADA_EXIT_MEMORY;
    if (!code)
        code = prepare(&work, &err) ? hada_cli_fail(cli, &err) : run_files(&work, count, arguments, names);
    for (int i = 0; names && i < count; i++)
        free(names[i]);
    free(names);
    hada_plan_destroy(&work.plan);
    hada_model_destroy(&work.model);
    hada_cli_close_all(cli, &work.devices);
    hada_cli_dark_free(&work.dark);
    free(work.depths);
    free(work.occupied);
    return code;
}

static const hada_cli_example examples[] = {
    {"hadalens reconstruct frame.tif -m camera.model -o pictures", "one frame, everything automatic."},
    {"hadalens reconstruct *.tif -m camera.model -o pictures --refine 0", "many frames, quickly."},
    {"hadalens reconstruct hand.tif -m hand.model -o pictures --dark auto --bits 16", "a sensor with an offset."},
    {"hadalens reconstruct frame.tif -m camera.model -o pictures --occupied 100mm,250mm", "when the depths are known."},
    {"hadalens reconstruct frame.tif -m camera.model -o pictures --method admm --tv 0.005", "what others use."},
    {"hadalens reconstruct movie.tif -m camera.model -o pictures --device 0,1 --queues 2", "on two devices at once."},
    {0},
};

const hada_cli_command hada_cli_reconstruct = {
    .name = "reconstruct",
    .summary = "turn raw frames into refocused stacks, all-in-focus images and distance maps",
    .synopsis = "RAW.tif... -m MODEL -o FOLDER [OPTION...]",
    .description =
        "For each NAME.tif it writes NAME_stack.tif (a refocused image per depth, near to far, as ImageJ hyperstack "
        "with the distances), NAME_aif.tif (everything in focus), NAME_depth.tif (distances in millimetres, NaN where "
        "nothing is in focus) and NAME_preview.png, a sheet to look at.\n\n"
        "A file of many pages is a sequence: its results have as many frames, and memory does not grow with them; the "
        "preview shows the first. A file that cannot be done is reported and does not stop the others. Results appear "
        "under their names when they are whole, so nothing half-written is left.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .defaults = defaults,
    .run = run,
    .uses_device = 1,
};
