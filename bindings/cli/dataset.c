#include "dataset.h"
#include "folder.h"

#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* "z100mm", "z250.5mm": the distance; negative for other names. */
static double folder_distance(const char *name)
{
    char *end;
    if (name[0] != 'z' || (name[1] < '0' || name[1] > '9'))
        return -1;
    double distance = strtod(name + 1, &end);
    return !strcmp(end, "mm") && isfinite(distance) ? distance : -1;
}

static int by_distance(const void *a, const void *b)
{
    const hada_cli_depth *one = a, *two = b;
    return (one->distance_mm > two->distance_mm) - (one->distance_mm < two->distance_mm);
}

/* The file of `names` with the same stem as `name`, or NULL. */
static const char *partner(const char *name, char **names, int count)
{
    size_t stem = (size_t)(strrchr(name, '.') - name);
    for (int i = 0; i < count; i++)
        if ((size_t)(strrchr(names[i], '.') - names[i]) == stem && !strncmp(names[i], name, stem))
            return names[i];
    return NULL;
}

static void note_incomplete(hada_cli_dataset *set, const char *folder, const char *kind, const char *name,
                            const char *other)
{
    size_t used = strlen(set->incomplete_text);
    if (set->incomplete++ < 4)
        snprintf(set->incomplete_text + used, sizeof set->incomplete_text - used, "%s%s/%s/%s has no %s",
                 used ? "; " : "", folder, kind, name, other);
    else if (set->incomplete == 5)
        snprintf(set->incomplete_text + used, sizeof set->incomplete_text - used, "; and so on");
}

static hada_status scan_depth(hada_cli_dataset *set, hada_cli_depth *depth, hada_error *err)
{
    char **raws = NULL, **scenes = NULL;
    int raw_count = 0, scene_count = 0;
    hada_status status = HADA_OK;
    char *raw_folder = hada_cli_text("%s/raw", depth->folder), *scene_folder = hada_cli_text("%s/scene", depth->folder);
    if (!raw_folder || !scene_folder)
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status && !hada_cli_is_folder(raw_folder))
        status = hada_cli_error(err, HADA_ERROR_DATASET,
                                "%s has no folder 'raw'; a depth needs raw/NAME.tif and scene/NAME.tif", depth->folder);
    if (!status)
        status = hada_cli_list_tiffs(raw_folder, &raws, &raw_count, err);
    if (!status && hada_cli_is_folder(scene_folder))
        status = hada_cli_list_tiffs(scene_folder, &scenes, &scene_count, err);
    if (!status && raw_count)
        depth->pair = calloc((size_t)raw_count, sizeof *depth->pair);
    if (!status && raw_count && !depth->pair)
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    for (int i = 0; !status && i < raw_count; i++) {
        const char *scene = partner(raws[i], scenes, scene_count);
        if (!scene) {
            note_incomplete(set, depth->folder, "raw", raws[i], "scene");
            continue;
        }
        hada_cli_pair *pair = &depth->pair[depth->pairs++];
        pair->raw = hada_cli_text("%s/%s", raw_folder, raws[i]);
        pair->scene = hada_cli_text("%s/%s", scene_folder, scene);
        if (!pair->raw || !pair->scene)
            status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    }
    for (int i = 0; !status && i < scene_count; i++)
        if (!partner(scenes[i], raws, raw_count))
            note_incomplete(set, depth->folder, "scene", scenes[i], "raw frame");
    hada_cli_free_names(&raws, &raw_count);
    hada_cli_free_names(&scenes, &scene_count);
    free(raw_folder);
    free(scene_folder);
    return status;
}

static hada_status find_depths(hada_cli_dataset *set, const char *folder, hada_error *err)
{
    DIR *open = opendir(folder);
    if (!open)
        return hada_cli_error(err, HADA_ERROR_FILE_OPEN, "the data set %s cannot be read: %s", folder, strerror(errno));
    struct dirent *entry;
    hada_status status = HADA_OK;
    while (!status && (entry = readdir(open))) {
        double distance = folder_distance(entry->d_name);
        if (distance < 0)
            continue;
        hada_cli_depth *more = realloc(set->depth, (size_t)(set->depths + 1) * sizeof *more);
        char *path = hada_cli_text("%s/%s", folder, entry->d_name);
        if (more)
            set->depth = more;
        if (!more || !path) {
            free(path);
            status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
        } else {
            set->depth[set->depths++] = (hada_cli_depth){.distance_mm = distance, .folder = path};
        }
    }
    closedir(open);
    if (!status && !set->depths)
        return hada_cli_error(
            err, HADA_ERROR_DATASET,
            "%s holds no folder named z<distance>mm; a data set looks like %s/z100mm/raw/NAME.tif and "
            "%s/z100mm/scene/NAME.tif",
            folder, folder, folder);
    if (!status)
        qsort(set->depth, (size_t)set->depths, sizeof *set->depth, by_distance);
    return status;
}

static hada_status scan(hada_cli_dataset *set, const char *folder, int skip_incomplete, hada_error *err)
{
    hada_status status = find_depths(set, folder, err);
    for (int z = 0; !status && z < set->depths; z++)
        status = scan_depth(set, &set->depth[z], err);
    if (status)
        return status;
    if (set->incomplete && !skip_incomplete)
        return hada_cli_error(err, HADA_ERROR_DATASET,
                              "%d %s no partner: %s. Add what is missing, or leave these out with --skip-incomplete",
                              set->incomplete, set->incomplete == 1 ? "file has" : "files have", set->incomplete_text);
    set->distances_mm = calloc((size_t)set->depths, sizeof *set->distances_mm);
    if (!set->distances_mm)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    set->least_pairs = set->depth[0].pairs;
    for (int z = 0; z < set->depths; z++) {
        const hada_cli_depth *depth = &set->depth[z];
        if (!depth->pairs)
            return hada_cli_error(err, HADA_ERROR_DATASET,
                                  "%s holds no pair of raw/NAME.tif and scene/NAME.tif; add some or move the folder "
                                  "away",
                                  depth->folder);
        if (z && depth->distance_mm <= set->depth[z - 1].distance_mm)
            return hada_cli_error(err, HADA_ERROR_DATASET, "%s and %s stand for the same distance",
                                  set->depth[z - 1].folder, depth->folder);
        set->distances_mm[z] = depth->distance_mm;
        set->pairs += depth->pairs;
        set->least_pairs = depth->pairs < set->least_pairs ? depth->pairs : set->least_pairs;
    }
    set->psf = hada_cli_text("%s/psf.tif", folder);
    set->camera = hada_cli_text("%s/camera.json", folder);
    if (!set->psf || !set->camera)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!hada_cli_is_file(set->psf)) {
        free(set->psf);
        set->psf = NULL;
    }
    if (!hada_cli_is_file(set->camera)) {
        free(set->camera);
        set->camera = NULL;
    }
    return HADA_OK;
}

hada_status hada_cli_dataset_scan(hada_cli_dataset *set, const char *folder, int skip_incomplete, hada_error *err)
{
    memset(set, 0, sizeof *set);
    hada_status status = scan(set, folder, skip_incomplete, err);
    if (status)
        hada_cli_dataset_free(set);
    return status;
}

void hada_cli_dataset_free(hada_cli_dataset *set)
{
    for (int z = 0; z < set->depths; z++) {
        for (int i = 0; set->depth[z].pair && i < set->depth[z].pairs; i++) {
            free(set->depth[z].pair[i].raw);
            free(set->depth[z].pair[i].scene);
        }
        free(set->depth[z].pair);
        free(set->depth[z].folder);
    }
    free(set->depth);
    free(set->distances_mm);
    free(set->psf);
    free(set->camera);
    memset(set, 0, sizeof *set);
}
