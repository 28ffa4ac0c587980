/* Scenes of a simulated data set: pictures or drawn ones, on surfaces, at several depths. */
#include <hadalens/folder.h>
#include <hadalens/metrics.h>
#include <hadalens/tiff.h>
#include <limits.h>

#include "io/folder.h"
#include "tasks/simulated_scenes.h"

/* Far apart in the seed, so that neighbouring numbers share nothing: 2^64 over the golden ratio, odd. */
#define SEED_STEP 0x9E3779B97F4A7C15u

hada_status hada_scenes_open(hada_scenes *scenes, const char *folder, uint64_t seed, int channels, int rows, int cols,
                             hada_error *err)
{
    *scenes = (hada_scenes){.folder = folder,
                            .seed = seed,
                            .channels = channels,
                            .rows = rows,
                            .cols = cols,
                            .count = INT_MAX,
                            .response = HADA_RESPONSE_LINEAR};
    if (!folder)
        return HADA_OK;
    HADA_TRY(hada_folder_list_tiffs(folder, &scenes->names, &scenes->count, err));
    if (!scenes->count)
        HADA_TRY(hada_fail(err, HADA_ERROR_DATASET,
                           "the folder %s holds no TIFF pictures; 'options.scenes procedural' draws some", folder));
    return HADA_OK;
}

void hada_scenes_close(hada_scenes *scenes)
{
    if (scenes->names)
        hada_names_free(&scenes->names, &scenes->count);
    *scenes = (hada_scenes){0};
}

/* Grey from colour by the mean, colour from grey by repeating. */
static hada_status set_channels(hada_image *image, int channels, hada_error *err)
{
    hada_image other;
    if (image->channels == channels)
        return HADA_OK;
    HADA_TRY(hada_image_create(&other, channels, image->rows, image->cols, err));
    const size_t plane = (size_t)image->rows * (size_t)image->cols;
    for (int c = 0; c < channels; c++)
        for (size_t i = 0; i < plane; i++) {
            float sum = 0;
            for (int k = 0; k < image->channels; k++)
                sum += image->data[(size_t)k * plane + i];
            other.data[(size_t)c * plane + i] = sum / (float)image->channels;
        }
    hada_image_destroy(image);
    *image = other;
    return HADA_OK;
}

static hada_status load(const hada_scenes *scenes, const char *path, hada_image *image, hada_error *err)
{
    hada_image picture = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_tiff_load(path, 0, &picture, err));
    const size_t bad = hada_image_count_not_finite(&picture);
    if (bad)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_NOT_FINITE, "%zu pixels are NaN or infinite", bad));
    HADA_TRY_OR_DONE(set_channels(&picture, scenes->channels, err));
    HADA_TRY_OR_DONE(hada_scene_fit(image, &picture, scenes->rows, scenes->cols, err));
done:
    hada_image_destroy(&picture);
    return hada_named(status, path, err);
}

hada_status hada_scenes_get(const hada_scenes *scenes, int index, hada_image *image, char **name, hada_error *err)
{
    char *text = NULL;
    hada_path path;
    hada_status status = HADA_OK;
    if (scenes->folder) {
        const char *file = scenes->names[index % scenes->count];
        HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/%s", scenes->folder, file));
        HADA_TRY_OR_DONE(hada_path_stem(&text, file, err));
        HADA_TRY_OR_DONE(load(scenes, path, image, err));
    } else {
        HADA_TRY_OR_DONE(hada_path_format(&text, err, "scene%04d", index + 1));
        HADA_TRY_OR_DONE(hada_scene_procedural(image, scenes->seed * SEED_STEP + (uint64_t)index, scenes->channels,
                                               scenes->rows, scenes->cols, err));
    }
    hada_response_convert(image->data, hada_image_count(image), scenes->response, HADA_RESPONSE_LINEAR);
    if (name) {
        *name = text;
        text = NULL;
    }
done:
    free(text);
    return status;
}

/* Kinds beside those of hada_relief_kind. */
static const char outside_word[] = "outside", overlap_word[] = "overlap";

/* 'outside' leans beyond both ends by so many depth steps, or this share of the range where that is more; its far end
 * comes this near to infinity. */
#define OUTSIDE_STEPS 2.0
#define OUTSIDE_SHARE 0.15
#define OUTSIDE_FAR   0.9
/* Where the two surfaces of 'overlap' are. */
#define OVERLAP_NEAR 0.25f
#define OVERLAP_FAR  0.75f

static int is_kind(const char *word)
{
    return hada_enum_value(HADA_ENUM_RELIEF, word) >= 0 || !strcmp(word, outside_word) || !strcmp(word, overlap_word);
}

static hada_status add_word(hada_surface_words *words, const char *text, size_t length, hada_error *err)
{
    char **word = &words->words[words->count];
    HADA_TRY(hada_path_format(word, err, "%.*s", (int)length, text));
    words->count++;
    if (!is_kind(*word) && !hada_path_is_file(*word))
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "'%s' is neither a kind of surface (slant, half, hill, ball, steps, bars, overlap, outside) "
                           "nor a file with a distance map",
                           *word));
    return HADA_OK;
}

hada_status hada_surface_words_read(hada_surface_words *words, const char *list, hada_error *err)
{
    size_t room = 1;
    *words = (hada_surface_words){0};
    for (const char *at = list; *at; at++)
        room += *at == ',';
    HADA_TRY(HADA_NEW(words->words, room, "a list of surfaces", err));
    for (const char *at = list;; at++) {
        const size_t length = strcspn(at, ",");
        HADA_TRY(add_word(words, at, length, err));
        at += length;
        if (!*at)
            break;
    }
    return HADA_OK;
}

void hada_surface_words_free(hada_surface_words *words)
{
    for (int i = 0; i < words->count; i++)
        free(words->words[i]);
    free(words->words);
    *words = (hada_surface_words){0};
}

const char *hada_surface_name(const hada_surface_words *words, int test)
{
    const char *word = words->words[test % words->count];
    return is_kind(word) ? word : "surface";
}

/* From shares of the range, linear in 1/z, to millimetres, in place. */
static void to_distances(hada_image *map, const hada_camera *camera, double from, double to)
{
    const double near = 1.0 / camera->distances_mm[0], far = 1.0 / camera->distances_mm[camera->depths - 1];
    for (size_t i = 0; i < hada_image_count(map); i++) {
        const double share = from + (to - from) * (double)map->data[i];
        map->data[i] = (float)(1.0 / (near + (far - near) * share));
    }
}

static hada_status make_outside(hada_image *map, const hada_scenes *source, const hada_camera *camera, uint64_t seed,
                                hada_error *err)
{
    const double near = 1.0 / camera->distances_mm[0], far = 1.0 / camera->distances_mm[camera->depths - 1],
                 over = fmax(OUTSIDE_SHARE, OUTSIDE_STEPS / (camera->depths - 1));
    HADA_TRY(hada_scene_relief(map, HADA_RELIEF_SLANT, seed, source->rows, source->cols, err));
    to_distances(map, camera, -over, 1.0 + fmin(over, OUTSIDE_FAR * far / (near - far)));
    return HADA_OK;
}

/* The middle of a map with the source's aspect ratio, each pixel that of the map which is nearest: means would give
 * values where nothing is. */
static hada_status fit_map(hada_image *out, const hada_image *map, const hada_scenes *source, hada_error *err)
{
    const double scale = fmin((double)map->rows / source->rows, (double)map->cols / source->cols);
    const double row0 = (map->rows - scale * source->rows) / 2.0, col0 = (map->cols - scale * source->cols) / 2.0;
    HADA_TRY(hada_image_create(out, 1, source->rows, source->cols, err));
    for (int r = 0; r < source->rows; r++)
        for (int c = 0; c < source->cols; c++) {
            const int row = (int)(row0 + scale * (r + 0.5)), col = (int)(col0 + scale * (c + 0.5));
            out->data[(size_t)r * (size_t)source->cols + (size_t)c] =
                map->data[(size_t)row * (size_t)map->cols + (size_t)col];
        }
    return HADA_OK;
}

/* Floats are millimetres, NaN where nothing is; integers are shares of the range of depths. */
static hada_status read_map(hada_image *out, const char *path, const hada_scenes *source, const hada_camera *camera,
                            hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    hada_image map = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_tiff_open(&reader, path, err));
    HADA_TRY_OR_DONE(hada_tiff_read(reader, 0, &map, err));
    if (map.channels != 1)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_SIZE, "a distance map has one channel, not %d", map.channels));
    if (!hada_tiff_get_info(reader)->is_float)
        to_distances(&map, camera, 0.0, 1.0);
    HADA_TRY_OR_DONE(fit_map(out, &map, source, err));
    for (size_t i = 0; i < hada_image_count(out); i++)
        if (!isnan(out->data[i]) && !(out->data[i] > 0.0f && isfinite(out->data[i])))
            HADA_TRY_OR_DONE(
                hada_fail(err, HADA_ERROR_DATASET,
                          "a distance of %g is not possible; floats are millimetres above 0, or NaN where nothing is, "
                          "integers are shares of the range of depths",
                          (double)out->data[i]));
done:
    hada_tiff_close(&reader);
    hada_image_destroy(&map);
    return hada_named(status, path, err);
}

static hada_status make_map(hada_image *map, const char *word, const hada_scenes *source, const hada_camera *camera,
                            uint64_t seed, hada_error *err)
{
    if (!strcmp(word, outside_word))
        return make_outside(map, source, camera, seed, err);
    if (!is_kind(word))
        return read_map(map, word, source, camera, err);
    HADA_TRY(hada_scene_relief(map, (hada_relief_kind)hada_enum_value(HADA_ENUM_RELIEF, word), seed, source->rows,
                               source->cols, err));
    to_distances(map, camera, 0.0, 1.0);
    return HADA_OK;
}

/* A second picture, see-through, over about half of the first: where both are, each gives half of its light. */
static hada_status lay_over(hada_test_scene *scene, const hada_scenes *source, int number, const hada_camera *camera,
                            uint64_t seed, hada_error *err)
{
    hada_image *under = &scene->light[0], *over = &scene->light[1];
    const size_t pixels = hada_image_count(&scene->map);
    int *labels = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_scenes_get(source, number, over, NULL, err));
    HADA_TRY_OR_DONE(hada_image_create(&scene->over, 1, over->rows, over->cols, err));
    HADA_TRY_OR_DONE(HADA_NEW(labels, pixels, "a test scene", err));
    HADA_TRY_OR_DONE(hada_scene_regions(labels, seed, 2, over->rows, over->cols, err));
    for (size_t i = 0; i < pixels; i++) {
        scene->map.data[i] = OVERLAP_FAR;
        scene->over.data[i] = OVERLAP_NEAR;
    }
    to_distances(&scene->map, camera, 0.0, 1.0);
    to_distances(&scene->over, camera, 0.0, 1.0);
    for (size_t i = 0; i < hada_image_count(over); i++) {
        const int both = labels[i % pixels];
        under->data[i] *= both ? 0.5f : 1.0f;
        over->data[i] *= both ? 0.5f : 0.0f;
        scene->whole.data[i] = under->data[i] + over->data[i];
    }
    for (size_t i = 0; i < pixels; i++)
        if (!labels[i])
            scene->over.data[i] = NAN;
    scene->surfaces = 2;
done:
    free(labels);
    return status;
}

/* Light to the planes of the two depths nearest to each pixel; beyond the ends to the last. */
static void share_out(hada_test_scene *scene, const hada_image *light, const hada_image *map, const hada_camera *camera)
{
    const size_t pixels = hada_image_count(map);
    const double last = camera->depths - 1;
    for (size_t i = 0; i < pixels; i++) {
        if (isnan(map->data[i]))
            continue;
        const double at =
            fmin(fmax(hada_depth_index(camera->distances_mm, camera->depths, (double)map->data[i]), 0.0), last);
        const int z = (int)at < camera->depths - 1 ? (int)at : camera->depths - 2;
        for (int c = 0; c < light->channels; c++) {
            const size_t k = (size_t)c * pixels + i;
            scene->planes[z].data[k] += (float)(z + 1 - at) * light->data[k];
            scene->planes[z + 1].data[k] += (float)(at - z) * light->data[k];
        }
    }
}

hada_status hada_test_surface_make(hada_test_scene *scene, const hada_surface_words *words, int test,
                                   const hada_scenes *source, int number, int step, const hada_camera *camera,
                                   int opaque, uint64_t seed, hada_error *err)
{
    const char *word = words->words[test % words->count];
    /* hills have no plain shape */
    const uint64_t shape =
        test < words->count && (hada_relief_kind)hada_enum_value(HADA_ENUM_RELIEF, word) != HADA_RELIEF_HILL ? 0 : seed;
    const int overlap = !strcmp(word, overlap_word);
    *scene = (hada_test_scene){.count = camera->depths, .surfaces = 1, .opaque = opaque && !overlap};
    HADA_TRY(HADA_NEW(scene->planes, (size_t)scene->count, "a test scene", err));
    HADA_TRY(HADA_NEW(scene->depths, (size_t)scene->count, "a test scene", err));
    HADA_TRY(hada_scenes_get(source, number, &scene->light[0], NULL, err));
    const hada_image *light = &scene->light[0];
    HADA_TRY(hada_image_crop(&scene->whole, light, 0, 0, light->rows, light->cols, err));
    if (overlap) {
        HADA_TRY(hada_image_create(&scene->map, 1, light->rows, light->cols, err));
        HADA_TRY(lay_over(scene, source, number + step, camera, seed, err));
    } else {
        HADA_TRY(make_map(&scene->map, word, source, camera, shape, err));
    }
    const size_t pixels = hada_image_count(&scene->map);
    for (size_t i = 0; i < hada_image_count(&scene->whole); i++)
        if (isnan(scene->map.data[i % pixels]))
            scene->whole.data[i] = 0.0f;
    for (int z = 0; z < scene->count; z++) {
        scene->depths[z] = z;
        HADA_TRY(hada_image_create(&scene->planes[z], light->channels, light->rows, light->cols, err));
    }
    share_out(scene, &scene->light[0], &scene->map, camera);
    if (overlap)
        share_out(scene, &scene->light[1], &scene->over, camera);
    return HADA_OK;
}

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
