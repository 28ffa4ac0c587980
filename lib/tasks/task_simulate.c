/* A simulated data set: what it is made of, scenes for pairs and tests, a simulator, a sensor; and its files. */
#include <hadalens/scene.h>
#include <hadalens/tiff.h>
#include <jansson.h>

#include "core/callers.h"
#include "image/mosaic.h"
#include "io/encode.h"
#include "io/folder.h"
#include "io/text.h"
#include "optics/simulator.h"
#include "tasks/simulated_scenes.h"

/* Where a frame's noise begins: every frame its own. */
enum { NOISE_OF_PAIRS = 1000, NOISE_OF_TESTS = 9000000 };
/* Between the seeds of test scenes. */
#define TEST_SEED 77777u

static double stated(double encoding)
{
    return encoding == HADA_RESPONSE_LINEAR ? 0.0 : encoding;
}

/* `encoding`: that of the pictures, stated where it is more than the default; 0: of frames and distances. */
static hada_status save(const char *folder, const char *name, const hada_image *image, double encoding, int bits,
                        hada_error *err)
{
    hada_tiff_write_options options;
    hada_path path;
    hada_tiff_write_options_init(&options);
    options.bits = bits;
    options.encoding = stated(encoding);
    HADA_TRY(hada_path_write(path, err, "%s/%s.tif", folder, name));
    return hada_tiff_save(path, image, &options, err);
}

/* The part of a scene in the window. */
static hada_status window_of(const hada_camera *camera, const hada_image *scene, hada_image *out, hada_error *err)
{
    const int rows = camera->window_rows, cols = camera->window_cols;
    return hada_image_crop(out, scene, hada_window_origin(scene->rows, rows), hada_window_origin(scene->cols, cols),
                           rows, cols, err);
}

/* `encoding`: of what is written, of light; 0: of distances. */
static hada_status save_window(const hada_camera *camera, const char *folder, const char *name, const hada_image *scene,
                               double encoding, int bits, hada_error *err)
{
    hada_image window = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(window_of(camera, scene, &window, err));
    if (encoding != 0.0)
        hada_response_convert(window.data, hada_image_count(&window), HADA_RESPONSE_LINEAR, encoding);
    HADA_TRY_OR_DONE(save(folder, name, &window, encoding, bits, err));
done:
    hada_image_destroy(&window);
    return status;
}

/* What the sensor makes of the light in *raw, where there is one. */
static hada_status expose(const hada_recipe *recipe, uint64_t seed, hada_image *raw, hada_error *err)
{
    return recipe->has_sensor ? hada_simulator_expose(recipe->simulator, &recipe->sensor, seed, raw, err) : HADA_OK;
}

static hada_status save_frame(const hada_recipe *recipe, const char *folder, const char *name, const hada_image *frame,
                              hada_error *err)
{
    static const char *const endings[] = {"tif", "dng", "npy", "raw"};
    const hada_simulate_task *task = &recipe->task;
    hada_path path;
    HADA_TRY(hada_path_write(path, err, "%s/%s.%s", folder, name, endings[task->raw]));
    switch (task->raw) {
    case HADA_SIMULATE_RAW_DNG:
        return hada_dng_save(path, frame, task->mosaic, recipe->has_sensor ? recipe->sensor.dark_level : 0.0, err);
    case HADA_SIMULATE_RAW_NUMPY: return hada_numpy_save(path, frame, task->bits, err);
    case HADA_SIMULATE_RAW_PACKED12: return hada_packed12_save(path, frame, err);
    case HADA_SIMULATE_RAW_TIFF: break;
    }
    return save(folder, name, frame, 0.0, task->bits, err);
}

/* A frame as its sensor gives it. */
static hada_status save_raw(const hada_recipe *recipe, const char *folder, const char *name, const hada_image *raw,
                            hada_error *err)
{
    const hada_mosaic mosaic = recipe->task.mosaic;
    hada_image taken = {0};
    hada_status status = HADA_OK;
    if (mosaic == HADA_MOSAIC_NONE)
        return save_frame(recipe, folder, name, raw, err);
    HADA_TRY_OR_DONE(hada_image_create(&taken, 1, raw->rows, raw->cols, err));
    hada_mosaic_take(mosaic, raw->data, raw->rows, raw->cols, taken.data);
    HADA_TRY_OR_DONE(save_frame(recipe, folder, name, &taken, err));
done:
    hada_image_destroy(&taken);
    return status;
}

/* A page per depth, near to far. */
static hada_status create_stack(hada_tiff_writer **writer, const char *path, const hada_camera *camera, int channels,
                                int rows, int cols, double encoding, hada_error *err)
{
    hada_tiff_write_options options;
    hada_tiff_write_options_init(&options);
    options.layout = HADA_TIFF_HYPERSTACK;
    options.slices = camera->depths;
    options.times = 1;
    options.distances_mm = camera->distances_mm;
    options.encoding = stated(encoding);
    return hada_tiff_create(writer, path, channels, rows, cols, &options, err);
}

/* Pixels from the axis. */
typedef struct field_point {
    int row, col;
} field_point;

/* A page for each depth, in the units of the frames: what light of 1 makes, from a point of the field or (NULL) the
 * axis. */
static hada_status write_psfs(const hada_recipe *recipe, const char *folder, const char *name, const field_point *at,
                              hada_error *err)
{
    const hada_camera *camera = &recipe->camera;
    const float scale = recipe->has_sensor ? (float)recipe->sensor.exposure : 1.0f;
    hada_tiff_writer *writer = NULL;
    hada_image psf = {0};
    hada_path path;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/%s", folder, name));
    for (int z = 0; z < camera->depths; z++) {
        HADA_TRY_OR_DONE(at ? hada_simulator_psf_at(recipe->simulator, z, at->row, at->col, &psf, err)
                            : hada_simulator_psf(recipe->simulator, z, &psf, err));
        for (size_t i = 0; i < hada_image_count(&psf); i++)
            psf.data[i] *= scale;
        if (!writer)
            HADA_TRY_OR_DONE(create_stack(&writer, path, camera, psf.channels, psf.rows, psf.cols, 0.0, err));
        HADA_TRY_OR_DONE(hada_tiff_write(writer, &psf, err));
        hada_image_destroy(&psf);
    }
    HADA_TRY_OR_DONE(hada_tiff_finish(&writer, err));
done:
    hada_tiff_abandon(&writer);
    hada_image_destroy(&psf);
    return status;
}

/* PSFs of points over the window, from border to border, and their list. */
static hada_status write_field(const hada_recipe *recipe, const char *dataset, hada_error *err)
{
    const hada_camera *camera = &recipe->camera;
    const int points = recipe->task.field_psfs;
    hada_text list = {0};
    hada_path folder, path;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_path_write(folder, err, "%s/field", dataset));
    HADA_TRY_OR_DONE(hada_folder_ensure(folder, err));
    hada_text_add(&list, "file,x_px,y_px\n");
    for (int i = 0; i < points; i++)
        for (int j = 0; j < points; j++) {
            const int row = i * (camera->window_rows - 1) / (points - 1) +
                            hada_window_origin(camera->rows, camera->window_rows),
                      col = j * (camera->window_cols - 1) / (points - 1) +
                            hada_window_origin(camera->cols, camera->window_cols);
            const field_point at = {row - camera->rows / 2, col - camera->cols / 2};
            char name[32];
            snprintf(name, sizeof name, "psf_%02d_%02d.tif", i + 1, j + 1);
            HADA_TRY_OR_DONE(write_psfs(recipe, folder, name, &at, err));
            hada_text_add(&list, "%s,%d,%d\n", name, col, row);
        }
    HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/positions.csv", folder));
    HADA_TRY_OR_DONE(hada_text_save(&list, path, err));
done:
    free(list.data);
    return status;
}

static hada_status write_pair(const hada_recipe *recipe, int z, int i, const char *raw_folder, const char *scene_folder,
                              hada_error *err)
{
    const int number = z * recipe->task.pairs + i;
    const uint64_t seed = recipe->camera.seed + NOISE_OF_PAIRS + (uint64_t)number;
    hada_image scene = {0}, raw = {0};
    char *name = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_scenes_get(&recipe->scenes, number % recipe->training_count, &scene, &name, err));
    const hada_plane plane = {z, &scene};
    HADA_TRY_OR_DONE(hada_simulator_render(recipe->simulator, &plane, 1, recipe->task.noise, seed, &raw, err));
    HADA_TRY_OR_DONE(expose(recipe, seed, &raw, err));
    HADA_TRY_OR_DONE(save_raw(recipe, raw_folder, name, &raw, err));
    HADA_TRY_OR_DONE(
        save_window(&recipe->camera, scene_folder, name, &scene, recipe->task.scene_response, recipe->task.bits, err));
done:
    hada_image_destroy(&scene);
    hada_image_destroy(&raw);
    free(name);
    return status;
}

static hada_status write_depth(hada_recipe *recipe, int z, const char *folder, hada_error *err)
{
    char distance[32];
    hada_path raw, scene;
    hada_format_exact(distance, sizeof distance, recipe->camera.distances_mm[z]);
    HADA_TRY(hada_path_write(raw, err, "%s/z%smm/raw", folder, distance));
    HADA_TRY(hada_path_write(scene, err, "%s/z%smm/scene", folder, distance));
    HADA_TRY(hada_folder_ensure(raw, err));
    HADA_TRY(hada_folder_ensure(scene, err));
    for (int i = 0; i < recipe->task.pairs; i++) {
        HADA_TRY(write_pair(recipe, z, i, raw, scene, err));
        HADA_TRY(hada_progress_step(&recipe->progress, NULL, err));
    }
    return HADA_OK;
}

static hada_status write_truth_stack(const hada_test_scene *scene, const hada_camera *camera, double response,
                                     const char *folder, const char *name, hada_error *err)
{
    const int rows = camera->window_rows, cols = camera->window_cols;
    hada_tiff_writer *writer = NULL;
    hada_image dark = {0}, window = {0};
    hada_path path;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/%s_stack.tif", folder, name));
    HADA_TRY_OR_DONE(hada_image_create(&dark, camera->channels, rows, cols, err));
    HADA_TRY_OR_DONE(create_stack(&writer, path, camera, camera->channels, rows, cols, response, err));
    for (int z = 0, k = 0; z < camera->depths; z++) {
        const int here = k < scene->count && scene->depths[k] == z;
        if (here)
            HADA_TRY_OR_DONE(window_of(camera, &scene->planes[k++], &window, err));
        hada_response_convert(window.data, hada_image_count(&window), HADA_RESPONSE_LINEAR, response);
        HADA_TRY_OR_DONE(hada_tiff_write(writer, here ? &window : &dark, err));
        hada_image_destroy(&window);
    }
    HADA_TRY_OR_DONE(hada_tiff_finish(&writer, err));
done:
    hada_tiff_abandon(&writer);
    hada_image_destroy(&window);
    hada_image_destroy(&dark);
    return status;
}

/* Where the scenes of the test frames begin: behind those of the pairs. */
static int first_test_scene(const hada_recipe *recipe)
{
    if (recipe->task.test_scenes)
        return 0;
    return recipe->scenes.folder ? recipe->training_count : recipe->camera.depths * recipe->task.pairs;
}

static hada_status write_test(const hada_recipe *recipe, int t, const char *raw_folder, const char *truth_folder,
                              hada_error *err)
{
    const hada_camera *camera = &recipe->camera;
    const hada_simulate_task *task = &recipe->task;
    const hada_scenes *source = task->test_scenes ? &recipe->test_scenes : &recipe->scenes;
    const uint64_t noise_seed = camera->seed + NOISE_OF_TESTS + (uint64_t)t,
                   seed = camera->seed + TEST_SEED * (uint64_t)(t + 1);
    const int number = first_test_scene(recipe) + t;
    hada_test_scene scene = {0};
    hada_image raw = {0};
    char name[32], map_name[48], over_name[48], aif_name[48];
    hada_status status = HADA_OK;
    snprintf(name, sizeof name, recipe->surfaces.count ? "test%02d_%s" : "test%02d", t + 1,
             recipe->surfaces.count ? hada_surface_name(&recipe->surfaces, t) : "");
    snprintf(map_name, sizeof map_name, "%s_depth", name);
    snprintf(over_name, sizeof over_name, "%s_depth2", name);
    snprintf(aif_name, sizeof aif_name, "%s_aif", name);
    HADA_TRY_OR_DONE(recipe->surfaces.count ? hada_test_surface_make(&scene, &recipe->surfaces, t, source, number,
                                                                     task->tests, camera, task->occlude, seed, err)
                                            : hada_test_scene_make(&scene, source, number, task->tests, camera,
                                                                   task->test_depths, task->occlude, seed, err));
    HADA_TRY_OR_DONE(hada_test_scene_render(&scene, recipe->simulator, task->noise, noise_seed, &raw, err));
    HADA_TRY_OR_DONE(expose(recipe, noise_seed, &raw, err));
    HADA_TRY_OR_DONE(save_raw(recipe, raw_folder, name, &raw, err));
    HADA_TRY_OR_DONE(write_truth_stack(&scene, camera, task->scene_response, truth_folder, name, err));
    HADA_TRY_OR_DONE(save_window(camera, truth_folder, map_name, &scene.map, 0.0, 32, err));
    if (scene.over.data)
        HADA_TRY_OR_DONE(save_window(camera, truth_folder, over_name, &scene.over, 0.0, 32, err));
    HADA_TRY_OR_DONE(save_window(camera, truth_folder, aif_name, &scene.whole, task->scene_response, 32, err));
done:
    hada_test_scene_free(&scene);
    hada_image_destroy(&raw);
    return status;
}

static hada_status write_tests(hada_recipe *recipe, const char *folder, hada_error *err)
{
    hada_path raw, truth;
    HADA_TRY(hada_path_write(raw, err, "%s/test/raw", folder));
    HADA_TRY(hada_path_write(truth, err, "%s/test/truth", folder));
    HADA_TRY(hada_folder_ensure(raw, err));
    HADA_TRY(hada_folder_ensure(truth, err));
    for (int t = 0; t < recipe->task.tests; t++) {
        HADA_TRY(write_test(recipe, t, raw, truth, err));
        HADA_TRY(hada_progress_step(&recipe->progress, NULL, err));
    }
    return HADA_OK;
}

static json_t *sensor_json(const hada_recipe *recipe)
{
    static const char *const vignetting[] = {"none", "cos4", "image"};
    const hada_simulator_options *o = &recipe->simulator_options;
    const hada_sensor *s = &recipe->sensor;
    json_t *document = json_pack("{s:[ii]}", "shift", o->shift_rows, o->shift_cols);
    if (document && o->field_rows)
        json_object_set_new(document, "field", json_pack("[ii]", o->field_rows, o->field_cols));
    if (document && o->field_varying > 0.0)
        json_object_set_new(document, "field_varying", json_real(o->field_varying));
    if (document && recipe->task.scene_response != HADA_RESPONSE_LINEAR) {
        char name[HADA_RESPONSE_NAME];
        hada_response_name(name, recipe->task.scene_response);
        json_object_set_new(document, "scene_response", json_string(name));
    }
    if (document && recipe->task.mosaic != HADA_MOSAIC_NONE)
        json_object_set_new(document, "mosaic",
                            json_string(hada_enum_name(HADA_ENUM_MOSAIC, (int)recipe->task.mosaic)));
    if (document && recipe->has_sensor)
        json_object_update_new(document,
                               json_pack("{s:f, s:f, s:f, s:f, s:i, s:s}", "exposure", s->exposure, "full_well",
                                         s->full_well, "read_noise", s->read_noise, "dark_level", s->dark_level, "bits",
                                         s->bits, "vignetting", vignetting[s->vignetting]));
    return document;
}

/* Only where something about it is special. */
static hada_status write_sensor(const hada_recipe *recipe, const char *folder, hada_error *err)
{
    const hada_simulator_options *o = &recipe->simulator_options;
    char *text = NULL;
    hada_path path;
    hada_status status = HADA_OK;
    if (!recipe->has_sensor && !o->shift_rows && !o->shift_cols && !o->field_rows && o->field_varying == 0.0 &&
        recipe->task.scene_response == HADA_RESPONSE_LINEAR && recipe->task.mosaic == HADA_MOSAIC_NONE)
        return HADA_OK;
    json_t *document = sensor_json(recipe);
    HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/sensor.json", folder));
    text = document ? json_dumps(document, JSON_INDENT(2) | JSON_REAL_PRECISION(12)) : NULL;
    if (!text)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_MEMORY, "no memory for %s", path));
    HADA_TRY_OR_DONE(hada_file_write(path, text, strlen(text), err));
done:
    free(text);
    json_decref(document);
    return status;
}

/* All files, into an empty folder. Steps the progress once per frame. */
static hada_status recipe_write(hada_recipe *recipe, const char *folder, hada_error *err)
{
    hada_path path;
    HADA_TRY(hada_path_write(path, err, "%s/camera.json", folder));
    HADA_TRY(hada_camera_save(&recipe->camera, path, err));
    HADA_TRY(write_sensor(recipe, folder, err));
    HADA_TRY(write_psfs(recipe, folder, "psf.tif", NULL, err));
    if (recipe->simulator_options.field_varying > 0.0 && recipe->task.field_psfs)
        HADA_TRY(write_field(recipe, folder, err));
    for (int z = 0; z < recipe->camera.depths; z++)
        HADA_TRY(write_depth(recipe, z, folder, err));
    if (recipe->task.tests)
        HADA_TRY(write_tests(recipe, folder, err));
    return HADA_OK;
}

static hada_status take_task(hada_recipe *recipe, const hada_camera *camera, const hada_simulate_task *callers,
                             hada_error *err)
{
    hada_simulate_task *task = &recipe->task;
    HADA_TRY(HADA_OPTIONS_TAKE(&recipe->camera, camera, hada_camera, err));
    HADA_TRY(HADA_OPTIONS_TAKE(task, callers, hada_simulate_task, err));
    HADA_TRY(HADA_OPTIONS_TAKE(&recipe->simulator_options, task->simulator, hada_simulator_options, err));
    if (!recipe->simulator_options.monitor)
        recipe->simulator_options.monitor = task->monitor;
    HADA_TRY(HADA_OPTIONS_TAKE(&recipe->sensor, task->sensor, hada_sensor, err));
    recipe->has_sensor = task->sensor != NULL;
    if (task->pairs < 1 || task->test_depths < 1 || task->tests < 0)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "hada_simulate_run: a pair per depth and a depth per test frame are the least"));
    if (!hada_response_is_known(task->scene_response))
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "options.scene_response: %g is no response; use linear, srgb, or "
                           "a power from %g to %g",
                           task->scene_response, HADA_RESPONSE_LEAST, HADA_RESPONSE_MOST));
    if (task->mosaic != HADA_MOSAIC_NONE &&
        (!hada_mosaic_is_pattern(task->mosaic) || recipe->camera.channels != HADA_MOSAIC_COLOURS))
        HADA_TRY(
            hada_fail(err, HADA_ERROR_ARGUMENT,
                      "options.mosaic: a colour filter mosaic needs a pattern and a camera of three channels; this "
                      "one has %d",
                      recipe->camera.channels));
    if ((int)task->raw < HADA_SIMULATE_RAW_TIFF || task->raw > HADA_SIMULATE_RAW_PACKED12)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "there is no options.raw %d", (int)task->raw));
    if ((task->raw == HADA_SIMULATE_RAW_DNG || task->raw == HADA_SIMULATE_RAW_PACKED12) &&
        task->mosaic == HADA_MOSAIC_NONE && recipe->camera.channels > 1)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "options.raw: such files hold one value for each pixel of the sensor; give it a colour "
                           "filter mosaic (options.mosaic rggb), or take options.channels 1"));
    if (task->field_psfs && (task->field_psfs < 2 || task->field_psfs > 64))
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "options.field_psfs is 2 to 64 a side, or 0 for none; not %d",
                           task->field_psfs));
    if (recipe->simulator_options.field_varying != 0.0 && (task->occlude || task->surfaces))
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "options.field_varying is for test scenes of planes: leave options.occlude and "
                           "options.surfaces out"));
    if (task->test_depths > recipe->camera.depths)
        task->test_depths = recipe->camera.depths;
    if (task->surfaces) {
        if (recipe->camera.depths < 2)
            HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "options.surfaces: a camera of two depths is the least"));
        HADA_TRY(hada_surface_words_read(&recipe->surfaces, task->surfaces, err));
        task->tests = task->tests ? task->tests : recipe->surfaces.count;
    }
    return HADA_OK;
}

/* Opens the scenes and divides them between pairs and tests. */
static hada_status open_scenes(hada_recipe *recipe, hada_error *err)
{
    hada_simulate_task *task = &recipe->task;
    const hada_camera *camera = &recipe->camera;
    const hada_simulator_options *wanted = &recipe->simulator_options;
    const int rows = wanted->field_rows ? wanted->field_rows : camera->window_rows;
    const int cols = wanted->field_rows ? wanted->field_cols : camera->window_cols;
    HADA_TRY(hada_scenes_open(&recipe->scenes, task->scenes, camera->seed, camera->channels, rows, cols, err));
    if (task->test_scenes)
        HADA_TRY(hada_scenes_open(&recipe->test_scenes, task->test_scenes, camera->seed + 1, camera->channels, rows,
                                  cols, err));
    recipe->scenes.response = recipe->test_scenes.response = task->scene_response;
    const int count = recipe->scenes.count;
    recipe->training_count = count;
    if (task->tests && !task->test_scenes && task->scenes) {
        if (count >= task->pairs + task->tests)
            recipe->training_count = count - task->tests;
        else
            hada_monitor_tell(task->monitor, HADA_MESSAGE_NOTE,
                              "%s holds %d pictures, too few to keep some for the tests alone: the tests show scenes "
                              "that the pairs show too",
                              task->scenes, count);
    }
    if (recipe->training_count < task->pairs) {
        hada_monitor_tell(task->monitor, HADA_MESSAGE_NOTE, "%s holds %d pictures: %d pairs per depth instead of %d",
                          task->scenes, recipe->training_count, recipe->training_count, task->pairs);
        task->pairs = recipe->training_count;
    }
    return HADA_OK;
}

static hada_status make_simulator(hada_recipe *recipe, hada_error *err)
{
    const double white = recipe->task.white;
    hada_status status =
        hada_simulator_create(&recipe->simulator, recipe->context, &recipe->camera, &recipe->simulator_options, err);
    if (status == HADA_ERROR_SIZE) { /* a field that does not fit is an option's fault, not a file's */
        status = HADA_ERROR_ARGUMENT;
        if (err)
            err->status = status;
    }
    HADA_TRY(status);
    if (recipe->has_sensor && white > 0.0)
        HADA_TRY(hada_simulator_white_exposure(recipe->simulator, white, &recipe->sensor.exposure, err));
    return status;
}

/* The share of a white window's light that misses the sensor: all of a PSF sums to 1. */
static hada_status measure_loss(hada_recipe *recipe, hada_error *err)
{
    const hada_camera *camera = &recipe->camera;
    const double all = (double)camera->window_rows * camera->window_cols * camera->channels * camera->depths;
    double caught = 0.0;
    for (int z = 0; z < camera->depths; z++) {
        hada_image raw = {0};
        HADA_TRY(hada_simulator_white(recipe->simulator, z, &raw, err));
        for (size_t i = 0; i < hada_image_count(&raw); i++)
            caught += (double)raw.data[i];
        hada_image_destroy(&raw);
    }
    recipe->light_lost = fmax(0.0, 1.0 - caught / all);
    return HADA_OK;
}

static hada_status fill(void *user, const char *folder, hada_error *err)
{
    hada_recipe *recipe = user;
    const hada_simulate_task *task = &recipe->task;
    hada_status status = HADA_OK;
    HADA_TRY(open_scenes(recipe, err));
    HADA_TRY(make_simulator(recipe, err));
    HADA_TRY(measure_loss(recipe, err));
    recipe->progress =
        hada_progress_begin(task->monitor, "frames", (long)recipe->camera.depths * task->pairs + task->tests);
    status = recipe_write(recipe, folder, err);
    hada_progress_end(&recipe->progress);
    return status;
}

hada_status hada_simulate_run(hada_context *context, const hada_camera *camera, const char *folder,
                              const hada_simulate_task *task, hada_simulate_report *report, hada_error *err)
{
    hada_recipe recipe = {.context = context};
    hada_status status = HADA_OK;
    HADA_NEED(context && camera && folder, err);
    HADA_TRY_OR_DONE(HADA_REPORT_CHECK(report, hada_simulate_report, err));
    HADA_TRY_OR_DONE(take_task(&recipe, camera, task, err));
    HADA_TRY_OR_DONE(hada_folder_create(folder, fill, &recipe, err));
    if (report) {
        const hada_simulate_report own = {.size = sizeof own,
                                          .pairs = recipe.task.pairs,
                                          .test_depths = recipe.task.test_depths,
                                          .exposure = recipe.has_sensor ? recipe.sensor.exposure : (double)NAN,
                                          .tests = recipe.task.tests,
                                          .light_lost = recipe.light_lost};
        HADA_REPORT_GIVE(report, &own);
    }
done:
    hada_simulator_destroy(&recipe.simulator);
    hada_scenes_close(&recipe.scenes);
    hada_scenes_close(&recipe.test_scenes);
    hada_surface_words_free(&recipe.surfaces);
    return status;
}
