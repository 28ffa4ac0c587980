#include "dataset_write.h"
#include "folder.h"
#include "test_scene.h"

#include <hadalens/tiff.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Where a frame's noise begins: every frame its own. */
enum { NOISE_OF_PAIRS = 1000, NOISE_OF_TESTS = 9000000 };

static hada_status save(const char *folder, const char *name, const hada_image *image, int bits, hada_error *err)
{
    hada_tiff_write_options options;
    hada_tiff_write_options_init(&options);
    options.bits = bits;
    char *path = hada_cli_text("%s/%s.tif", folder, name);
    if (!path)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    hada_status status = hada_tiff_save(path, image, &options, err);
    free(path);
    return status;
}

/* The part of a scene in the window. */
static hada_status window_of(const hada_camera *camera, const hada_image *scene, hada_image *out, hada_error *err)
{
    const int rows = camera->window_rows, cols = camera->window_cols;
    return hada_image_crop(out, scene, hada_window_origin(scene->rows, rows), hada_window_origin(scene->cols, cols),
                           rows, cols, err);
}

static hada_status save_window(const hada_camera *camera, const char *folder, const char *name, const hada_image *scene,
                               int bits, hada_error *err)
{
    hada_image window = {0};
    hada_status status = window_of(camera, scene, &window, err);
    if (!status)
        status = save(folder, name, &window, bits, err);
    hada_image_destroy(&window);
    return status;
}

/* What the sensor makes of the light in *raw, where its model is asked for. */
static hada_status expose(hada_simulator *simulator, const hada_cli_recipe *recipe, uint64_t seed, hada_image *raw,
                          hada_error *err)
{
    return recipe->sensor->used ? hada_simulator_expose(simulator, &recipe->sensor->sensor, seed, raw, err) : HADA_OK;
}

/* In the units of the frames: what light of 1 from a point makes. */
static hada_status write_psf(hada_simulator *simulator, const hada_cli_recipe *recipe, hada_error *err)
{
    const hada_camera *camera = hada_simulator_camera(simulator);
    const float scale = recipe->sensor->used ? (float)recipe->sensor->sensor.exposure : 1.0f;
    hada_tiff_write_options options;
    hada_tiff_writer *writer = NULL;
    hada_status status = HADA_OK;
    hada_tiff_write_options_init(&options);
    options.layout = HADA_TIFF_HYPERSTACK;
    options.slices = camera->depths;
    options.times = 1;
    options.distances_mm = camera->distances_mm;
    char *path = hada_cli_text("%s/psf.tif", recipe->folder);
    if (!path)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    for (int z = 0; !status && z < camera->depths; z++) {
        hada_image psf = {0};
        status = hada_simulator_psf(simulator, z, &psf, err);
        for (size_t i = 0; !status && i < hada_image_count(&psf); i++)
            psf.data[i] *= scale;
        if (!status && !writer)
            status = hada_tiff_create(&writer, path, psf.channels, psf.rows, psf.cols, &options, err);
        if (!status)
            status = hada_tiff_write(writer, &psf, err);
        hada_image_destroy(&psf);
    }
    if (!status)
        status = hada_tiff_finish(&writer, err);
    if (writer)
        hada_tiff_abandon(&writer);
    free(path);
    return status;
}

static hada_status write_pair(hada_simulator *simulator, const hada_cli_recipe *recipe, int z, int i,
                              const char *raw_folder, const char *scene_folder, hada_error *err)
{
    hada_image scene = {0}, raw = {0};
    char *name = NULL;
    int number = z * recipe->pairs + i;
    const uint64_t seed = recipe->seed + NOISE_OF_PAIRS + (uint64_t)number;
    hada_status status = hada_cli_scenes_get(&recipe->scenes, number % recipe->training_count, &scene, &name, err);
    if (!status) {
        hada_plane plane = {z, &scene};
        status = hada_simulator_render(simulator, &plane, 1, recipe->sensor->noise, seed, &raw, err);
    }
    if (!status)
        status = expose(simulator, recipe, seed, &raw, err);
    if (!status)
        status = save(raw_folder, name, &raw, recipe->bits, err);
    if (!status)
        status = save_window(hada_simulator_camera(simulator), scene_folder, name, &scene, recipe->bits, err);
    hada_image_destroy(&scene);
    hada_image_destroy(&raw);
    free(name);
    return status;
}

static hada_status write_depth(hada_cli *cli, hada_simulator *simulator, const hada_cli_recipe *recipe, int z,
                               hada_error *err)
{
    const hada_camera *camera = hada_simulator_camera(simulator);
    char *raw = hada_cli_text("%s/z%gmm/raw", recipe->folder, camera->distances_mm[z]);
    char *scene = hada_cli_text("%s/z%gmm/scene", recipe->folder, camera->distances_mm[z]);
    hada_status status = raw && scene ? HADA_OK : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status)
        status = hada_folder_ensure(raw, err);
    if (!status)
        status = hada_folder_ensure(scene, err);
    for (int i = 0; !status && i < recipe->pairs; i++) {
        status = write_pair(simulator, recipe, z, i, raw, scene, err);
        hada_cli_progress_step(cli, NULL);
        if (!status)
            status = hada_cli_check_signals(err);
    }
    free(raw);
    free(scene);
    return status;
}

static hada_status write_truth_stack(const hada_cli_test_scene *scene, const hada_camera *camera, const char *folder,
                                     const char *name, hada_error *err)
{
    hada_tiff_write_options options;
    hada_tiff_writer *writer = NULL;
    hada_image dark = {0};
    hada_tiff_write_options_init(&options);
    options.layout = HADA_TIFF_HYPERSTACK;
    options.slices = camera->depths;
    options.times = 1;
    options.distances_mm = camera->distances_mm;
    char *path = hada_cli_text("%s/%s_stack.tif", folder, name);
    hada_status status = path ? HADA_OK : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status)
        status = hada_image_create(&dark, camera->channels, camera->window_rows, camera->window_cols, err);
    if (!status)
        status =
            hada_tiff_create(&writer, path, camera->channels, camera->window_rows, camera->window_cols, &options, err);
    for (int z = 0, k = 0; !status && z < camera->depths; z++) {
        int here = k < scene->count && scene->depths[k] == z;
        hada_image window = {0};
        if (here)
            status = window_of(camera, &scene->planes[k++], &window, err);
        if (!status)
            status = hada_tiff_write(writer, here ? &window : &dark, err);
        hada_image_destroy(&window);
    }
    if (!status)
        status = hada_tiff_finish(&writer, err);
    if (writer)
        hada_tiff_abandon(&writer);
    hada_image_destroy(&dark);
    free(path);
    return status;
}

static hada_status write_test(hada_simulator *simulator, const hada_cli_recipe *recipe, int t, const char *raw_folder,
                              const char *truth_folder, hada_error *err)
{
    const hada_camera *camera = hada_simulator_camera(simulator);
    const hada_cli_scenes *source = recipe->other_test_scenes ? &recipe->test_scenes : &recipe->scenes;
    const uint64_t noise_seed = recipe->seed + NOISE_OF_TESTS + (uint64_t)t;
    hada_cli_test_scene scene = {0};
    hada_image raw = {0};
    char name[32], map_name[48], aif_name[48];
    snprintf(name, sizeof name, "test%02d", t + 1);
    snprintf(map_name, sizeof map_name, "%s_depth", name);
    snprintf(aif_name, sizeof aif_name, "%s_aif", name);
    int number = t; /* behind those of the pairs */
    if (!recipe->other_test_scenes)
        number += source->folder ? recipe->training_count : camera->depths * recipe->pairs;
    hada_status status =
        hada_cli_test_scene_make(&scene, source, number, recipe->tests, camera, recipe->test_depths,
                                 recipe->sensor->occlude, recipe->seed + 77777u * (uint64_t)(t + 1), err);
    if (!status)
        status = hada_cli_test_scene_render(&scene, simulator, recipe->sensor->noise, noise_seed, &raw, err);
    if (!status)
        status = expose(simulator, recipe, noise_seed, &raw, err);
    if (!status)
        status = save(raw_folder, name, &raw, recipe->bits, err);
    if (!status)
        status = write_truth_stack(&scene, camera, truth_folder, name, err);
    if (!status)
        status = save_window(camera, truth_folder, map_name, &scene.map, 32, err);
    if (!status)
        status = save_window(camera, truth_folder, aif_name, &scene.whole, 32, err);
    hada_cli_test_scene_free(&scene);
    hada_image_destroy(&raw);
    return status;
}

static hada_status write_tests(hada_cli *cli, hada_simulator *simulator, const hada_cli_recipe *recipe, hada_error *err)
{
    char *raw = hada_cli_text("%s/test/raw", recipe->folder), *truth = hada_cli_text("%s/test/truth", recipe->folder);
    hada_status status = raw && truth ? HADA_OK : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status)
        status = hada_folder_ensure(raw, err);
    if (!status)
        status = hada_folder_ensure(truth, err);
    for (int t = 0; !status && t < recipe->tests; t++) {
        status = write_test(simulator, recipe, t, raw, truth, err);
        hada_cli_progress_step(cli, NULL);
        if (!status)
            status = hada_cli_check_signals(err);
    }
    free(raw);
    free(truth);
    return status;
}

hada_status hada_cli_write_dataset(hada_cli *cli, hada_simulator *simulator, const hada_cli_recipe *recipe,
                                   hada_error *err)
{
    const hada_camera *camera = hada_simulator_camera(simulator);
    char *path = hada_cli_text("%s/camera.json", recipe->folder);
    hada_status status =
        path ? hada_camera_save(camera, path, err) : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    free(path);
    if (!status)
        status = hada_cli_write_sensor(recipe->sensor, recipe->folder, err);
    if (!status)
        status = write_psf(simulator, recipe, err);
    for (int z = 0; !status && z < camera->depths; z++)
        status = write_depth(cli, simulator, recipe, z, err);
    if (!status && recipe->tests)
        status = write_tests(cli, simulator, recipe, err);
    return status;
}
