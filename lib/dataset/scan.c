/* Finding depths and pairs by the names of folders and files; dark frames from files. */

#include <hadalens/tiff.h>

#include "core/callers.h"
#include "dataset/dataset.h"
#include "image/mosaic.h"
#include "io/folder.h"
#include "io/tiff_page.h"

/* At most so many files without their partner are named. */
enum { INCOMPLETE_NAMED = 4 };

static int by_distance(const void *a, const void *b)
{
    const hada_dataset_depth *one = a, *two = b;
    return (one->distance_mm > two->distance_mm) - (one->distance_mm < two->distance_mm);
}

/* The TIFF files of a depth. */
typedef struct listing {
    char *raw_folder, *scene_folder;
    char **raws, **scenes;
    char **raws_by_stem; /* the same files in another order; scenes are in that order */
    int raw_count, scene_count;
} listing;

static void listing_free(listing *of)
{
    free(of->raws_by_stem);
    hada_names_free(&of->raws, &of->raw_count);
    hada_names_free(&of->scenes, &of->scene_count);
    HADA_FREE(of->raw_folder, of->scene_folder);
}

/* The stems of names, in the order of their bytes. */
static int compare_stems(const char *one, const char *two)
{
    const size_t length = hada_name_stem(one), other = hada_name_stem(two);
    const int found = memcmp(one, two, length < other ? length : other);
    return found ? found : (length > other) - (length < other);
}

static int by_stem(const void *a, const void *b)
{
    const char *const *one = a, *const *two = b;
    const int found = compare_stems(*one, *two);
    return found ? found : strcmp(*one, *two);
}

static hada_status list(listing *of, const char *folder, hada_error *err)
{
    hada_stands raw, scene;
    HADA_TRY(hada_path_format(&of->raw_folder, err, "%s/raw", folder));
    HADA_TRY(hada_path_format(&of->scene_folder, err, "%s/scene", folder));
    HADA_TRY(hada_path_kind(of->raw_folder, &raw, err));
    if (raw != HADA_STANDS_FOLDER)
        HADA_TRY(hada_fail(err, HADA_ERROR_DATASET,
                           "%s has no folder 'raw'; a depth needs raw/NAME.tif and scene/NAME.tif", folder));
    HADA_TRY(hada_folder_list_tiffs(of->raw_folder, &of->raws, &of->raw_count, err));
    HADA_TRY(hada_path_kind(of->scene_folder, &scene, err));
    if (scene == HADA_STANDS_FOLDER)
        HADA_TRY(hada_folder_list_tiffs(of->scene_folder, &of->scenes, &of->scene_count, err));
    if (of->raw_count) {
        const size_t bytes = (size_t)of->raw_count * sizeof *of->raws;
        HADA_TRY(hada_allocated(of->raws_by_stem = hada_alloc(1, bytes, "a data set", err)));
        memcpy(of->raws_by_stem, of->raws, bytes);
        qsort(of->raws_by_stem, (size_t)of->raw_count, sizeof *of->raws, by_stem);
    }
    if (of->scene_count)
        qsort(of->scenes, (size_t)of->scene_count, sizeof *of->scenes, by_stem);
    return HADA_OK;
}

/* The first file of `names`, sorted by stem, with the same stem as `name`, or NULL. */
static const char *partner(const char *name, char **names, int count)
{
    int first = 0;
    for (int left = count; left > 0;) {
        const int half = left / 2;
        const int before = compare_stems(names[first + half], name) < 0;
        first += before ? half + 1 : 0;
        left = before ? left - half - 1 : half;
    }
    return first < count && !compare_stems(names[first], name) ? names[first] : NULL;
}

static hada_status note_incomplete(hada_pair_store *store, const char *folder, const char *kind, const char *name,
                                   const char *other, hada_error *err)
{
    char *text = store->incomplete_text;
    const size_t used = strlen(text), room = sizeof store->incomplete_text - used;
    const int number = store->incomplete++;
    if (number < INCOMPLETE_NAMED)
        snprintf(text + used, room, "%s%s/%s/%s has no %s", used ? "; " : "", folder, kind, name, other);
    else if (number == INCOMPLETE_NAMED)
        snprintf(text + used, room, "; and so on");
    HADA_TRY(HADA_GROW(store->alone, (size_t)store->alone_count, 1, "a data set", err));
    store->alone[store->alone_count] = NULL;
    return hada_path_format(&store->alone[store->alone_count++], err, "%s/%s/%s", folder, kind, name);
}

static hada_status scan_depth(hada_pair_store *store, hada_dataset_depth *depth, hada_error *err)
{
    listing files = {0};
    char *raw_path = NULL, *scene_path = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(list(&files, depth->folder, err));
    HADA_TRY_OR_DONE(HADA_NEW(depth->files, (size_t)files.raw_count, "a data set", err));
    for (int i = 0; i < files.raw_count; i++) {
        const char *scene = partner(files.raws[i], files.scenes, files.scene_count);
        if (!scene) {
            HADA_TRY_OR_DONE(note_incomplete(store, depth->folder, "raw", files.raws[i], "scene", err));
            continue;
        }
        HADA_TRY_OR_DONE(hada_path_format(&raw_path, err, "%s/%s", files.raw_folder, files.raws[i]));
        HADA_TRY_OR_DONE(hada_path_format(&scene_path, err, "%s/%s", files.scene_folder, scene));
        depth->files[depth->count++] = (hada_pair_files){raw_path, scene_path};
        raw_path = scene_path = NULL;
    }
    for (int i = 0; i < files.scene_count; i++)
        if (!partner(files.scenes[i], files.raws_by_stem, files.raw_count))
            HADA_TRY_OR_DONE(note_incomplete(store, depth->folder, "scene", files.scenes[i], "raw frame", err));
done:
    HADA_FREE(raw_path, scene_path);
    listing_free(&files);
    return status;
}

/* `name` NULL: the folder itself. */
static hada_status add_depth(hada_pair_store *store, const char *folder, const char *name, double distance,
                             hada_error *err)
{
    HADA_TRY(HADA_GROW(store->depth, (size_t)store->depths, 1, "the depths of a data set", err));
    hada_dataset_depth *depth = &store->depth[store->depths];
    *depth = (hada_dataset_depth){.distance_mm = distance};
    const hada_status status = hada_path_format(&depth->folder, err, name ? "%s/%s" : "%s", folder, name);
    store->depths += !status;
    return status;
}

static hada_status find_depths(hada_pair_store *store, const char *folder, hada_error *err)
{
    char **names;
    int count;
    const char *rest;
    hada_path raw;
    hada_status status = HADA_OK;
    HADA_TRY(hada_folder_list_depths(folder, "data set", &names, &count, err));
    for (int i = 0; i < count; i++)
        HADA_TRY_OR_DONE(add_depth(store, folder, names[i], hada_name_distance(names[i], &rest), err));
    HADA_TRY_OR_DONE(hada_path_write(raw, err, "%s/raw", folder));
    if (!store->depths && hada_path_is_folder(raw)) /* one depth, whose distance is not known */
        HADA_TRY_OR_DONE(add_depth(store, folder, NULL, 0.0, err));
    if (!store->depths)
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_DATASET,
                      "%s holds no folder named z<distance>mm; a data set looks like %s/z100mm/raw/NAME.tif and "
                      "%s/z100mm/scene/NAME.tif, and without z100mm where there is one depth",
                      folder, folder, folder));
    qsort(store->depth, (size_t)store->depths, sizeof *store->depth, by_distance);
done:
    hada_names_free(&names, &count);
    return status;
}

static hada_status check(const hada_pair_store *store, int skip_incomplete, hada_error *err)
{
    if (store->incomplete && !skip_incomplete)
        return hada_fail(
            err, HADA_ERROR_DATASET,
            "%d %s no partner: %s. Add what is missing (as .tif, .png, .jpg, .npy, .mat, .dng or .raw), or leave "
            "these out with options.skip_incomplete",
            store->incomplete, store->incomplete == 1 ? "file has" : "files have", store->incomplete_text);
    for (int z = 0; z < store->depths; z++) {
        const hada_dataset_depth *depth = &store->depth[z];
        if (!depth->count)
            return hada_fail(err, HADA_ERROR_DATASET,
                             "%s holds no pair of raw/NAME.tif and scene/NAME.tif; add some or move the folder away",
                             depth->folder);
        if (depth->distance_mm == 0.0 && store->depths > 1)
            return hada_fail(err, HADA_ERROR_DATASET,
                             "%s: among several depths every distance must be known; name the folder by it, above 0 mm",
                             depth->folder);
        if (z && depth->distance_mm <= store->depth[z - 1].distance_mm)
            return hada_fail(err, HADA_ERROR_DATASET, "%s and %s have the same distance", store->depth[z - 1].folder,
                             depth->folder);
    }
    return HADA_OK;
}

/* The path of a file that may be beside the depths; NULL where it is missing. */
static hada_status find_file(char **out, const char *folder, const char *name, hada_error *err)
{
    hada_stands what = HADA_STANDS_NOTHING;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_path_format(out, err, "%s/%s", folder, name));
    HADA_TRY_OR_DONE(hada_path_kind(*out, &what, err));
done:
    if (what != HADA_STANDS_FILE) {
        free(*out);
        *out = NULL;
    }
    return status;
}

/* Keeps outputs from replacing the files of a data set. */
static hada_status protect(hada_pair_store *store, hada_error *err)
{
    const char **paths = NULL;
    size_t count = 0, pairs = 0;
    hada_status status = HADA_OK;
    for (int z = 0; z < store->depths; z++)
        pairs += (size_t)store->depth[z].count;
    HADA_TRY_OR_DONE(HADA_NEW(paths, 2 * pairs + (size_t)store->alone_count + 2, "a data set", err));
    for (int i = 0; i < store->alone_count; i++)
        paths[count++] = store->alone[i];
    for (int z = 0; z < store->depths; z++)
        for (int i = 0; i < store->depth[z].count; i++) {
            paths[count++] = store->depth[z].files[i].raw;
            paths[count++] = store->depth[z].files[i].scene;
        }
    paths[count++] = store->psf;
    paths[count++] = store->camera;
    HADA_TRY_OR_DONE(hada_inputs_protect(&store->inputs, paths, count, err));
done:
    free(paths);
    return status;
}

/* Names of all files; the folder's pairs become *store, which the caller releases. */
static hada_status scan(hada_pair_store **store, const char *folder, const hada_dataset_options *options,
                        hada_error *err)
{
    HADA_TRY(hada_pair_store_create(store, options, err));
    HADA_TRY(find_depths(*store, folder, err));
    for (int z = 0; z < (*store)->depths; z++)
        HADA_TRY(scan_depth(*store, &(*store)->depth[z], err));
    HADA_TRY(check(*store, options->skip_incomplete, err));
    HADA_TRY(find_file(&(*store)->psf, folder, "psf.tif", err));
    return find_file(&(*store)->camera, folder, "camera.json", err);
}

/* The colour filter mosaic that the file of a frame names, where the scene is in colour. A file that cannot be read
 * says so when its turn comes. */
static hada_mosaic stated_mosaic(const hada_pair_files *files)
{
    hada_tiff_reader *raw = NULL, *scene = NULL;
    hada_mosaic mosaic = HADA_MOSAIC_NONE;
    if (!hada_tiff_open(&raw, files->raw, NULL) && hada_tiff_get_info(raw)->mosaic != HADA_MOSAIC_NONE &&
        !hada_tiff_open(&scene, files->scene, NULL) && hada_tiff_get_info(scene)->channels == HADA_MOSAIC_COLOURS)
        mosaic = hada_tiff_get_info(raw)->mosaic;
    hada_tiff_close(&raw);
    hada_tiff_close(&scene);
    return mosaic;
}

/* What the first frame's file states is the mosaic, unless the caller says it, who must not say otherwise. */
static hada_status settle_mosaic(const hada_pair_store *store, hada_dataset_options *options, hada_error *err)
{
    const hada_pair_files *first = &store->depth[0].files[0];
    const hada_mosaic stated = stated_mosaic(first);
    if (hada_mosaic_is_pattern(options->mosaic) && stated != HADA_MOSAIC_NONE && options->mosaic != stated)
        return hada_fail(err, HADA_ERROR_DATASET,
                         "%s: the colour filter mosaic of the file is %s; leave options.mosaic %s out", first->raw,
                         hada_enum_name(HADA_ENUM_MOSAIC, (int)stated),
                         hada_enum_name(HADA_ENUM_MOSAIC, (int)options->mosaic));
    options->mosaic = options->mosaic == HADA_MOSAIC_AUTO ? stated : options->mosaic;
    return HADA_OK;
}

hada_status hada_dataset_scan(hada_dataset **out, const char *folder, const hada_dataset_options *callers,
                              hada_error *err)
{
    HADA_NEED(out && folder, err);
    hada_dataset_options options;
    hada_pair_store *store = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY(HADA_OPTIONS_TAKE(&options, callers, hada_dataset_options, err));
    const hada_dataset_options asked = options;
    HADA_TRY_OR_DONE(scan(&store, folder, &options, err));
    HADA_TRY_OR_DONE(settle_mosaic(store, &options, err));
    if (options.mosaic != HADA_MOSAIC_NONE && options.mosaic != asked.mosaic) {
        hada_pair_store_release(&store);
        HADA_TRY_OR_DONE(scan(&store, folder, &options, err));
    }
    HADA_TRY_OR_DONE(protect(store, err));
    return hada_dataset_open(out, store, err);
done:
    hada_pair_store_release(&store);
    return status;
}

static hada_status add_pages(hada_tiff_reader *reader, hada_image *mean, hada_error *err)
{
    const int frames = hada_tiff_get_info(reader)->frames;
    hada_image page = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_tiff_read_light(reader, 0, HADA_AUTO, mean, err));
    const size_t count = hada_image_count(mean);
    for (int t = 1; t < frames; t++) {
        HADA_TRY_OR_DONE(hada_tiff_read_light(reader, t, HADA_AUTO, &page, err));
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
    if (status)
        hada_image_destroy(image);
    return hada_named(status, path, err);
}
