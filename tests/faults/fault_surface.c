/* A frame that is taken for a surface. */
#include "core/base.h"
#include "fault_job.h"

enum { DEPTHS = 3 };

static hada_status make_model(const fault_job *job, const double *distances, hada_model **model, hada_error *err)
{
    hada_camera camera;
    hada_image psf[DEPTHS] = {{0}};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(fault_camera_make(&camera, err));
    DEFAULTS(hada_psf_options, options);
    options.window_rows = options.window_cols = JOB_WINDOW;
    for (int z = 0; z < DEPTHS; z++)
        HADA_TRY_OR_DONE(hada_camera_psf(&camera, distances[z], 0, 0, &psf[z], err));
    HADA_TRY_OR_DONE(hada_model_from_psf(model, job->context, psf, DEPTHS, distances, &options, err));
done:
    for (int z = 0; z < DEPTHS; z++)
        hada_image_destroy(&psf[z]);
    return status;
}

hada_status fault_stage_surface(fault_job *job, hada_error *err)
{
    static const double distances[DEPTHS] = {100.0, 150.0, 300.0};
    hada_model *model = NULL;
    hada_plan *plan = NULL;
    hada_result result = {0};
    hada_status status = HADA_OK;
    DEFAULTS(hada_plan_options, options);
    options.scene = HADA_SCENE_SURFACE;
    options.refine = 2;
    HADA_TRY_OR_DONE(make_model(job, distances, &model, err));
    HADA_TRY_OR_DONE(hada_plan_create(&plan, job->context, model, &options, err));
    HADA_TRY_OR_DONE(hada_plan_run(plan, &job->frame[1][0], &result, err));
    fault_add_image(job, &result.all_in_focus);
    fault_add_image(job, hada_result_confidence(&result));
done:
    hada_plan_destroy(&plan);
    hada_result_destroy(&result);
    hada_model_destroy(&model);
    return status;
}
