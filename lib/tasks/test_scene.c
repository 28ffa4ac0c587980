#include "tasks/simulated_scenes.h"

/* Opaque objects are two in so many regions for each depth: small enough for the outer lenses to see past. */
enum { REGIONS_OF_OBJECTS = 8, REGIONS_OF_ONE = 2 };

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

void hada_test_scene_free(hada_test_scene *scene)
{
    for (int k = 0; k < scene->count; k++) {
        if (scene->planes)
            hada_image_destroy(&scene->planes[k]);
        if (scene->opacity)
            hada_image_destroy(&scene->opacity[k]);
    }
    hada_image_destroy(&scene->whole);
    hada_image_destroy(&scene->map);
    hada_image_destroy(&scene->light[0]);
    hada_image_destroy(&scene->light[1]);
    hada_image_destroy(&scene->over);
    HADA_FREE(scene->planes, scene->opacity, scene->depths);
    memset(scene, 0, sizeof *scene);
}

static hada_status cut(hada_test_scene *scene, const int *labels, const hada_camera *camera, hada_error *err)
{
    for (int k = 0; k < scene->count; k++)
        HADA_TRY(hada_scene_part(&scene->planes[k], &scene->whole, labels, k, err));
    for (size_t i = 0; i < hada_image_count(&scene->map); i++)
        scene->map.data[i] = (float)camera->distances_mm[scene->depths[labels[i]]];
    return HADA_OK;
}

/* An object for the plane k: a piece of another picture. It covers what is behind it, as seen from the middle. */
static hada_status put_object(hada_test_scene *scene, int k, const hada_image *picture, const int *labels,
                              const hada_camera *camera, hada_error *err)
{
    const size_t pixels = hada_image_count(&scene->map);
    HADA_TRY(hada_image_create(&scene->planes[k], picture->channels, picture->rows, picture->cols, err));
    HADA_TRY(hada_image_create(&scene->opacity[k], 1, picture->rows, picture->cols, err));
    for (size_t i = 0; i < hada_image_count(picture); i++) {
        const size_t at = i % pixels;
        if (labels[at] / REGIONS_OF_ONE != k)
            continue;
        scene->opacity[k].data[at] = 1.0f;
        scene->planes[k].data[i] = scene->whole.data[i] = picture->data[i];
        scene->map.data[at] = (float)camera->distances_mm[scene->depths[k]];
    }
    return HADA_OK;
}

static hada_status stack(hada_test_scene *scene, const int *labels, const hada_scenes *source, int number, int step,
                         const hada_camera *camera, hada_error *err)
{
    const int last = scene->count - 1;
    const hada_image *whole = &scene->whole;
    hada_image picture = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(scene->opacity, (size_t)scene->count, "a test scene", err));
    HADA_TRY_OR_DONE(hada_image_crop(&scene->planes[last], whole, 0, 0, whole->rows, whole->cols, err));
    for (size_t i = 0; i < hada_image_count(&scene->map); i++)
        scene->map.data[i] = (float)camera->distances_mm[scene->depths[last]];
    for (int k = last - 1; k >= 0; k--) {
        HADA_TRY_OR_DONE(hada_scenes_get(source, number + step * (k + 1), &picture, NULL, err));
        HADA_TRY_OR_DONE(put_object(scene, k, &picture, labels, camera, err));
        hada_image_destroy(&picture);
    }
done:
    hada_image_destroy(&picture);
    return status;
}

hada_status hada_test_scene_make(hada_test_scene *scene, const hada_scenes *source, int number, int step,
                                 const hada_camera *camera, int count, int occlude, uint64_t seed, hada_error *err)
{
    const int rows = source->rows, cols = source->cols;
    int *labels = NULL;
    hada_status status = HADA_OK;
    *scene = (hada_test_scene){.count = count};
    HADA_TRY_OR_DONE(HADA_NEW(scene->planes, (size_t)count, "a test scene", err));
    HADA_TRY_OR_DONE(HADA_NEW(scene->depths, (size_t)count, "a test scene", err));
    HADA_TRY_OR_DONE(HADA_NEW(labels, (size_t)rows * (size_t)cols, "a test scene", err));
    choose_depths(seed, camera->depths, count, scene->depths);
    HADA_TRY_OR_DONE(hada_scenes_get(source, number, &scene->whole, NULL, err));
    HADA_TRY_OR_DONE(hada_scene_regions(labels, seed, occlude ? REGIONS_OF_OBJECTS * count : count, rows, cols, err));
    HADA_TRY_OR_DONE(hada_image_create(&scene->map, 1, rows, cols, err));
    HADA_TRY_OR_DONE(occlude ? stack(scene, labels, source, number, step, camera, err)
                             : cut(scene, labels, camera, err));
done:
    free(labels);
    return status;
}

hada_status hada_test_scene_render(const hada_test_scene *scene, hada_simulator *simulator, double noise, uint64_t seed,
                                   hada_image *raw, hada_error *err)
{
    hada_plane *planes = NULL;
    const hada_image **opacity = NULL;
    const hada_relief reliefs[] = {{&scene->light[0], &scene->map}, {&scene->light[1], &scene->over}};
    hada_status status = HADA_OK;
    if (scene->surfaces)
        return hada_simulator_render_reliefs(simulator, reliefs, scene->surfaces, scene->opaque, noise, seed, raw, err);
    HADA_TRY_OR_DONE(HADA_NEW(planes, (size_t)scene->count, "a test scene", err));
    HADA_TRY_OR_DONE(HADA_NEW(opacity, (size_t)scene->count, "a test scene", err));
    for (int k = 0; k < scene->count; k++) {
        planes[k] = (hada_plane){scene->depths[k], &scene->planes[k]};
        opacity[k] = scene->opacity && scene->opacity[k].data ? &scene->opacity[k] : NULL;
    }
    if (scene->opacity)
        HADA_TRY_OR_DONE(
            hada_simulator_render_occluded(simulator, planes, opacity, scene->count, -1, noise, seed, raw, err));
    else
        HADA_TRY_OR_DONE(hada_simulator_render(simulator, planes, scene->count, noise, seed, raw, err));
done:
    HADA_FREE(planes, opacity);
    return status;
}
