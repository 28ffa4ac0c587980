/* A data set with registered scenes. */
#include <fcntl.h>
#include <hadalens/tiff.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/callers.h"
#include "core/input.h"
#include "dataset/dataset.h"
#include "io/folder.h"
#include "io/text.h"
#include "tasks/registered.h"

typedef struct writing {
    const hada_register_report *report;
    const hada_dataset *data;
    hada_register_task task;
    int rows, cols; /* of the scenes */
    hada_progress progress;
} writing;

/* The size that holds the scenes of all depths, within the frame, unless it is given. */
static hada_status choose_window(writing *w, hada_error *err)
{
    const hada_register_task *task = &w->task;
    hada_image raw, scene;
    hada_status status = hada_dataset_read(w->data, 0, 0, &raw, &scene, err);
    if (status)
        return status;
    w->rows = w->cols = 1;
    for (int z = 0; z < hada_dataset_get_info(w->data)->depths; z++) {
        const hada_registered_depth *one = &w->report->depth[z].depth;
        int rows, cols;
        hada_register_size(one->applied, one->scene_rows, one->scene_cols, &rows, &cols);
        w->rows = rows > w->rows ? rows : w->rows;
        w->cols = cols > w->cols ? cols : w->cols;
    }
    w->rows = task->window_rows ? task->window_rows : w->rows < raw.rows ? w->rows : raw.rows;
    w->cols = task->window_rows ? task->window_cols : w->cols < raw.cols ? w->cols : raw.cols;
    if (w->rows > raw.rows || w->cols > raw.cols)
        status = hada_fail(err, HADA_ERROR_SIZE, "options.window %dx%d is larger than the frames, %dx%d", w->rows,
                           w->cols, raw.rows, raw.cols);
    hada_image_destroy(&raw);
    hada_image_destroy(&scene);
    return status;
}

static hada_status copy_file(const char *from, const char *to, hada_error *err)
{
    char *bytes = NULL;
    size_t size;
    hada_status status = hada_input_read(&bytes, &size, from, SIZE_MAX / 2, NULL, err);
    if (status)
        hada_error_prefix(err, "%s ", from);
    else
        status = hada_file_write(to, bytes, size, err);
    free(bytes);
    return status;
}

static hada_status write_scene(const writing *w, const char *from, const char *to,
                               const hada_registration *registration, hada_error *err)
{
    hada_image scene = {0}, out = {0};
    hada_tiff_write_options options;
    hada_status status = HADA_OK;
    hada_tiff_write_options_init(&options);
    options.bits = 32;
    HADA_TRY_OR_DONE(hada_tiff_load(from, 0, &scene, err));
    HADA_TRY_OR_DONE(hada_register_apply(&out, &scene, registration, w->rows, w->cols, err));
    HADA_TRY_OR_DONE(hada_tiff_save(to, &out, &options, err));
done:
    hada_image_destroy(&scene);
    hada_image_destroy(&out);
    return status;
}

static const char *name_of(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

static hada_status write_pair(const writing *w, int z, int i, const char *raws, const char *scenes, hada_error *err)
{
    const char *raw_from = hada_dataset_raw_path(w->data, z, i), *scene_from = hada_dataset_scene_path(w->data, z, i);
    char *raw = NULL, *scene = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_path_format(&raw, err, "%s/%s", raws, name_of(raw_from)));
    HADA_TRY_OR_DONE(hada_path_format(&scene, err, "%s/%s", scenes, name_of(scene_from)));
    /* a link to what a link leads to: one that is relative would lead elsewhere from here */
    if (linkat(AT_FDCWD, raw_from, AT_FDCWD, raw, AT_SYMLINK_FOLLOW))
        HADA_TRY_OR_DONE(copy_file(raw_from, raw, err));
    HADA_TRY_OR_DONE(write_scene(w, scene_from, scene, &w->report->depth[z].applied, err));
done:
    free(raw);
    free(scene);
    return status;
}

static hada_status write_depth(writing *w, int z, const char *folder, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(w->data);
    char *raws = NULL, *scenes = NULL, distance[32];
    hada_status status = HADA_OK;
    hada_format_exact(distance, sizeof distance, info->distances_mm[z]);
    HADA_TRY_OR_DONE(hada_path_format(&raws, err, "%s/z%smm/raw", folder, distance));
    HADA_TRY_OR_DONE(hada_path_format(&scenes, err, "%s/z%smm/scene", folder, distance));
    HADA_TRY_OR_DONE(hada_folder_ensure(raws, err));
    HADA_TRY_OR_DONE(hada_folder_ensure(scenes, err));
    for (int i = 0; i < info->counts[z]; i++) {
        HADA_TRY_OR_DONE(write_pair(w, z, i, raws, scenes, err));
        HADA_TRY_OR_DONE(hada_progress_step(&w->progress, NULL, err));
    }
done:
    free(raws);
    free(scenes);
    return status;
}

static hada_status write_all(void *user, const char *folder, hada_error *err)
{
    writing *w = user;
    const hada_dataset_info *info = hada_dataset_get_info(w->data);
    hada_status status = HADA_OK;
    w->progress = hada_progress_begin(w->task.monitor, "pairs", info->pairs);
    for (int z = 0; z < info->depths; z++)
        HADA_TRY_OR_DONE(write_depth(w, z, folder, err));
done:
    hada_progress_end(&w->progress);
    return status;
}

hada_status hada_register_write(const hada_register_report *report, const hada_dataset *data, const char *folder,
                                const hada_register_task *task, int *rows, int *cols, hada_error *err)
{
    HADA_NEED(report && data && folder, err);
    writing w = {.report = report, .data = data};
    HADA_TRY(HADA_OPTIONS_TAKE(&w.task, task, hada_register_task, err));
    if (!hada_dataset_has_files(data))
        HADA_TRY(hada_fail(err, HADA_ERROR_UNSUPPORTED,
                           "only a data set of files can be written registered: apply the transforms to the scenes"));
    HADA_TRY(choose_window(&w, err));
    HADA_TRY(hada_folder_create(folder, write_all, &w, err));
    if (rows)
        *rows = w.rows;
    if (cols)
        *cols = w.cols;
    return HADA_OK;
}
