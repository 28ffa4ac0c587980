/* What a camera resolves: its PSFs, the report on them, and the folder that tells it. */
#include <hadalens/folder.h>
#include <hadalens/preview.h>
#include <hadalens/task_optics.h>
#include <hadalens/tiff.h>

#include "core/callers.h"
#include "io/folder.h"
#include "io/text.h"
#include "optics/mask.h"
#include "tasks/optics_files.h"

#define PSF_GAMMA 0.4 /* shows the light around spots */

/* Where PSFs come from: a file, waves, or (neither) rays. */
typedef struct source {
    hada_tiff_reader *reader;
    hada_wave *wave;
    const hada_monitor *monitor;
} source;

static hada_status source_open(source *from, const hada_optics_task *task, const hada_camera *camera,
                               hada_context *context, hada_error *err)
{
    if (!task->psf) {
        hada_wave_options waves;
        hada_wave_options_init(&waves);
        waves.coherent = task->coherent;
        waves.monitor = task->monitor;
        return camera->optics == HADA_OPTICS_WAVE ? hada_wave_create(&from->wave, context, camera, &waves, err)
                                                  : HADA_OK;
    }
    HADA_TRY(hada_tiff_open(&from->reader, task->psf, err));
    const hada_tiff_info *info = hada_tiff_get_info(from->reader);
    if (info->frames != camera->depths || info->rows != camera->rows || info->cols != camera->cols)
        HADA_TRY(hada_fail(err, HADA_ERROR_SIZE,
                           "%s holds %d pages of %dx%d; the camera has %d depths and %dx%d pixels: set options.depths "
                           "and options.size, or give its camera.json",
                           task->psf, info->frames, info->rows, info->cols, camera->depths, camera->rows,
                           camera->cols));
    return HADA_OK;
}

static hada_status source_get(source *from, const hada_camera *camera, int z, hada_image *psf, hada_error *err)
{
    const double distance = camera->distances_mm[z];
    if (from->reader)
        return hada_tiff_read(from->reader, z, psf, err);
    return from->wave ? hada_wave_psf(from->wave, distance, camera->rows, camera->cols, psf, err)
                      : hada_camera_psf_watched(camera, distance, camera->rows, camera->cols, from->monitor, psf, err);
}

static hada_status write_psf(hada_tiff_writer **writer, const hada_camera *camera, const hada_image *psf,
                             const char *folder, hada_error *err)
{
    hada_path path;
    if (!*writer) {
        hada_tiff_write_options how;
        hada_tiff_write_options_init(&how);
        how.layout = HADA_TIFF_HYPERSTACK;
        how.slices = camera->depths;
        how.times = 1;
        how.distances_mm = camera->distances_mm;
        HADA_TRY(hada_path_write(path, err, "%s/psf.tif", folder));
        HADA_TRY(hada_tiff_create(writer, path, psf->channels, psf->rows, psf->cols, &how, err));
    }
    return hada_tiff_write(*writer, psf, err);
}

static hada_status write_picture(const hada_image *psf, double distance, const char *folder, hada_error *err)
{
    char number[32];
    hada_path path;
    if (!hada_pictures_available())
        return HADA_OK;
    hada_format_exact(number, sizeof number, distance);
    HADA_TRY(hada_path_write(path, err, "%s/psf_z%smm.png", folder, number));
    return hada_png_save(path, psf, HADA_AUTO, PSF_GAMMA, err);
}

/* What one run works on. */
typedef struct run {
    const hada_optics_task *task;
    const hada_camera *camera;
    hada_context *context;
    hada_optics_report **report;
    double threshold;
} run;

static hada_status write_depths(const run *r, source *from, const char *folder, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_tiff_writer *writer = NULL;
    hada_image psf = {0};
    hada_progress progress = hada_progress_begin(r->task->monitor, "depths", r->camera->depths);
    for (int z = 0; z < r->camera->depths; z++) {
        HADA_TRY_OR_DONE(source_get(from, r->camera, z, &psf, err));
        HADA_TRY_OR_DONE(write_psf(&writer, r->camera, &psf, folder, err));
        HADA_TRY_OR_DONE(write_picture(&psf, r->camera->distances_mm[z], folder, err));
        HADA_TRY_OR_DONE(hada_optics_report_add(*r->report, &psf, err));
        hada_image_destroy(&psf);
        HADA_TRY_OR_DONE(hada_progress_step(&progress, NULL, err));
    }
    HADA_TRY_OR_DONE(hada_tiff_finish(&writer, err));
done:
    hada_progress_end(&progress);
    hada_tiff_abandon(&writer);
    hada_image_destroy(&psf);
    return status;
}

static hada_status fill_folder(void *user, const char *folder, hada_error *err)
{
    const run *r = user;
    const hada_camera *camera = r->camera;
    const int holes = camera->mask == HADA_MASK_APERTURE && !(camera->cell_mm > 0.0);
    hada_status status = HADA_OK;
    source from = {.monitor = r->task->monitor};
    hada_path path;
    HADA_TRY_OR_DONE(hada_path_write(path, err, "%s/camera.json", folder));
    HADA_TRY_OR_DONE(hada_camera_save(camera, path, err));
    HADA_TRY_OR_DONE(hada_optics_mask(camera, folder, r->task->monitor, err));
    if (camera->mask == HADA_MASK_MLA || camera->mask == HADA_MASK_GRID || holes)
        HADA_TRY_OR_DONE(hada_optics_lenses(camera, folder, err));
    HADA_TRY_OR_DONE(source_open(&from, r->task, camera, r->context, err));
    HADA_TRY_OR_DONE(hada_optics_report_create(r->report, r->context, camera, r->threshold, err));
    HADA_TRY_OR_DONE(write_depths(r, &from, folder, err));
    HADA_TRY_OR_DONE(hada_optics_tables(*r->report, folder, err));
    HADA_TRY_OR_DONE(hada_optics_plots(*r->report, folder, err));
done:
    hada_tiff_close(&from.reader);
    hada_wave_destroy(&from.wave);
    return status;
}

hada_status hada_optics_run(hada_optics_report **report, hada_context *context, const hada_camera *camera,
                            const char *folder, const hada_optics_task *callers, hada_error *err)
{
    HADA_NEED(context && camera && folder, err);
    hada_optics_task task;
    hada_status status = HADA_OK;
    hada_optics_report *made = NULL;
    if (report)
        *report = NULL;
    HADA_TRY_OR_DONE(HADA_OPTIONS_TAKE(&task, callers, hada_optics_task, err));
    if (task.threshold != HADA_AUTO && !(task.threshold >= 0.0 && task.threshold < 1.0))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_ARGUMENT, "options.threshold takes a number from 0 to 1"));
    run r = {&task, camera, context, &made, task.threshold};
    HADA_TRY_OR_DONE(hada_folder_create(folder, fill_folder, &r, err));
    if (report) {
        *report = made;
        made = NULL;
    }
done:
    hada_optics_report_destroy(&made);
    return status;
}
