/* The classic methods under faults. */
#include "fault_job.h"

static void add(fault_job *job, const hada_image *image)
{
    const unsigned char *at = (const unsigned char *)image->data;
    for (size_t i = 0; i < hada_image_count(image) * sizeof *image->data; i++)
        job->sum = (job->sum ^ at[i]) * 1099511628211u;
}

static hada_status run(fault_job *job, hada_method method, hada_prior prior, hada_error *err)
{
    hada_plan_options options;
    hada_plan *plan = NULL;
    hada_result result = {0};
    hada_plan_options_init(&options);
    options.classic.method = method;
    options.classic.prior = prior;
    options.classic.iterations = 2;
    options.classic.stop = 1e-9;
    options.skip = 0;
    hada_status status = hada_plan_create(&plan, job->context, job->model, &options, err);
    if (!status)
        status = hada_plan_run(plan, &job->frame[1][0], &result, err);
    hada_plan_destroy(&plan);
    for (int z = 0; !status && z < result.depths; z++)
        add(job, &result.planes[z]);
    hada_result_destroy(&result);
    return status;
}

hada_status fault_stage_classic(fault_job *job, hada_error *err)
{
    hada_status status = run(job, HADA_METHOD_RL, HADA_PRIOR_TV, err);
    if (!status)
        status = run(job, HADA_METHOD_FISTA, HADA_PRIOR_TV, err);
    if (!status)
        status = run(job, HADA_METHOD_FISTA, HADA_PRIOR_WAVELET, err);
    if (!status)
        status = run(job, HADA_METHOD_ADMM, HADA_PRIOR_TV, err);
    return status;
}
