/* The classic methods under faults. */
#include "fault_job.h"

static hada_status run(fault_job *job, const hada_model *model, hada_method method, hada_prior prior, hada_error *err)
{
    hada_plan *plan = NULL;
    SCOPED(hada_result) result = {0};
    DEFAULTS(hada_plan_options, options);
    DEFAULTS(hada_classic_options, classic);
    classic.method = method;
    classic.prior = prior;
    classic.iterations = 2;
    classic.stop = 1e-9;
    options.classic = &classic;
    options.skip = 0;
    hada_status status = hada_plan_create(&plan, job->context, model, &options, err);
    if (!status)
        status = hada_plan_run(plan, &job->frame[1][0], &result, err);
    hada_plan_destroy(&plan);
    for (int z = 0; !status && z < result.depths; z++)
        fault_add_image(job, &result.planes[z]);
    return status;
}

/* A camera whose sensor crops, of narrow point spread functions: its transforms have a smaller grid. */
static hada_status make_cropped(fault_job *job, hada_model **model, hada_error *err)
{
    static const double distances[JOB_DEPTHS] = {100.0, 200.0};
    const hada_image *frame = &job->frame[1][0];
    const size_t area = (size_t)frame->rows * (size_t)frame->cols;
    hada_image psf[JOB_DEPTHS] = {{0}};
    DEFAULTS(hada_psf_options, options);
    options.psf_dark = options.dark = 0;
    options.boundary = HADA_BOUNDARY_PADDED;
    hada_status status = HADA_OK;
    for (int z = 0; !status && z < JOB_DEPTHS; z++) {
        status = hada_image_create(&psf[z], frame->channels, frame->rows, frame->cols, err);
        for (size_t c = 0; !status && c < (size_t)frame->channels; c++)
            psf[z].data[c * area + area / 2 + (size_t)z] = psf[z].data[c * area + area / 2 + 3] = 0.5f;
    }
    if (!status)
        status = hada_model_from_psf(model, job->context, psf, JOB_DEPTHS, distances, &options, err);
    for (int z = 0; z < JOB_DEPTHS; z++)
        hada_image_destroy(&psf[z]);
    return status;
}

hada_status fault_stage_classic(fault_job *job, hada_error *err)
{
    SCOPED(hada_model) *cropped = NULL;
    HADA_TRY(run(job, job->model, HADA_METHOD_RL, HADA_PRIOR_TV, err));
    HADA_TRY(run(job, job->model, HADA_METHOD_FISTA, HADA_PRIOR_TV, err));
    HADA_TRY(run(job, job->model, HADA_METHOD_FISTA, HADA_PRIOR_WAVELET, err));
    HADA_TRY(run(job, job->model, HADA_METHOD_ADMM, HADA_PRIOR_TV, err));
    HADA_TRY(make_cropped(job, &cropped, err));
    return run(job, cropped, HADA_METHOD_FISTA, HADA_PRIOR_NONE, err);
}
