#include "tasks/simulated_scenes.h"

#include <hadalens/response.h>
#include <hadalens/scene.h>
#include <hadalens/tiff.h>
#include <limits.h>

#include "io/folder.h"

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
