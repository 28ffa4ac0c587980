/* Files that are no pictures: a folder that appears at once, with a camera in it and a data set beside it; a tuning
 * file that is written twice. */
#include "core/base.h"
#include "fault_job.h"
#include "io/folder.h"
#include "runtime/tuning.h"

static hada_status write_pairs(const char *folder, const char *kind, const hada_image images[JOB_PAIRS],
                               hada_error *err)
{
    static const char *const names[JOB_PAIRS] = {"a.tif", "b.tif"};
    char path[400], file[450];
    snprintf(path, sizeof path, "%s/z100mm/%s", folder, kind);
    HADA_TRY(hada_folder_ensure(path, err));
    for (int i = 0; i < JOB_PAIRS; i++) {
        snprintf(file, sizeof file, "%s/%s", path, names[i]);
        HADA_TRY(hada_tiff_save(file, &images[i], NULL, err));
    }
    return HADA_OK;
}

static hada_status fill(void *user, const char *folder, hada_error *err)
{
    const fault_job *job = user;
    char path[400];
    hada_camera camera = {.size = sizeof camera};
    hada_camera_init(&camera);
    snprintf(path, sizeof path, "%s/camera.json", folder);
    HADA_TRY(hada_camera_save(&camera, path, err));
    HADA_TRY(write_pairs(folder, "raw", job->frame[0], err));
    HADA_TRY(write_pairs(folder, "scene", job->scene[0], err));
    snprintf(path, sizeof path, "%s/psf.tif", folder);
    return hada_tiff_save(path, &job->frame[0][0], NULL, err);
}

static hada_status read_back(fault_job *job, const char *folder, hada_error *err)
{
    char path[400];
    hada_camera camera = {.size = sizeof camera};
    hada_dataset *set = NULL, *learn = NULL, *held = NULL;
    hada_image dark = {0};
    double level = 0.0;
    hada_status status = HADA_OK;
    hada_camera_init(&camera);
    snprintf(path, sizeof path, "%s/camera.json", folder);
    HADA_TRY_OR_DONE(hada_camera_load(&camera, path, err));
    HADA_TRY_OR_DONE(hada_dataset_scan(&set, folder, NULL, err));
    HADA_TRY_OR_DONE(hada_dataset_split(set, 0.5, &learn, &held, err));
    snprintf(path, sizeof path, "%s/psf.tif", folder);
    HADA_TRY_OR_DONE(hada_dark_frame_load(&dark, &level, path, err));
    job->sum = job->sum * 31 + (uint64_t)camera.rows + (uint64_t)hada_dataset_get_info(set)->pairs +
               10 * (uint64_t)hada_dataset_get_info(held)->pairs + (uint64_t)(1e6 * level);
done:
    hada_image_destroy(&dark);
    hada_dataset_destroy(&learn);
    hada_dataset_destroy(&held);
    hada_dataset_destroy(&set);
    return status;
}

static hada_status tune_twice(fault_job *job, hada_error *err)
{
    static const char *const shapes[] = {"8x8", "9x9"}, *const choices[] = {"own", "clfft"};
    char path[400];
    SCOPED(hada_tuning) *tuning = NULL;
    snprintf(path, sizeof path, "%s/rows.bin", job->folder); /* an ending that says "whole" to the test */
    for (int i = 0; i < 2; i++)
        HADA_TRY(hada_tuning_write(job->context, path, shapes + i, choices + i, 1, err));
    HADA_TRY(hada_tuning_read(&tuning, path, err));
    job->sum = job->sum * 31 + (tuning ? tuning->count : 0);
    return HADA_OK;
}

hada_status fault_stage_files(fault_job *job, hada_error *err)
{
    char folder[300];
    hada_status status = HADA_OK;
    snprintf(folder, sizeof folder, "%s/set", job->folder);
    hada_folder_remove(folder);
    HADA_TRY_OR_DONE(hada_folder_create(folder, fill, job, err));
    HADA_TRY_OR_DONE(read_back(job, folder, err));
    HADA_TRY_OR_DONE(tune_twice(job, err));
done:
    hada_folder_remove(folder);
    return status;
}
