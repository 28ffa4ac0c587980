#include "scene_source.h"
#include "folder.h"

#include <hadalens/scene.h>
#include <hadalens/tiff.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>

hada_status hada_cli_scenes_open(hada_cli_scenes *scenes, const char *folder, uint64_t seed, int channels, int rows,
                                 int cols, hada_error *err)
{
    *scenes = (hada_cli_scenes){.seed = seed, .channels = channels, .rows = rows, .cols = cols, .count = INT_MAX};
    if (!strcmp(folder, "procedural"))
        return HADA_OK;
    hada_status status = hada_cli_list_tiffs(folder, &scenes->names, &scenes->count, err);
    if (!status && !scenes->count)
        status = hada_cli_error(err, HADA_ERROR_DATASET,
                                "the folder %s holds no TIFF pictures; '--scenes procedural' draws some", folder);
    if (!status && !(scenes->folder = strdup(folder)))
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (status)
        hada_cli_scenes_close(scenes);
    return status;
}

void hada_cli_scenes_close(hada_cli_scenes *scenes)
{
    if (scenes->names)
        hada_cli_free_names(&scenes->names, &scenes->count);
    free(scenes->folder);
    memset(scenes, 0, sizeof *scenes);
}

/* Grey from colour by the mean, colour from grey by repeating. */
static hada_status set_channels(hada_image *image, int channels, hada_error *err)
{
    hada_image other;
    if (image->channels == channels)
        return HADA_OK;
    hada_status status = hada_image_create(&other, channels, image->rows, image->cols, err);
    if (status)
        return status;
    size_t plane = (size_t)image->rows * (size_t)image->cols;
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

static hada_status load(const hada_cli_scenes *scenes, const char *path, hada_image *image, hada_error *err)
{
    hada_image picture = {0};
    hada_status status = hada_tiff_load(path, 0, &picture, err);
    size_t bad = status ? 0 : hada_image_count_not_finite(&picture);
    if (!status && bad)
        status = hada_cli_error(err, HADA_ERROR_NOT_FINITE, "%zu pixels are NaN or infinite", bad);
    if (!status)
        status = set_channels(&picture, scenes->channels, err);
    if (!status)
        status = hada_scene_fit(image, &picture, scenes->rows, scenes->cols, err);
    hada_image_destroy(&picture);
    if (status)
        hada_cli_prefix(err, "%s: ", path);
    return status;
}

hada_status hada_cli_scenes_get(const hada_cli_scenes *scenes, int index, hada_image *image, char **name,
                                hada_error *err)
{
    hada_status status;
    char *text;
    if (scenes->folder) {
        const char *file = scenes->names[index % scenes->count];
        char *path = hada_cli_text("%s/%s", scenes->folder, file);
        status = path ? load(scenes, path, image, err) : hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
        free(path);
        text = hada_cli_stem(file);
    } else {
        /* Far apart in the seed, so that neighbouring numbers share nothing. */
        uint64_t seed = scenes->seed * 0x9E3779B97F4A7C15u + (uint64_t)index;
        status = hada_scene_procedural(image, seed, scenes->channels, scenes->rows, scenes->cols, err);
        text = hada_cli_text("scene%04d", index + 1);
    }
    if (!status && !text) {
        hada_image_destroy(image);
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    }
    if (!status && name)
        *name = text;
    else
        free(text);
    return status;
}
