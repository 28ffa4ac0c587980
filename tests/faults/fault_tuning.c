/* Measuring what is fastest and keeping it; and a device that works with binaries that were made before, as one that
 * cannot compile. */
#include "core/base.h"
#include "fault_job.h"
#include "io/folder.h"

/* What was chosen goes by times, which no sum holds. */
hada_status fault_stage_tuning(fault_job *job, hada_error *err)
{
    char path[300];
    hada_tune_row row;
    SCOPED(hada_context) *tuned = NULL;
    snprintf(path, sizeof path, "%s/tuning.bin", job->folder); /* an ending that says "whole" to the test */
    HADA_TRY(hada_tune_fft(job->context, 8, 10, 1, &row, err));
    HADA_TRY(hada_tune_save(job->context, path, &row, 1, err));
    DEFAULTS(hada_context_options, options);
    options.tuning = path;
    options.cache = "off";
    options.skip_self_test = 1;
    return hada_context_create(&tuned, &options, err);
}

hada_status fault_stage_offline(fault_job *job, hada_error *err)
{
    hada_context *context = NULL;
    hada_plan *plan = NULL;
    hada_result result = {0};
    hada_status status = HADA_OK;
    if (!hada_path_is_folder(job->offline)) /* in the runs without faults that come first */
        HADA_TRY_OR_DONE(hada_programs_save(job->context, job->offline, NULL, err));
    DEFAULTS(hada_context_options, options);
    options.binaries = job->offline;
    HADA_TRY_OR_DONE(hada_context_create(&context, &options, err));
    DEFAULTS(hada_plan_options, plan_options);
    plan_options.refine = 0;
    HADA_TRY_OR_DONE(hada_plan_create(&plan, context, job->model, &plan_options, err));
    HADA_TRY_OR_DONE(hada_plan_run(plan, &job->frame[0][0], &result, err));
    fault_add_image(job, &result.all_in_focus);
done:
    hada_plan_destroy(&plan);
    hada_result_destroy(&result);
    hada_context_destroy(&context);
    return status;
}
