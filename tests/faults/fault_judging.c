/* What a fit finds out by holding pairs out: responses and exposures, the boundary, and for a sensor that crops its
 * transfer functions and filters, judged in the window. */
#include "core/base.h"
#include "fault_job.h"

/* Three pairs of each depth, which the survey asks for; the third is one of the other depth's. */
enum { SHOWN = JOB_PAIRS + 1 };
static const int counts[JOB_DEPTHS] = {SHOWN, SHOWN};

static hada_status read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *err)
{
    const fault_job *job = user;
    const int from = pair < JOB_PAIRS ? depth : 1 - depth, number = pair < JOB_PAIRS ? pair : 0;
    const hada_image *frame = &job->frame[from][number], *shown = &job->scene[from][number];
    HADA_TRY(hada_image_crop(raw, frame, 0, 0, frame->rows, frame->cols, err));
    return hada_image_crop(scene, shown, 0, 0, shown->rows, shown->cols, err);
}

static hada_fit_options options_of(void)
{
    hada_fit_options options = fault_fit_options();
    options.refine_steps = 2;
    options.crop_passes = 3;
    return options;
}

static hada_status survey(fault_job *job, const hada_dataset *pairs, hada_fit_options *options, hada_dataset **even,
                          hada_error *err)
{
    SCOPED(hada_survey) *found = NULL;
    HADA_TRY(hada_survey_create(&found, options, pairs, HADA_EXPOSURE_AUTO, err));
    options->scene_response = found->response;
    const double gain = found->gains ? found->gains[1][0] : 1.0;
    fault_add(job, &options->scene_response, sizeof options->scene_response);
    fault_add(job, &gain, sizeof gain);
    return hada_survey_apply(even, found, pairs, err);
}

static hada_status learn(fault_job *job, const hada_dataset *pairs, const hada_fit_options *options, hada_error *err)
{
    SCOPED(hada_fitter) *fitter = NULL;
    SCOPED(hada_model) *model = NULL;
    HADA_TRY(hada_fitter_create(&fitter, job->context, options, err));
    HADA_TRY(hada_fitter_add(fitter, pairs, err));
    HADA_TRY(hada_fitter_finish(fitter, pairs, &model, err));
    for (const hada_fit_outside_score *const *row = hada_fitter_get_info(fitter)->scores->outsides; *row; row++)
        fault_add(job, &(*row)->psnr, sizeof(*row)->psnr);
    return HADA_OK;
}

hada_status fault_stage_judging(fault_job *job, hada_error *err)
{
    hada_fit_options options = options_of();
    SCOPED(hada_dataset) *pairs = NULL, *even = NULL;
    HADA_TRY(hada_dataset_create(&pairs, JOB_DEPTHS, options.distances_mm, counts, read_pair, job, NULL, err));
    HADA_TRY(survey(job, pairs, &options, &even, err));
    HADA_TRY(hada_fit_find_boundary(&options, job->context, even, err));
    fault_add(job, &options.grid_rows, sizeof options.grid_rows);
    options.boundary = HADA_BOUNDARY_PADDED; /* whatever so few pairs say */
    return learn(job, even, &options, err);
}
