#include "option.h"
#include "reconstruct.h"
#include "shared.h"

#include <hadalens/dataset.h>
#include <hadalens/job.h>
#include <hadalens/response.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { NOT_GIVEN = -2 }; /* steps of refinement */

typedef struct settings {
    hada_cli_common common;
    hada_plan_options plan;
    hada_files_task task;
    const char *model, *depths, *occupied, *dark, *flat, *weights, *skip, *encoding, *frame_encoding;
    double fps; /* 0: not given */
    int no_enhance, no_preview, strict, bracket;
    hada_cli_method_settings method;
    hada_cli_watch_settings watch;
} settings;

#define AT(member)          HADA_CLI_AT(settings, member)
#define ONE_OF(member, ...) HADA_CLI_ONE_OF(settings, member, __VA_ARGS__)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("Input and output"),
    {HADA_OPTION_TEXT, "model", 'm', "MODEL", "the camera, from 'hadalens fit'", NULL, AT(model)},
    {HADA_OPTION_TARGET, "output", 'o', "FOLDER", "where the results go; made when missing", NULL, AT(task.output)},
    {HADA_OPTION_CHOICE, "format", 0, "tiff|npy", "files of stack, all-in-focus image and maps (default: tiff)",
     "npy: NumPy arrays NAME_stack.npy (frames, depths, rows, cols, channels), NAME_aif.npy and others (frames, rows, cols, "
     "channels), without metadata. For pictures see --png.",
     HADA_CLI_ONE_OF(settings, task.format, HADA_FILES_TIFF, HADA_FILES_NUMPY)},
    {HADA_OPTION_CHOICE, "bits", 0, "8|16|32", "bits per value of stack and all-in-focus image (default: 32, float)",
     "8 and 16 bits hold 0 to 1 (see --white) and cut off what is beyond. The distance map is always float.",
     ONE_OF(task.bits, 8, 16, 32)},
    {HADA_OPTION_REAL, "white", 0, "VALUE", "value that becomes full scale in 8 and 16 bits (default: 1)", NULL,
     AT(task.white)},
    {HADA_OPTION_REAL, "gamma", 0, "G", "exponent on the finished images, instead of an encoding (default: 1, none)",
     NULL, AT(plan.gamma)},
    {HADA_OPTION_TEXT, "encoding", 0, "scene|linear|srgb|P", "how values stand for light (default: scene)",
     "scene: as those of the scenes that the model was learned from, which results then compare with. linear: light. "
     "srgb, or a power P such as 2.2: for a display. The metadata say which; distance maps have none.",
     AT(encoding)},
    {HADA_OPTION_TEXT, "frame-encoding", 0, "auto|linear|srgb|P",
     "how the frames' values stand for light (default: auto)",
     "auto: as the file says, which is sRGB for JPEG files, or as the model knows of its pairs, or linear. srgb: for "
     "other files that a camera has encoded for a display.",
     AT(frame_encoding)},
    {HADA_OPTION_REAL, "pixel-um", 0, "UM", "size of a pixel in the scene, in micrometres (default: not known)",
     "Stated in the TIFF files, so that ImageJ and others show volumes to scale.", AT(task.pixel_um)},
    {HADA_OPTION_FLAG, "no-preview", 0, NULL, "write no NAME_preview.png", NULL, AT(no_preview)},
    {HADA_OPTION_FLAG, "png", 0, NULL, "also write NAME_aif.png, the all-in-focus image for a display",
     "In sRGB and 8 bits; white is the brightness that one pixel in a thousand exceeds. Of a sequence the first frame.",
     AT(task.picture)},
    {HADA_OPTION_FLAG, "emitters", 0, NULL, "also write NAME_emitters.csv: points of light, with standard deviations",
     "Scenes are taken for volumes, and emitters are fitted to the frame at any place between pixels and depths. For "
     "cameras of one channel. Those of a file of many pages are joined to tracks, in NAME_tracks.csv.",
     AT(task.emitters)},
    {HADA_OPTION_REAL, "track-pixels", 0, "P", "emitters move at most so many pixels from frame to frame (default: 2)",
     "Beside that, three standard deviations of their places.", AT(task.track_pixels)},
    {HADA_OPTION_REAL, "track-depths", 0, "D", "and at most so many depths (default: 2.5)", NULL,
     AT(task.track_depths)},
    {HADA_OPTION_COUNT, "track-gap", 0, "N", "tracks go on after N frames without their emitter (default: 2)", NULL,
     AT(task.track_gap)},
    {HADA_OPTION_FLAG, "resume", 0, NULL, "pass over files whose results are in the folder already",
     "For going on after an interruption. Results count if they are whole, made from this frame and model, and not older.",
     AT(task.resume)},
    {HADA_OPTION_FLAG, "strict", 0, NULL, "exit code 8 where the camera does not belong to a frame",
     "Each file's first frame is compared, not that of the first file alone; results are written.", AT(strict)},
    {HADA_OPTION_TEXT, "watch", 0, "FOLDER|-", "reconstruct frames as they come, the newest first, until Ctrl-C",
     "FOLDER: files that appear in it, older ones when there is time. -: frames from a pipe, as --headerless says; those "
     "before the newest are left out.",
     AT(watch.watch)},
    {HADA_OPTION_CHOICE, "stream", 0, "mjpeg|rgb24",
     "with --watch: all-in-focus images for a display, to standard output",
     "mjpeg: for 'ffplay -f mjpeg -'. rgb24: bytes red, green, blue of the window's pixels. -o may be left out then; "
     "frames older than the newest are left out in that case.",
     ONE_OF(watch.stream, HADA_LIVE_STREAM_MJPEG, HADA_LIVE_STREAM_RGB24)},
    {HADA_OPTION_REAL, "idle", 0, "S", "with --watch: end when nothing has come for S seconds (default: never)", NULL,
     AT(watch.idle)},

    HADA_CLI_GROUP("Reconstruction"),
    {HADA_OPTION_TEXT, "depths", 0, "LIST", "depths to compute (default: all)",
     "Slices counted from 1 (near), such as 1,3-5, or distances, such as 100mm,250mm.", AT(depths)},
    {HADA_OPTION_TEXT, "occupied", 0, "auto|all|LIST", "depths at which the scene has something (default: auto)",
     "auto finds the few depths that explain the frame; the others are dark then. LIST as for --depths.", AT(occupied)},
    {HADA_OPTION_CHOICE, "scene", 0, "auto|planes|surface|volume", "what a scene is taken for (default: auto)",
     "planes: objects at some of the depths. surface: one texture at a distance that changes from pixel to pixel, between "
     "the depths too. volume: light at all depths, such as that of emitters. auto: what explains the frame with the fewest "
     "unknowns.",
     ONE_OF(plan.scene, HADA_SCENE_AUTO, HADA_SCENE_PLANES, HADA_SCENE_SURFACE, HADA_SCENE_VOLUME)},
    {HADA_OPTION_PASSES, "refine", 0, "N|auto|0", "refinement steps on the occupied depths (default: auto)",
     "auto takes what the fit measured to pay for this camera, and more where several depths have not parted by then. 0: "
     "the linear filters alone, the quickest; the default with --method matched.",
     AT(plan.refine)},
    {HADA_OPTION_WEIGHT, "refine-tv", 0, "W|auto|frame|0", "weight of total variation in refinement (default: auto)",
     "More is smoother. auto takes what the fit measured to pay, which goes with the noise, and for a model from a PSF "
     "finds it from the frame, and keeps it for the file's others of the same noise and light. frame finds it from each "
     "frame: the weight with which the other pixels predict 5 % of them best.",
     AT(plan.refine_tv)},
    {HADA_OPTION_WEIGHT, "refine-colour", 0, "K|auto",
     "in total variation, how much heavier differences of colour are (default: auto)",
     "1 to 16. auto takes what the fit measured to pay; more takes more of colour noise and of colour.",
     ONE_OF(plan.refine_colour, 1, 16)},
    {HADA_OPTION_WEIGHT, "refine-ridge", 0, "S|auto|0",
     "with total variation: strength of the learned regulariser in the last steps (default: auto)",
     "The last steps use filters that were learned from photographs, in place of total variation. S scales the noise that "
     "they take off. auto takes what the fit measured to pay.",
     ONE_OF(plan.refine_ridge, 0, 100)},
    {HADA_OPTION_WEIGHT, "crosstalk", 0, "K|auto|0",
     "share of another depth's light at which refined planes fade (default: auto)",
     "Refinement leaves a few hundredths of the light of one depth in the planes of others. Around a pixel, a plane that "
     "has K of the brightest one's light keeps half, and what it loses goes there. auto: 0.12; 0: planes stay as refined.",
     ONE_OF(plan.crosstalk, 0, 1)},
    {HADA_OPTION_TEXT, "dark", 0, "FILE|auto|none|LEVEL", "dark level of the frames (default: what the model says)",
     "FILE: a dark frame of the camera; auto: each frame's own; LEVEL: a share of full scale.", AT(dark)},
    {HADA_OPTION_TEXT, "flat", 0, "FILE", "divide frames by a flat frame (default: the model's, where it has one)",
     "A frame of the camera's sensor evenly lit, without a mask. --dark is taken off both.", AT(flat)},
    {HADA_OPTION_TEXT, "weights", 0, "FILE",
     "how much each pixel of the frames counts in refinement, rl, fista and admm (default: all alike)",
     "An image of the frame's size, grey or in its colours: black where pixels are bad or covered by dust, white where "
     "they are good; brightness is in units of the largest value.",
     AT(weights)},
    {HADA_OPTION_CHOICE, "bayer", 0, "auto|none|rggb|bggr|grbg|gbrg",
     "colour filter mosaic of frames of one channel (default: auto)",
     "The colours of the first two rows and columns. Each pixel is compared with the colour that it holds; nothing is "
     "demosaiced. auto: what the model says.",
     ONE_OF(plan.mosaic, HADA_MOSAIC_AUTO, HADA_MOSAIC_NONE, HADA_MOSAIC_RGGB, HADA_MOSAIC_BGGR, HADA_MOSAIC_GRBG,
            HADA_MOSAIC_GBRG)},
    {HADA_OPTION_FLAG, "bracket", 0, NULL, "the files are exposures of one scene, to merge into one frame",
     "Their lengths are found from them. Saturated pixels of longer ones are taken from shorter ones.", AT(bracket)},
    {HADA_OPTION_COUNT, "downsample", 0, "N",
     "make pixels of N x N pixels of larger frames (default: as the model does)",
     "The dark and flat frame and the weights may be as large.", AT(plan.downsample)},
    {HADA_OPTION_FLAG, "repair", 0, NULL, "fill NaN and infinite pixels from their neighbours",
     "Without it such a frame is refused.", AT(plan.repair_not_finite)},
    {HADA_OPTION_FLAG, "warm", 0, NULL, "the frames are a sequence: refinement goes on from the frame before",
     "In the order of the files and of their pages. Takes fewer steps the less changes; begins anew where the scene is "
     "another one. One queue of the first device does it.",
     AT(plan.warm_start)},
    {HADA_OPTION_REAL, "fps", 0, "N", "take as many refinement steps as keep up with N frames a second (default: all)",
     "Found on the first five frames, so it depends on how fast the machine is. It says what it found and how much that "
     "changes the planes; --refine with that number gives the same results anywhere.",
     AT(fps)},
    {HADA_OPTION_FLAG, "no-enhance", 0, NULL, "leave out the net that the model holds", NULL, AT(no_enhance)},
    {HADA_OPTION_FLAG, "half", 0, NULL, "keep the filters in half precision on the device", NULL, AT(plan.half)},
    {HADA_OPTION_REAL, "max-error", 0, "E", "relative change of the stack that may be traded for time (default: 0)",
     "Root of the sum of squares over all pixels, such as 0.01. Acts with --refine 0; each frame says what was "
     "skipped and how much it may have changed.",
     AT(plan.max_error)},
    {HADA_OPTION_TEXT, "skip", 0, "all|none|LIST", "what may be skipped where a scene does not need it (default: all)",
     "LIST of prune, depths, frequencies, half, channels, frames, tiles. Without --max-error only what is exact.",
     AT(skip)},
    {HADA_OPTION_REAL, "band", 0, "B", "share of the sensor's Nyquist frequency that is used (default: 1)",
     "With --refine 0, for optics that resolve less than the sensor: 0.7 leaves half of the frequencies.",
     AT(plan.band)},
    {HADA_OPTION_COUNT, "batch", 0, "N", "depths computed at once (default: by memory)", NULL, AT(plan.batch)},
    {HADA_OPTION_COUNT, "queues", 0, "N", "frames at once on each device (default: 1)",
     "With two, the transfers of one frame overlap with computing another; each takes memory of its own. For several "
     "devices give a list of them, such as 0,1, or cpu/2 for the CPU in two halves.",
     AT(plan.queues)},

    HADA_CLI_GROUP("Other methods, on the model's transfer functions"),
    {HADA_OPTION_CHOICE, "method", 0, "hadamard|matched|wiener|rl|fista|admm", "what to do (default: hadamard)",
     "hadamard: the model's own filters, then --refine. matched: the transposed optics. wiener: the linear filter for "
     "all depths jointly. rl (Richardson-Lucy), fista and admm iterate, without --refine and without looking for the "
     "occupied depths: all of --depths, or those of --occupied.",
     ONE_OF(method.method, HADA_METHOD_MODEL, HADA_CLI_MATCHED, HADA_METHOD_WIENER, HADA_METHOD_RL, HADA_METHOD_FISTA,
            HADA_METHOD_ADMM)},
    {HADA_OPTION_COUNT, "iterations", 0, "N", "iterations at most (default: 100)", NULL, AT(method.iterations)},
    {HADA_OPTION_REAL, "stop", 0, "R", "stop when the planes change by less than this share, twice (default: never)",
     NULL, AT(method.stop)},
    {HADA_OPTION_REAL, "seconds", 0, "S", "stop after so much time for a frame (default: never)",
     "The result then depends on how fast the machine is.", AT(method.seconds)},
    {HADA_OPTION_CHOICE, "prior", 0, "none|tv|wavelet|haar", "beside non-negativity (default: admm tv, else none)",
     "tv: total variation. For fista also Haar wavelets, translation-invariant (wavelet) or orthonormal (haar).",
     ONE_OF(method.prior, HADA_PRIOR_NONE, HADA_PRIOR_TV, HADA_PRIOR_WAVELET, HADA_PRIOR_HAAR)},
    {HADA_OPTION_WEIGHT, "weight", 0, "W|auto", "weight of the prior (default: auto)",
     "auto: admm and fista with tv find the weight from each frame: the one with which the other pixels predict 5 % of "
     "them best. That takes up to 2.5 times the iterations again. rl and wavelet 0.005, haar 0.003.",
     AT(method.weight)},
    {HADA_OPTION_WEIGHT, "tv", 0, "W|auto", "the same as --prior tv --weight W", NULL, AT(method.tv)},
    {HADA_OPTION_CHOICE, "support", 0, "window|grid", "where light may come from (default: by method and model)",
     "grid: from outside the window, too; the default of admm, and where a measured PSF's window is the whole frame.",
     ONE_OF(plan.support, HADA_SUPPORT_WINDOW, HADA_SUPPORT_GRID)},
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
    set->encoding = "scene";
    set->frame_encoding = "auto";
    set->skip = "all";
    hada_plan_options_init(&set->plan);
    set->plan.refine = NOT_GIVEN;
    hada_files_task_init(&set->task);
    hada_cli_method_defaults(&set->method);
}

/* What stays the same over all files. */
typedef struct job {
    hada_cli *cli;
    const settings *set;
    hada_cli_contexts devices;
    hada_model *model;
    hada_plan *plan;
    hada_plan_options options;
    hada_classic_options classic;
    hada_cli_dark dark;
    hada_image weights, flat, merged; /* of pixels; a bracket's frame */
    const char **paths;
    int files, *depths, *occupied;
    double encoding, frame_encoding;
} job;

static hada_status read_depths(job *work, hada_error *err)
{
    const settings *set = work->set;
    const hada_model_info *info = hada_model_get_info(work->model);
    hada_plan_options *plan = &work->options;
    work->depths = hada_cli_memory((size_t)info->depths, sizeof *work->depths);
    work->occupied = hada_cli_memory((size_t)info->depths, sizeof *work->occupied);
    if (set->depths) {
        HADA_TRY(hada_cli_read_depths("depths", set->depths, info->distances_mm, info->depths, work->depths,
                                      &plan->depth_count, err));
        plan->depths = work->depths;
    }
    if (strcmp(set->occupied, "auto"))
        plan->occupied = strcmp(set->occupied, "all") ? HADA_OCCUPIED_LIST : HADA_OCCUPIED_ALL;
    if (plan->occupied == HADA_OCCUPIED_LIST) {
        plan->occupied_list = work->occupied;
        HADA_TRY(hada_cli_read_depths("occupied", set->occupied, info->distances_mm, info->depths, work->occupied,
                                      &plan->occupied_count, err));
    }
    return HADA_OK;
}

static hada_status read_options(job *work, hada_error *err)
{
    const settings *set = work->set;
    hada_plan_options *plan = &work->options;
    *plan = set->plan;
    if (set->task.emitters && plan->scene == HADA_SCENE_AUTO)
        plan->scene = HADA_SCENE_VOLUME;
    if (set->task.emitters && plan->scene != HADA_SCENE_VOLUME)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                              "--emitters are those of a volume: leave --scene out, or take --scene volume");
    /* the transposed optics are a way of their own: refinement would take their place */
    if (plan->refine == NOT_GIVEN)
        plan->refine = set->method.method == HADA_CLI_MATCHED ? 0 : HADA_AUTO;
    hada_classic_options_init(&work->classic);
    HADA_TRY(read_depths(work, err));
    if (set->dark) {
        HADA_TRY(hada_cli_read_dark(&work->dark, set->dark, err));
        plan->dark = work->dark.kind;
        plan->dark_level = work->dark.level;
        plan->dark_frame = work->dark.kind == HADA_DARK_FRAME ? &work->dark.frame : NULL;
    }
    HADA_TRY(hada_cli_read_flat(&work->flat, set->flat, set->dark, err));
    plan->flat_frame = set->flat ? &work->flat : NULL;
    if (set->weights) {
        HADA_TRY(hada_dark_frame_load(&work->weights, NULL, set->weights, err));
        plan->pixel_weights = &work->weights;
    }
    HADA_TRY(hada_cli_read_skip(set->skip, &plan->skip, err));
    HADA_TRY(hada_cli_read_method(&set->method, &work->classic, err));
    work->classic.support = plan->support;
    /* several files are no sequence: each frame finds the weight that it wants */
    if (work->files > 1 && !set->bracket && !plan->warm_start && plan->refine_tv == HADA_AUTO &&
        (work->classic.method || hada_model_get_info(work->model)->refine_tv == HADA_AUTO))
        plan->refine_tv = HADA_REFINE_TV_FRAME;
    plan->classic = &work->classic;
    plan->enhance = !set->no_enhance;
    return HADA_OK;
}

/* Linear filters take no weights. */
static int is_linear(const job *work)
{
    const int steps =
        work->options.refine == HADA_AUTO ? hada_model_get_info(work->model)->refine_steps : work->options.refine;
    return work->classic.method == HADA_METHOD_MODEL ? !steps : work->classic.method == HADA_METHOD_WIENER;
}

static hada_status merge_bracket(job *work, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(work->model);
    const hada_mosaic known = info->sensor_mosaic ? info->sensor_mosaic : info->mosaic;
    const hada_mosaic mosaic = work->options.mosaic == HADA_MOSAIC_AUTO ? known : work->options.mosaic;
    const int told = work->frame_encoding != HADA_AUTO || info->frame_encoding == 0.0;
    HADA_TRY(hada_exposures_load(&work->merged, &work->weights, work->paths, work->files,
                                 told ? work->frame_encoding : info->frame_encoding, mosaic, &work->cli->monitor, err));
    const double tv = work->options.refine_tv == HADA_AUTO ? info->refine_tv : work->options.refine_tv;
    if (work->classic.method ||
        tv < 0) /* which is found from the frame: with weights that differ less it is found better */
        for (size_t i = 0; i < hada_image_count(&work->weights); i++)
            work->weights.data[i] = (float)pow(work->weights.data[i], 0.25);
    work->options.pixel_weights = is_linear(work) ? NULL : &work->weights;
    return HADA_OK;
}

/* matched in place of the model's own filters. */
static hada_status change_form(job *work, hada_error *err)
{
    hada_model *other = NULL;
    if (work->set->method.method != HADA_CLI_MATCHED)
        return HADA_OK;
    HADA_TRY(hada_model_with_form(&other, work->model, HADA_FORM_MATCHED, 0, err));
    hada_model_destroy(&work->model);
    work->model = other;
    return HADA_OK;
}

static void tell_memory(const job *work, uint64_t device, uint64_t host)
{
    char device_text[16], host_text[16];
    hada_cli_detail(work->cli, "this takes %s on the device and %s of ordinary memory",
                    hada_cli_bytes(device_text, device), hada_cli_bytes(host_text, host));
    json_object_set_new(work->cli->document, "memory",
                        json_pack("{s:I, s:I}", "device_bytes", (json_int_t)device, "host_bytes", (json_int_t)host));
}

static hada_status make_plan(job *work, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(work->model);
    const uint64_t raw = 4 * (uint64_t)info->channels * (uint64_t)info->raw_rows * (uint64_t)info->raw_cols;
    uint64_t all = 0, device = 0, host = 0;
    for (int i = 0; i < work->devices.count; i++) {
        HADA_TRY(hada_plan_estimate(work->devices.contexts[i], work->model, &work->options, &device, &host, err));
        all += device;
    }
    HADA_TRY(hada_plan_create_on(&work->plan, work->devices.contexts, work->devices.count, work->model, &work->options,
                                 err));
    tell_memory(work, all, (uint64_t)hada_files_ahead(work->plan) * (host + raw));
    return HADA_OK;
}

/* As many steps of refinement as keep up with --fps, and what they cost. */
static hada_status keep_up(job *work, hada_error *err)
{
    const double fps = work->set->fps;
    hada_files_task task = work->set->task;
    hada_pace pace = {.size = sizeof pace};
    char text[160];
    if (!(fps > 0.0))
        return HADA_OK;
    task.frame_encoding = work->frame_encoding;
    task.monitor = &work->cli->monitor;
    HADA_TRY(hada_files_pace(&pace, work->devices.contexts, work->devices.count, work->model, &work->options,
                             work->paths, work->files, &task, fps, err));
    if (pace.steps == work->options.refine)
        snprintf(text, sizeof text, "%.3g s a frame with all steps of refinement", pace.seconds);
    else
        snprintf(text, sizeof text, "%.3g s a frame with --refine %d (%.3g s with all steps): planes change by %.2g %%",
                 pace.seconds, pace.steps, pace.seconds_whole, 100.0 * pace.change);
    if (pace.seconds > 1.0 / fps)
        hada_cli_warn(work->cli, "%g frames a second are too many (--refine 0 takes the least time): %s", fps, text);
    else
        hada_cli_say(work->cli, "%s", text);
    json_object_set_new(work->cli->document, "pace",
                        json_pack("{s:f, s:i, s:f, s:f, s:f}", "fps", fps, "refine", pace.steps, "seconds",
                                  pace.seconds, "seconds_whole", pace.seconds_whole, "change", pace.change));
    work->options.refine = pace.steps;
    return HADA_OK;
}

static hada_status prepare(job *work, hada_error *err)
{
    const char *encoding = work->set->encoding;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_response_from_name(&work->encoding, strcmp(encoding, "scene") ? encoding : "auto", err));
    HADA_TRY_OR_DONE(hada_response_from_name(&work->frame_encoding, work->set->frame_encoding, err));
    HADA_TRY_OR_DONE(hada_model_load(&work->model, work->set->model, err));
    HADA_TRY_OR_DONE(change_form(work, err));
    HADA_TRY_OR_DONE(read_options(work, err));
    if (work->set->bracket)
        HADA_TRY_OR_DONE(merge_bracket(work, err));
    HADA_TRY_OR_DONE(hada_cli_open_all(work->cli, &work->devices, err));
    HADA_TRY_OR_DONE(keep_up(work, err));
    HADA_TRY_OR_DONE(make_plan(work, err));
done:
    if (status && status != HADA_ERROR_ARGUMENT && !work->model)
        hada_cli_prefix(err, "%s: ", work->set->model);
    return status;
}

/* The exit code. */
static int run_files(job *work, int count, const char **paths)
{
    hada_error err = {0};
    const settings *set = work->set;
    hada_files_task task = set->task;
    hada_cli_files_listener listener = {.cli = work->cli, .before = hada_cli_seconds()};
    task.preview = task.output && !set->no_preview && hada_cli_pictures(work->cli);
    task.encoding = work->encoding;
    task.frame_encoding = work->frame_encoding;
    if (set->watch.watch)
        return hada_cli_watch(work->cli, &set->watch, work->plan, work->model, &task);
    task.tell = hada_cli_files_tell;
    task.user = &listener;
    task.monitor = &work->cli->monitor;
    json_object_set_new(work->cli->document, "files", json_array());
    task.frame = set->bracket ? &work->merged : NULL;
    task.match = set->strict ? HADA_FILES_MATCH_EACH : HADA_FILES_MATCH_FIRST;
    task.communicator = hada_cli_communicator(work->cli);
    const hada_status status = hada_reconstruct_files(work->plan, work->model, paths, count, &task, NULL, &err);
    if (status == HADA_ERROR_CANCELLED) {
        hada_cli_let_first_speak(work->cli);
        hada_cli_print_error(work->cli, &err);
        return HADA_EXIT_INTERRUPTED;
    }
    const long failed = status ? listener.failed : hada_cli_sum(work->cli, listener.failed);
    if (failed && count > 1 && hada_cli_writes(work->cli))
        fprintf(stderr, "hadalens %s: %ld of %d files failed\n", work->cli->command, failed, count);
    if (status)
        return hada_cli_fail(work->cli, &err);
    hada_cli_gather(work->cli, "files");
    const int strange = set->strict && !failed && listener.strange;
    return hada_cli_agree(work->cli, strange ? HADA_EXIT_STRANGE : listener.code);
}

static int check(hada_cli *cli, const settings *set, int count)
{
    const int watches = hada_cli_check_watch(cli, &set->watch, count, set->task.output,
                                             set->bracket || set->task.resume || set->strict);
    if (watches)
        return watches;
    if (!count && !set->watch.watch)
        return hada_cli_usage(cli, "name at least one raw frame");
    if (!set->model)
        return hada_cli_usage(cli, "say which camera took the frames, with -m MODEL ('hadalens fit' makes one)");
    if (!set->task.output && !set->watch.watch)
        return hada_cli_usage(cli, "say where the results shall go, with -o FOLDER");
    if (set->fps > 0.0 && (set->watch.watch || set->bracket || set->method.method || cli->ranks))
        return hada_cli_usage(cli,
                              "--fps tries refinement on the first frames of files, on one machine; say the steps with "
                              "--refine instead");
    if (set->bracket && set->weights)
        return hada_cli_usage(cli, "--bracket has weights of its own; leave --weights out");
    if (!(set->plan.gamma > 0) || !(set->task.white > 0))
        return hada_cli_usage(cli, "--gamma and --white must be greater than zero");
    return HADA_EXIT_OK;
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    hada_error err = {0};
    job work = {.cli = cli, .set = user, .paths = arguments, .files = count};
    int code = check(cli, user, count);
    if (!code)
        code = prepare(&work, &err) ? hada_cli_fail(cli, &err)
                                    : run_files(&work, work.set->bracket ? 1 : count, arguments);
    hada_plan_destroy(&work.plan);
    hada_model_destroy(&work.model);
    hada_cli_close_all(cli, &work.devices);
    hada_cli_dark_free(&work.dark);
    hada_image_destroy(&work.weights);
    hada_image_destroy(&work.flat);
    hada_image_destroy(&work.merged);
    free(work.depths);
    free(work.occupied);
    return code;
}

static const hada_cli_example examples[] = {
    {"hadalens reconstruct frame.tif -m camera.model -o pictures", "one frame, everything automatic."},
    {"hadalens reconstruct *.tif -m camera.model -o pictures --refine 0", "many frames, quickly."},
    {"hadalens reconstruct hand.tif -m hand.model -o pictures --dark dark.tif --bits 16",
     "a sensor with an offset: its dark frame."},
    {"hadalens reconstruct frame.tif -m camera.model -o pictures --occupied 100mm,250mm", "when the depths are known."},
    {"hadalens reconstruct frame.tif -m camera.model -o pictures --method admm --tv 0.005", "what others use."},
    {"hadalens reconstruct movie.tif -m camera.model -o pictures --device 0,1 --queues 2", "on two devices at once."},
    {"rpicam-raw -t 0 -o - | hadalens reconstruct --watch - --headerless 1080x1920:csi10 -m camera.model --stream mjpeg | "
     "ffplay -f mjpeg -",
     "what a camera sees now."},
    {0},
};

const hada_cli_command hada_cli_reconstruct = {
    .name = "reconstruct",
    .summary = "turn raw frames into refocused stacks, all-in-focus images and distance maps",
    .synopsis = "RAW.tif... -m MODEL -o FOLDER [OPTION...] | --watch FOLDER|- -m MODEL [OPTION...]",
    .description =
        "For each NAME.tif it writes NAME_stack.tif (a refocused image per depth, near to far, as ImageJ hyperstack "
        "with the distances), NAME_aif.tif (everything in focus), NAME_depth.tif (of several depths: millimetres, NaN where "
        "nothing is in focus) and NAME_preview.png, a sheet to look at; of a surface also NAME_confidence.tif, 0 to 1, how "
        "sure each distance is.\n\n"
        "A file of many pages is a sequence: its results have as many frames, and memory does not grow with them; the "
        "preview shows the first. A file that cannot be done is reported and does not stop the others. Results appear "
        "under their names when they are whole, so nothing half-written is left.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .defaults = defaults,
    .run = run,
    .uses_device = 1,
    .shared = 1,
};
