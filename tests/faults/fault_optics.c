/* A camera's design: its PSFs by geometry and by waves, what it resolves, and the folder that says so. */
#include "core/base.h"
#include "fault_job.h"
#include "io/folder.h"

static hada_status waves(fault_job *job, const hada_camera *camera, hada_error *err)
{
    SCOPED(hada_wave) *wave = NULL;
    SCOPED(hada_image) psf = {0};
    DEFAULTS(hada_wave_options, options);
    HADA_TRY(hada_wave_create(&wave, job->context, camera, &options, err));
    HADA_TRY(hada_wave_psf(wave, camera->distances_mm[0], camera->rows, camera->cols, &psf, err));
    fault_add_image(job, &psf);
    return HADA_OK;
}

hada_status fault_stage_optics(fault_job *job, hada_error *err)
{
    char folder[300];
    hada_camera camera;
    hada_image thickness = {0}, transmission = {0};
    hada_optics_report *report = NULL;
    hada_status status = HADA_OK;
    snprintf(folder, sizeof folder, "%s/design", job->folder);
    hada_folder_remove(folder);
    HADA_TRY_OR_DONE(fault_camera_make(&camera, err));
    HADA_TRY_OR_DONE(hada_camera_set_fill_factor(&camera, 0.3, err));
    HADA_TRY_OR_DONE(hada_camera_mask_map(&camera, JOB_ROWS, JOB_COLS, &thickness, &transmission, err));
    fault_add_image(job, &transmission);
    HADA_TRY_OR_DONE(waves(job, &camera, err));
    HADA_TRY_OR_DONE(hada_optics_run(&report, job->context, &camera, folder, NULL, err));
    for (int z = 0; z < camera.depths; z++)
        fault_add(job, hada_optics_report_row(report, z), sizeof(hada_optics_row));
done:
    hada_optics_report_destroy(&report);
    hada_image_destroy(&thickness);
    hada_image_destroy(&transmission);
    hada_folder_remove(folder);
    return status;
}
