#include "option.h"
#include "shared.h"

#include <hadalens/task_simulate.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

typedef struct settings {
    hada_cli_sensor_settings frame;
    hada_simulate_task task;
    const char *output, *scenes, *response;
    double field_varying;
} settings;

#define AT(member) HADA_CLI_AT(settings, member)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("What to write"),
    {HADA_OPTION_TARGET, "output", 'o', "DATASET", "the folder to make", "It must not exist yet, or be empty.",
     AT(output)},
    {HADA_OPTION_TEXT, "scenes", 0, "FOLDER|procedural", "pictures to show to the camera (default: procedural)",
     "A folder of TIFF pictures of any size, cut and scaled to the window; or coloured shapes drawn from the seed.",
     AT(scenes)},
    {HADA_OPTION_COUNT, "pairs", 0, "N", "pairs of raw frame and scene per depth (default: 8)", NULL, AT(task.pairs)},
    {HADA_OPTION_COUNT, "test", 0, "N", "test frames whose scene stands at several depths (default: 0)",
     "Written to DATASET/test: raw/NAME.tif, and as truth NAME_stack.tif, NAME_aif.tif and NAME_depth.tif, as "
     "'reconstruct' names its results.",
     AT(task.tests)},
    {HADA_OPTION_COUNT, "test-depths", 0, "N", "depths that a test frame occupies (default: 2)", NULL,
     AT(task.test_depths)},
    {HADA_OPTION_TEXT, "test-scenes", 0, "FOLDER", "pictures for the test frames",
     "Without it they are taken from the end of --scenes, and not used for pairs where there are enough.",
     AT(task.test_scenes)},
    {HADA_OPTION_TEXT, "surface", 0, "KIND|MAP.tif[,...]", "test scenes on surfaces, every pixel at its own distance",
     "slant, half (as slant, over half of the range), hill, ball, steps, bars; outside (a slant beyond the nearest and "
     "the farthest depth), overlap (two see-through pictures, one behind the other); or a file of distances: floats in "
     "millimetres, integers as shares of the range of depths. The kinds take turns; without --test there is one frame "
     "of each. With --occlude near parts hide what is behind them.",
     AT(task.surfaces)},
    {HADA_OPTION_REAL, "field-varying", 0, "S", "PSFs that vary over the field, of correlation S from middle to corner",
     "An aberration that grows with the square of the field angle, another one for each part of the mask. Frames are "
     "made with the PSF of every point; needs --boundary padded.",
     AT(field_varying)},
    {HADA_OPTION_COUNT, "field-psfs", 0, "N", "with it: write the PSFs of N x N points (default: 5)",
     "DATASET/field: a stack for each, and positions.csv, the list that 'fit --psf' reads. 0: none.",
     AT(task.field_psfs)},
    {HADA_OPTION_TEXT, "scene-response", 0, "linear|srgb|POWER", "how the pictures stand for light (default: linear)",
     "srgb or a power such as 2.2: as photographs mostly are. The frames are made of the light, the scenes and the truth "
     "are written as the pictures are.",
     AT(response)},
    {HADA_OPTION_CHOICE, "bayer", 0, "none|rggb|bggr|grbg|gbrg", "colour filter mosaic of the sensor (default: none)",
     "Raw frames have one channel then, whose pixels hold one colour each. The colours of the first two rows and columns.",
     HADA_CLI_ONE_OF(settings, task.mosaic, HADA_MOSAIC_NONE, HADA_MOSAIC_RGGB, HADA_MOSAIC_BGGR, HADA_MOSAIC_GRBG,
                     HADA_MOSAIC_GBRG)},
    {HADA_OPTION_CHOICE, "bits", 0, "16|32", "raw frames and scenes as 16-bit integers or floats (default: 32)",
     "A camera writes 16 bits; then noise below zero is cut off.", HADA_CLI_ONE_OF(settings, task.bits, 16, 32)},
    {HADA_OPTION_CHOICE, "raw", 0, "tiff|dng|npy|packed12", "files of the raw frames (default: tiff)",
     "As cameras and programs write them. dng: 16 bits, the dark level as black level. packed12: 12 bits packed as MIPI "
     "CSI-2 has it, in rows of whole 32 bytes, without a header; to be read with --headerless. Both for one channel, such "
     "as that of a mosaic.",
     HADA_CLI_ONE_OF(settings, task.raw, HADA_SIMULATE_RAW_TIFF, HADA_SIMULATE_RAW_DNG, HADA_SIMULATE_RAW_NUMPY,
                     HADA_SIMULATE_RAW_PACKED12)},
    {0},
};

static void defaults(void *user)
{
    settings *set = user;
    set->scenes = "procedural";
    set->response = "linear";
    hada_cli_sensor_defaults(&set->frame);
    hada_simulate_task_init(&set->task);
}

static int check(hada_cli *cli, const settings *set, int count, const char **arguments)
{
    if (count)
        return hada_cli_usage(cli, "'%s' is one word too many; a folder of pictures is given with --scenes",
                              arguments[0]);
    if (!set->output)
        return hada_cli_usage(cli, "say where the data set shall be written, with -o DATASET");
    if (!set->task.pairs || !set->task.test_depths)
        return hada_cli_usage(cli, "--%s must be at least 1", set->task.pairs ? "test-depths" : "pairs");
    return HADA_EXIT_OK;
}

static hada_status fill_task(const settings *set, hada_cli_sensor *sensor, hada_simulate_task *task, hada_error *err)
{
    sensor->options.field_varying = set->field_varying;
    *task = set->task;
    task->scenes = strcmp(set->scenes, "procedural") ? set->scenes : NULL;
    task->occlude = sensor->occlude;
    task->simulator = &sensor->options;
    task->noise = sensor->noise;
    task->sensor = sensor->used ? &sensor->sensor : NULL;
    task->white = sensor->auto_exposure ? HADA_CLI_WHITE : 0;
    return hada_response_from_name(&task->scene_response, set->response, err);
}

static void report_all(hada_cli *cli, const settings *set, const hada_camera *camera, double noise,
                       const hada_simulate_report *report, double seconds)
{
    char lenses[32] = "";
    if (camera->mask == HADA_MASK_MLA || camera->mask == HADA_MASK_GRID)
        snprintf(lenses, sizeof lenses, " of %d lenses", camera->lenses);
    hada_cli_say(cli,
                 "%s: %d %s from %g to %g mm, %d pair%s each, %dx%d %s frames, window %dx%d, mask %s%s, noise %g "
                 "(%.1f s)",
                 set->output, camera->depths, camera->depths == 1 ? "depth" : "depths", camera->distances_mm[0],
                 camera->distances_mm[camera->depths - 1], report->pairs, report->pairs == 1 ? "" : "s", camera->rows,
                 camera->cols, camera->channels == 1 ? "grey" : "colour", camera->window_rows, camera->window_cols,
                 hada_enum_name(HADA_ENUM_MASK, (int)camera->mask), lenses, noise, seconds);
    if (set->task.raw == HADA_SIMULATE_RAW_PACKED12)
        hada_cli_say(cli, "read the raw frames with --headerless %dx%d:csi12", camera->rows, camera->cols);
    if (report->light_lost > 0.001)
        hada_cli_say(cli, "%.1f %% of the window's light misses the sensor", 100 * report->light_lost);
    if (set->task.surfaces)
        hada_cli_say(cli, "%s/test: %d test frames on surfaces (%s), and their truth", set->output, report->tests,
                     set->task.surfaces);
    else if (set->task.tests)
        hada_cli_say(cli, "%s/test: %d test frames with %d occupied depths each, and their truth", set->output,
                     set->task.tests, report->test_depths);
    json_object_update_new(cli->document,
                           json_pack("{s:o, s:i, s:i, s:[ii], s:[ii], s:i, s:s, s:i, s:f, s:f}", "dataset",
                                     hada_cli_json_text(set->output), "pairs_per_depth", report->pairs, "tests",
                                     report->tests, "size", camera->rows, camera->cols, "window", camera->window_rows,
                                     camera->window_cols, "channels", camera->channels, "mask",
                                     hada_enum_name(HADA_ENUM_MASK, (int)camera->mask), "lenses", camera->lenses,
                                     "noise", noise, "seconds", seconds));
    json_object_set_new(cli->document, "light_lost", hada_cli_real(report->light_lost));
    if (!isnan(report->exposure))
        json_object_set_new(cli->document, "exposure", hada_cli_real(report->exposure));
    json_object_set_new(cli->document, "distances_mm", hada_cli_reals(camera->distances_mm, camera->depths));
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    const settings *set = user;
    hada_error err = {0};
    hada_context *context = NULL;
    hada_camera camera = {.size = sizeof camera};
    hada_cli_sensor sensor = {0};
    hada_simulate_task task;
    hada_simulate_report report = {.size = sizeof report};
    hada_status status = HADA_OK;
    const double start = hada_cli_seconds();
    const int wrong = check(cli, set, count, arguments);
    if (wrong)
        return wrong;
    HADA_TRY_OR_DONE(hada_cli_make_camera(&camera, &set->frame.camera, &err));
    HADA_TRY_OR_DONE(hada_cli_make_sensor(&sensor, &set->frame, &err));
    HADA_TRY_OR_DONE(fill_task(set, &sensor, &task, &err));
    task.monitor = &cli->monitor;
    HADA_TRY_OR_DONE(hada_cli_open(cli, &context, &err));
    HADA_TRY_OR_DONE(hada_simulate_run(context, &camera, set->output, &task, &report, &err));
    hada_cli_close(cli, &context);
    report_all(cli, set, &camera, sensor.noise, &report, hada_cli_seconds() - start);
done:
    hada_cli_close(cli, &context);
    hada_cli_sensor_free(&sensor);
    return status ? hada_cli_fail(cli, &err) : HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens simulate --preset sim300 --test 4 -o camera", "a small camera, drawn scenes, four test frames."},
    {"hadalens simulate --scenes photographs --depths 6 --near 50 --far 300 -o camera", "your own pictures."},
    {"hadalens simulate --preset sim300 --boundary padded --aperture 20 --surface slant,hill,steps -o camera",
     "three surfaces, and a sensor that loses light."},
    {"hadalens simulate --full-well 10000 --read-noise 5 --adc-bits 12 --dark 0.02 --bits 16 -o camera",
     "a sensor as one can buy it."},
    {0},
};

const hada_cli_command hada_cli_simulate = {
    .name = "simulate",
    .summary = "make the data set of a camera that exists only by design",
    .synopsis = "-o DATASET [--scenes FOLDER] [OPTION...]",
    .description =
        "Designs a lensless camera (a mask in front of a bare sensor), shows it pictures at each of its distances and "
        "writes what its sensor would record.\n\n"
        "DATASET is a folder with one folder per depth, named z<distance>mm, each with raw/NAME.tif (the frame) and "
        "scene/NAME.tif (the picture) of the same names. Beside them stand psf.tif, a page per depth with the "
        "camera's response to a point, and camera.json, the design. Captures of a real camera in the same folders "
        "serve as well.",
    .options = options,
    .examples = examples,
    .settings_size = sizeof(settings),
    .defaults = defaults,
    .run = run,
    .uses_device = 1,
    .designs_camera = 1,
    .records_frames = 1,
};
