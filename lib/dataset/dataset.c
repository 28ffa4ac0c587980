/* What a data set gives: counts, names, pictures, and its two parts. */
#include "dataset/dataset.h"

#include <hadalens/tiff.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "io/folder.h"

void hada_dataset_destroy(hada_dataset **dataset)
{
    if (!dataset)
        return;
    hada_dataset *set = *dataset;
    *dataset = NULL;
    if (!set)
        return;
    for (int z = 0; z < set->info.depths; z++) {
        for (int i = 0; i < set->depth[z].count; i++) {
            free(set->depth[z].pair[i].raw);
            free(set->depth[z].pair[i].scene);
        }
        free(set->depth[z].pair);
        free(set->depth[z].folder);
    }
    free(set->depth);
    free(set->distances_mm);
    free(set->counts);
    hada_inputs_release(&set->inputs);
    free(set->psf);
    free(set->camera);
    free(set);
}

const hada_dataset_info *hada_dataset_get_info(const hada_dataset *dataset)
{
    if (!dataset)
        return NULL;
    return &dataset->info;
}

const char *hada_dataset_folder(const hada_dataset *dataset, int depth)
{
    if (!dataset)
        return NULL;
    return dataset->depth[depth].folder;
}

const char *hada_dataset_raw_path(const hada_dataset *dataset, int depth, int pair)
{
    if (!dataset)
        return NULL;
    return dataset->depth[depth].pair[pair].raw;
}

const char *hada_dataset_scene_path(const hada_dataset *dataset, int depth, int pair)
{
    if (!dataset)
        return NULL;
    return dataset->depth[depth].pair[pair].scene;
}

int hada_dataset_has_files(const hada_dataset *dataset)
{
    return !dataset->read;
}

static hada_status read_callers(const hada_dataset *dataset, int depth, const hada_dataset_pair *pair, hada_image *raw,
                                hada_image *scene, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(dataset->read(dataset->user, depth, pair->number, raw, scene, err));
    if (!raw->data || !scene->data)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_DATASET, "no images were given for %s", pair->raw));
done:
    if (status) {
        hada_image_destroy(raw);
        hada_image_destroy(scene);
    }
    return status;
}

hada_status hada_dataset_read(const hada_dataset *dataset, int depth, int pair, hada_image *raw, hada_image *scene,
                              hada_error *err)
{
    HADA_NEED(dataset && raw && scene, err);
    const hada_dataset_pair *files = &dataset->depth[depth].pair[pair];
    memset(raw, 0, sizeof *raw);
    memset(scene, 0, sizeof *scene);
    if (dataset->read)
        return read_callers(dataset, depth, files, raw, scene, err);
    hada_status status = hada_tiff_load(files->raw, 0, raw, err);
    if (status) {
        hada_error_prefix_path(err, files->raw);
        return status;
    }
    status = hada_tiff_load(files->scene, 0, scene, err);
    if (status) {
        hada_error_prefix_path(err, files->scene);
        hada_image_destroy(raw);
    }
    return status;
}

hada_status hada_dataset_count(hada_dataset *set, hada_error *err)
{
    hada_dataset_info *info = &set->info;
    HADA_TRY(hada_allocated(set->distances_mm = hada_alloc((size_t)info->depths, sizeof(double), "a data set", err)));
    HADA_TRY(hada_allocated(set->counts = hada_alloc((size_t)info->depths, sizeof(int), "a data set", err)));
    info->distances_mm = set->distances_mm;
    info->counts = set->counts;
    info->incomplete_text = set->incomplete_text;
    info->psf = set->psf;
    info->camera = set->camera;
    info->pairs = 0;
    info->least_pairs = set->depth[0].count;
    for (int z = 0; z < info->depths; z++) {
        const int count = set->depth[z].count;
        set->distances_mm[z] = set->depth[z].distance_mm;
        set->counts[z] = count;
        info->pairs += count;
        info->least_pairs = count < info->least_pairs ? count : info->least_pairs;
    }
    return HADA_OK;
}

static hada_status copy_name(char **out, const char *name, hada_error *err)
{
    *out = NULL;
    return name ? hada_path_format(out, err, "%s", name) : HADA_OK;
}

/* Some pairs of a depth. */
static hada_status copy_depth(hada_dataset_depth *to, const hada_dataset_depth *from, int first, int count,
                              hada_error *err)
{
    hada_status status = HADA_OK;
    to->distance_mm = from->distance_mm;
    HADA_TRY(copy_name(&to->folder, from->folder, err));
    HADA_TRY(hada_allocated(to->pair = hada_alloc((size_t)count, sizeof *to->pair, "a data set", err)));
    for (; to->count < count; to->count++) {
        hada_dataset_pair *pair = &to->pair[to->count];
        pair->number = from->pair[first + to->count].number;
        HADA_TRY(copy_name(&pair->raw, from->pair[first + to->count].raw, err));
        status = copy_name(&pair->scene, from->pair[first + to->count].scene, err);
        if (status)
            free(pair->raw);
        HADA_TRY(status);
    }
    return status;
}

/* The pairs of each depth but for those held out, or these. */
static hada_status copy_part(hada_dataset **out, const hada_dataset *from, const int *held, int want_held,
                             hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(*out = hada_alloc(1, sizeof **out, "a data set", err)));
    hada_dataset *set = *out;
    HADA_TRY_OR_DONE(
        hada_allocated(set->depth = hada_alloc((size_t)from->info.depths, sizeof *set->depth, "a data set", err)));
    set->info.depths = from->info.depths;
    set->read = from->read;
    set->user = from->user;
    for (int z = 0; z < from->info.depths; z++) {
        const int learn = from->counts[z] - held[z];
        HADA_TRY_OR_DONE(
            copy_depth(&set->depth[z], &from->depth[z], want_held ? learn : 0, want_held ? held[z] : learn, err));
    }
    HADA_TRY_OR_DONE(copy_name(&set->psf, from->psf, err));
    HADA_TRY_OR_DONE(copy_name(&set->camera, from->camera, err));
    HADA_TRY_OR_DONE(hada_dataset_count(set, err));
done:
    if (status && *out)
        hada_dataset_destroy(out);
    return status;
}

static hada_status count_held(const hada_dataset *set, double hold_out, int *held, hada_error *err)
{
    for (int z = 0; z < set->info.depths; z++) {
        const int pairs = set->counts[z];
        held[z] = hold_out >= 1.0 ? (int)hold_out : (int)floor(hold_out * pairs + 0.5);
        if (hold_out > 0.0 && !held[z] && pairs >= 3)
            held[z] = 1;
        if (held[z] >= pairs)
            return hada_fail(err, HADA_ERROR_DATASET,
                             "%s has %d pair%s: nothing would be left to learn from with %d held out; give "
                             "options.hold_out a smaller number",
                             set->depth[z].folder, pairs, pairs == 1 ? "" : "s", held[z]);
    }
    return HADA_OK;
}

hada_status hada_dataset_split(const hada_dataset *dataset, double hold_out, hada_dataset **learn,
                               hada_dataset **held_out, hada_error *err)
{
    HADA_NEED(dataset && learn && held_out, err);
    int *held = NULL;
    hada_status status = HADA_OK;
    *learn = *held_out = NULL;
    if (!(hold_out >= 0.0) || (hold_out >= 1.0 && hold_out != floor(hold_out)) || hold_out > 1e6)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "options.hold_out is a number of pairs of each depth, or a share such as 0.2; not %g",
                         hold_out);
    HADA_TRY_OR_DONE(hada_allocated(held = hada_alloc((size_t)dataset->info.depths, sizeof *held, "a data set", err)));
    HADA_TRY_OR_DONE(count_held(dataset, hold_out, held, err));
    HADA_TRY_OR_DONE(copy_part(learn, dataset, held, 0, err));
    HADA_TRY_OR_DONE(copy_part(held_out, dataset, held, 1, err));
done:
    if (status)
        hada_dataset_destroy(learn);
    free(held);
    return status;
}

static hada_status add_pages(hada_tiff_reader *reader, hada_image *mean, hada_error *err)
{
    const int frames = hada_tiff_get_info(reader)->frames;
    hada_image page = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_tiff_read(reader, 0, mean, err));
    const size_t count = hada_image_count(mean);
    for (int t = 1; t < frames; t++) {
        HADA_TRY_OR_DONE(hada_tiff_read(reader, t, &page, err));
        if (page.channels != mean->channels || page.rows != mean->rows || page.cols != mean->cols)
            HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_SIZE, "the pages have different sizes"));
        for (size_t i = 0; i < count; i++)
            mean->data[i] += page.data[i];
        hada_image_destroy(&page);
    }
    for (size_t i = 0; i < count; i++)
        mean->data[i] /= (float)frames;
    const size_t bad = hada_image_count_not_finite(mean);
    if (bad)
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_NOT_FINITE, "%zu pixels are NaN or infinite", bad));
done:
    hada_image_destroy(&page);
    return status;
}

hada_status hada_dark_frame_load(hada_image *image, double *level, const char *path, hada_error *err)
{
    HADA_NEED(image && path, err);
    hada_tiff_reader *reader = NULL;
    hada_status status = HADA_OK;
    double sum = 0.0;
    *image = (hada_image){0};
    HADA_TRY_OR_DONE(hada_tiff_open(&reader, path, err));
    HADA_TRY_OR_DONE(add_pages(reader, image, err));
    for (size_t i = 0; i < hada_image_count(image); i++)
        sum += (double)image->data[i];
    if (level)
        *level = sum / (double)hada_image_count(image);
done:
    hada_tiff_close(&reader);
    if (status) {
        hada_image_destroy(image);
        hada_error_prefix_path(err, path);
    }
    return status;
}
