#include "dataset_write.h"
#include "folder.h"

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

static hada_status write_psf(hada_simulator *simulator, const char *folder, hada_error *err)
{
    const hada_camera *camera = hada_simulator_camera(simulator);
    hada_tiff_write_options options;
    hada_tiff_writer *writer = NULL;
    hada_status status = HADA_OK;
    hada_tiff_write_options_init(&options);
    options.layout = HADA_TIFF_HYPERSTACK;
    options.slices = camera->depths;
    options.times = 1;
    options.distances_mm = camera->distances_mm;
    char *path = hada_cli_text("%s/psf.tif", folder);
    if (!path)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    for (int z = 0; !status && z < camera->depths; z++) {
        hada_image psf = {0};
        status = hada_simulator_psf(simulator, z, &psf, err);
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
    hada_status status = hada_cli_scenes_get(&recipe->scenes, number % recipe->training_count, &scene, &name, err);
    if (!status) {
        hada_plane plane = {z, &scene};
        status = hada_simulator_render(simulator, &plane, 1, recipe->noise,
                                       recipe->seed + NOISE_OF_PAIRS + (uint64_t)number, &raw, err);
    }
    if (!status)
        status = save(raw_folder, name, &raw, recipe->bits, err);
    if (!status)
        status = save(scene_folder, name, &scene, recipe->bits, err);
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
        status = hada_cli_make_folder(raw, err);
    if (!status)
        status = hada_cli_make_folder(scene, err);
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

/* `count` different depths out of `depths`, ascending, from a seed. */
static void choose_depths(uint64_t seed, int depths, int count, int *out)
{
    int found = 0;
    for (int z = 0; z < depths && found < count; z++) {
        seed = seed * 6364136223846793005u + 1442695040888963407u;
        if ((int)((seed >> 33) % (uint64_t)(depths - z)) < count - found)
            out[found++] = z;
    }
}

/* A scene cut into regions that stand at different depths. */
typedef struct cut {
    hada_image whole, map;
    hada_image *planes; /* one per occupied depth */
    int *depths, *labels;
    int count;
} cut;

static void cut_free(cut *scene)
{
    for (int k = 0; scene->planes && k < scene->count; k++)
        hada_image_destroy(&scene->planes[k]);
    hada_image_destroy(&scene->whole);
    hada_image_destroy(&scene->map);
    free(scene->planes);
    free(scene->depths);
    free(scene->labels);
}

static hada_status cut_make(cut *scene, const hada_cli_recipe *recipe, const hada_camera *camera, int t,
                            hada_error *err)
{
    size_t pixels = (size_t)camera->window_rows * (size_t)camera->window_cols;
    uint64_t seed = recipe->seed + 77777u * (uint64_t)(t + 1);
    const hada_cli_scenes *source = recipe->other_test_scenes ? &recipe->test_scenes : &recipe->scenes;
    /* Behind those of the pairs. */
    int number = t;
    if (!recipe->other_test_scenes)
        number += source->folder ? recipe->training_count : camera->depths * recipe->pairs;
    scene->count = recipe->test_depths;
    scene->planes = calloc((size_t)scene->count, sizeof *scene->planes);
    scene->depths = calloc((size_t)scene->count, sizeof *scene->depths);
    scene->labels = calloc(pixels, sizeof *scene->labels);
    if (!scene->planes || !scene->depths || !scene->labels)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    choose_depths(seed, camera->depths, scene->count, scene->depths);
    hada_status status = hada_cli_scenes_get(source, number, &scene->whole, NULL, err);
    if (!status)
        status = hada_scene_regions(scene->labels, seed, scene->count, camera->window_rows, camera->window_cols, err);
    if (!status)
        status = hada_image_create(&scene->map, 1, camera->window_rows, camera->window_cols, err);
    for (int k = 0; !status && k < scene->count; k++)
        status = hada_scene_part(&scene->planes[k], &scene->whole, scene->labels, k, err);
    for (size_t i = 0; !status && i < pixels; i++)
        scene->map.data[i] = (float)camera->distances_mm[scene->depths[scene->labels[i]]];
    return status;
}

static hada_status write_truth_stack(const cut *scene, const hada_camera *camera, const char *folder, const char *name,
                                     hada_error *err)
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
        status = hada_tiff_write(writer, here ? &scene->planes[k] : &dark, err);
        k += here;
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
    cut scene = {0};
    hada_image raw = {0};
    char name[32], map_name[48], aif_name[48];
    snprintf(name, sizeof name, "test%02d", t + 1);
    snprintf(map_name, sizeof map_name, "%s_depth", name);
    snprintf(aif_name, sizeof aif_name, "%s_aif", name);
    hada_plane *planes = calloc((size_t)recipe->test_depths, sizeof *planes);
    hada_status status = planes ? HADA_OK : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status)
        status = cut_make(&scene, recipe, camera, t, err);
    for (int k = 0; !status && k < scene.count; k++)
        planes[k] = (hada_plane){scene.depths[k], &scene.planes[k]};
    if (!status)
        status = hada_simulator_render(simulator, planes, scene.count, recipe->noise,
                                       recipe->seed + NOISE_OF_TESTS + (uint64_t)t, &raw, err);
    if (!status)
        status = save(raw_folder, name, &raw, recipe->bits, err);
    if (!status)
        status = write_truth_stack(&scene, camera, truth_folder, name, err);
    if (!status)
        status = save(truth_folder, map_name, &scene.map, 32, err);
    if (!status)
        status = save(truth_folder, aif_name, &scene.whole, 32, err);
    cut_free(&scene);
    hada_image_destroy(&raw);
    free(planes);
    return status;
}

static hada_status write_tests(hada_cli *cli, hada_simulator *simulator, const hada_cli_recipe *recipe, hada_error *err)
{
    char *raw = hada_cli_text("%s/test/raw", recipe->folder), *truth = hada_cli_text("%s/test/truth", recipe->folder);
    hada_status status = raw && truth ? HADA_OK : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status)
        status = hada_cli_make_folder(raw, err);
    if (!status)
        status = hada_cli_make_folder(truth, err);
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
        status = write_psf(simulator, recipe->folder, err);
    for (int z = 0; !status && z < camera->depths; z++)
        status = write_depth(cli, simulator, recipe, z, err);
    if (!status && recipe->tests)
        status = write_tests(cli, simulator, recipe, err);
    return status;
}
