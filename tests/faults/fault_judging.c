/* What a fit finds out by holding pairs out: responses and exposures, the boundary, and for a sensor that crops its
 * transfer functions and filters, judged in the window. */
#include <hadalens/fit.h>
#include <hadalens/survey.h>
#include <string.h>

#include "core/error.h"
#include "fault_job.h"

/* Three pairs of each depth, which the survey asks for; the third is one of the other depth's. */
enum { SHOWN = JOB_PAIRS + 1 };
static const int counts[JOB_DEPTHS] = {SHOWN, SHOWN};

static hada_status show(void *user, int depth, int64_t pair, const hada_image **raw, const hada_image **scene,
                        hada_error *err)
{
    const fault_job *job = user;
    const int from = pair < JOB_PAIRS ? depth : 1 - depth, number = pair < JOB_PAIRS ? (int)pair : 0;
    (void)err;
    *raw = &job->frame[from][number];
    *scene = &job->scene[from][number];
    return HADA_OK;
}

static hada_fit_options options_of(void)
{
    hada_fit_options options = fault_fit_options();
    options.refine_steps = 2;
    options.crop_passes = 3;
    return options;
}

static hada_status survey(fault_job *job, hada_fit_options *options, hada_error *err)
{
    hada_survey *found = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_survey_create(&found, options, counts, HADA_EXPOSURE_AUTO, show, job, err));
    options->scene_response = hada_survey_response(found);
    const double gain = hada_survey_gain(found, 1, 0);
    fault_add(job, &options->scene_response, sizeof options->scene_response);
    fault_add(job, &gain, sizeof gain);
done:
    hada_survey_destroy(&found);
    return status;
}

static hada_status learn(fault_job *job, const hada_fit_options *options, hada_error *err)
{
    hada_fitter *fitter = NULL;
    hada_model *model = NULL;
    hada_fit_scores *scores = NULL;
    const hada_fit_outside_score *row;
    const hada_image *raw, *scene;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_fitter_create(&fitter, job->context, options, err));
    for (int pass = 0; pass < 2; pass++)
        for (int k = 0; k < JOB_DEPTHS * SHOWN; k++) {
            HADA_TRY_OR_DONE(show(job, k / SHOWN, k % SHOWN, &raw, &scene, err));
            HADA_TRY_OR_DONE(pass ? hada_fitter_score(fitter, k / SHOWN, raw, scene, err)
                                  : hada_fitter_add(fitter, k / SHOWN, raw, scene, err));
        }
    HADA_TRY_OR_DONE(hada_fitter_learn_cropped(fitter, show, job, err));
    HADA_TRY_OR_DONE(hada_fitter_learn_windowed(fitter, show, job, err));
    HADA_TRY_OR_DONE(hada_fitter_finish(fitter, &model, &scores, err));
    for (size_t i = 0; (row = hada_fit_scores_outside(scores, i)); i++)
        fault_add(job, &row->psnr, sizeof row->psnr);
done:
    hada_fit_scores_destroy(&scores);
    hada_model_destroy(&model);
    hada_fitter_destroy(&fitter);
    return status;
}

hada_status fault_stage_judging(fault_job *job, hada_error *err)
{
    hada_fit_options options = options_of();
    HADA_TRY(survey(job, &options, err));
    HADA_TRY(hada_fit_find_boundary(&options, job->context, counts, show, job, err));
    fault_add(job, &options.grid_rows, sizeof options.grid_rows);
    options.boundary = HADA_BOUNDARY_PADDED; /* whatever so few pairs say */
    return learn(job, &options, err);
}
