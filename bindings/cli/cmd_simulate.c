#include "command.h"
#include "dataset_write.h"
#include "folder.h"
#include "sensor_options.h"

#include <errno.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef struct settings {
    hada_cli_sensor_settings frame;
    const char *output, *scenes, *test_scenes;
    int bits, pairs, test, test_depths;
} settings;

#define AT(member) HADA_CLI_AT(settings, member)
static const hada_cli_option options[] = {
    HADA_CLI_GROUP("What to write"),
    {HADA_OPTION_TEXT, "output", 'o', "DATASET", "the folder to make", "It must not exist yet, or be empty.",
     AT(output)},
    {HADA_OPTION_TEXT, "scenes", 0, "FOLDER|procedural", "pictures to show to the camera (default: procedural)",
     "A folder of TIFF pictures of any size, cut and scaled to the window; or coloured shapes drawn from the seed.",
     AT(scenes)},
    {HADA_OPTION_COUNT, "pairs", 0, "N", "pairs of raw frame and scene per depth (default: 8)", NULL, AT(pairs)},
    {HADA_OPTION_COUNT, "test", 0, "N", "test frames whose scene stands at several depths (default: 0)",
     "Written to DATASET/test: raw/NAME.tif, and as truth NAME_stack.tif, NAME_aif.tif and NAME_depth.tif, as "
     "'reconstruct' names its results.",
     AT(test)},
    {HADA_OPTION_COUNT, "test-depths", 0, "N", "depths that a test frame occupies (default: 2)", NULL, AT(test_depths)},
    {HADA_OPTION_TEXT, "test-scenes", 0, "FOLDER", "pictures for the test frames",
     "Without it they are taken from the end of --scenes, and not used for pairs where there are enough.",
     AT(test_scenes)},
    {HADA_OPTION_CHOICE, "bits", 0, "16|32", "raw frames and scenes as 16-bit integers or floats (default: 32)",
     "A camera writes 16 bits; then noise below zero is cut off.", AT(bits)},
    {0},
};

static void defaults(void *user)
{
    settings *set = user;
    set->scenes = "procedural";
    hada_cli_sensor_defaults(&set->frame);
    set->pairs = 8;
    set->test_depths = 2;
}

/* Opens the scenes and divides them between pairs and tests. */
static hada_status make_recipe(hada_cli *cli, hada_cli_recipe *recipe, const settings *set, const hada_camera *camera,
                               hada_error *err)
{
    recipe->pairs = set->pairs;
    recipe->seed = camera->seed;
    recipe->bits = set->bits == 1 ? 16 : 32;
    recipe->tests = set->test;
    recipe->test_depths = set->test_depths < camera->depths ? set->test_depths : camera->depths;
    const hada_simulator_options *wanted = &recipe->sensor->options;
    const int rows = wanted->field_rows ? wanted->field_rows : camera->window_rows,
              cols = wanted->field_rows ? wanted->field_cols : camera->window_cols;
    hada_status status =
        hada_cli_scenes_open(&recipe->scenes, set->scenes, camera->seed, camera->channels, rows, cols, err);
    if (!status && set->test_scenes) {
        status = hada_cli_scenes_open(&recipe->test_scenes, set->test_scenes, camera->seed + 1, camera->channels, rows,
                                      cols, err);
        recipe->other_test_scenes = !status;
    }
    if (status)
        return status;
    recipe->training_count = recipe->scenes.count;
    if (set->test && !set->test_scenes && recipe->scenes.folder) {
        if (recipe->scenes.count >= set->pairs + set->test)
            recipe->training_count = recipe->scenes.count - set->test;
        else
            hada_cli_warn(cli,
                          "%s holds %d pictures, too few to keep some for the tests alone: the tests show scenes "
                          "that the pairs show too",
                          set->scenes, recipe->scenes.count);
    }
    if (recipe->training_count < recipe->pairs) {
        hada_cli_warn(cli, "%s holds %d pictures: %d pairs per depth instead of %d", set->scenes,
                      recipe->training_count, recipe->training_count, recipe->pairs);
        recipe->pairs = recipe->training_count;
    }
    return HADA_OK;
}

static hada_status simulate(hada_cli *cli, const settings *set, const hada_camera *camera, hada_cli_recipe *recipe,
                            hada_error *err)
{
    hada_context *context = NULL;
    hada_simulator *simulator = NULL;
    hada_cli_progress progress;
    hada_status status = make_recipe(cli, recipe, set, camera, err);
    if (!status)
        status = hada_cli_open(cli, &context, err);
    if (!status)
        status = hada_simulator_create_with(&simulator, context, camera, &recipe->sensor->options, err);
    if (status == HADA_ERROR_SIZE) /* a field that does not fit: the command line's, not a file's */
        status = err->status = HADA_ERROR_ARGUMENT;
    if (!status && recipe->sensor->used && recipe->sensor->auto_exposure)
        status = hada_simulator_white_exposure(simulator, HADA_CLI_WHITE, &recipe->sensor->sensor.exposure, err);
    if (!status) {
        hada_cli_progress_begin(cli, &progress, "frames", (long)camera->depths * recipe->pairs + recipe->tests);
        status = hada_cli_write_dataset(cli, simulator, recipe, err);
        hada_cli_progress_end(cli);
    }
    hada_simulator_destroy(&simulator);
    hada_cli_close(cli, &context);
    hada_cli_scenes_close(&recipe->scenes);
    hada_cli_scenes_close(&recipe->test_scenes);
    return status;
}

typedef struct writing {
    hada_cli *cli;
    const settings *set;
    const hada_camera *camera;
    hada_cli_recipe *recipe;
} writing;

static hada_status fill_folder(void *user, const char *folder, hada_error *err)
{
    const writing *w = user;
    w->recipe->folder = folder;
    return simulate(w->cli, w->set, w->camera, w->recipe, err);
}

static int run(hada_cli *cli, void *user, int count, const char **arguments)
{
    const settings *set = user;
    hada_error err = {0};
    hada_camera camera;
    hada_cli_sensor sensor = {0};
    hada_cli_recipe recipe = {.sensor = &sensor};
    double start = hada_cli_seconds();
    if (count)
        return hada_cli_usage(cli, "'%s' is one word too many; a folder of pictures is given with --scenes",
                              arguments[0]);
    if (!set->output)
        return hada_cli_usage(cli, "say where the data set shall be written, with -o DATASET");
    if (!set->pairs || !set->test_depths)
        return hada_cli_usage(cli, "--%s must be at least 1", set->pairs ? "test-depths" : "pairs");
    hada_status status = hada_cli_make_camera(&camera, &set->frame.camera, &err);
    if (!status)
        status = hada_cli_make_sensor(&sensor, &set->frame, &err);
    if (!status)
        status = hada_folder_create(set->output, fill_folder,
                                    &(writing){.cli = cli, .set = set, .camera = &camera, .recipe = &recipe}, &err);
    hada_cli_sensor_free(&sensor);
    if (status)
        return hada_cli_fail(cli, &err);
    char lenses[32] = "";
    if (camera.mask == HADA_MASK_MLA || camera.mask == HADA_MASK_GRID)
        snprintf(lenses, sizeof lenses, " of %d lenses", camera.lenses);
    hada_cli_say(cli,
                 "%s: %d %s from %g to %g mm, %d pair%s each, %dx%d %s frames, window %dx%d, mask %s%s, noise %g "
                 "(%.1f s)",
                 set->output, camera.depths, camera.depths == 1 ? "depth" : "depths", camera.distances_mm[0],
                 camera.distances_mm[camera.depths - 1], recipe.pairs, recipe.pairs == 1 ? "" : "s", camera.rows,
                 camera.cols, camera.channels == 1 ? "grey" : "colour", camera.window_rows, camera.window_cols,
                 hada_mask_word(camera.mask), lenses, sensor.noise, hada_cli_seconds() - start);
    if (set->test)
        hada_cli_say(cli, "%s/test: %d test frames with %d occupied depths each, and their truth", set->output,
                     set->test, recipe.test_depths);
    json_object_update_new(cli->document,
                           json_pack("{s:s, s:i, s:i, s:[ii], s:[ii], s:i, s:s, s:i, s:f, s:f}", "dataset", set->output,
                                     "pairs_per_depth", recipe.pairs, "tests", set->test, "size", camera.rows,
                                     camera.cols, "window", camera.window_rows, camera.window_cols, "channels",
                                     camera.channels, "mask", hada_mask_word(camera.mask), "lenses", camera.lenses,
                                     "noise", sensor.noise, "seconds", hada_cli_seconds() - start));
    if (sensor.used)
        json_object_set_new(cli->document, "exposure", hada_cli_real(sensor.sensor.exposure));
    json_object_set_new(cli->document, "distances_mm", hada_cli_reals(camera.distances_mm, camera.depths));
    return HADA_EXIT_OK;
}

static const hada_cli_example examples[] = {
    {"hadalens simulate --preset sim300 --test 4 -o camera", "a small camera, drawn scenes, four test frames."},
    {"hadalens simulate --scenes photographs --depths 6 --near 50 --far 300 -o camera", "your own pictures."},
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
