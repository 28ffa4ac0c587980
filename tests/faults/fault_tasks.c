/* What commands do, as calls: a data set is written, learned from, its test frames are reconstructed and judged; and a
 * training with its log, checkpoint and model. */
#include "core/base.h"
#include "fault_job.h"
#include "io/folder.h"
#include "model/model.h"

enum { PAIRS = 3, LONGEST = 300 };

static hada_status write_set(const fault_job *job, const char *folder, hada_error *err)
{
    hada_camera camera;
    DEFAULTS(hada_simulate_task, task);
    task.pairs = PAIRS;
    task.tests = 1;
    HADA_TRY(fault_camera_make(&camera, err));
    return hada_simulate_run(job->context, &camera, folder, &task, NULL, err);
}

/* The data set that stays; made when it is first needed, in the runs without faults. */
static hada_status open_set(const fault_job *job, hada_dataset **data, hada_error *err)
{
    if (!hada_path_is_folder(job->set))
        HADA_TRY(write_set(job, job->set, err));
    return hada_dataset_scan(data, job->set, NULL, err);
}

static hada_status learn(fault_job *job, const hada_dataset *data, hada_model **model, hada_error *err)
{
    char sums[LONGEST];
    hada_fit_task task;
    snprintf(sums, sizeof sums, "%s/task.sums", job->folder);
    DEFAULTS(hada_fit_options, options);
    hada_fit_task_init(&task);
    options.leave_one_out = 0;
    task.fit = &options;
    task.boundary = HADA_BOUNDARY_CIRCULAR;
    task.save_sums = sums;
    HADA_TRY(hada_fit_run(model, NULL, job->context, data, &task, err));
    fault_add(job, &hada_model_get_info(*model)->noise, sizeof(double));
    return HADA_OK;
}

/* A file that cannot be done is no failure of the call, but is one of this stage. */
static void tell(void *user, const hada_files_state *state)
{
    if (state->event == HADA_FILES_FAILED)
        *(hada_error *)user = *state->error;
}

static hada_status reconstruct(const fault_job *job, const hada_model *model, const char *folder, hada_error *err)
{
    char frame[LONGEST];
    const char *const paths[] = {frame};
    hada_error failed = {0};
    hada_plan *plan = NULL;
    hada_status status = HADA_OK;
    snprintf(frame, sizeof frame, "%s/test/raw/test01.tif", job->set);
    DEFAULTS(hada_plan_options, options);
    options.refine = 2;
    HADA_TRY_OR_DONE(hada_plan_create(&plan, job->context, model, &options, err));
    DEFAULTS(hada_files_task, task);
    task.output = folder;
    task.preview = 0;
    task.tell = tell;
    task.user = &failed;
    HADA_TRY_OR_DONE(hada_reconstruct_files(plan, model, paths, 1, &task, NULL, err));
    if (failed.status) {
        *err = failed;
        status = failed.status;
    }
done:
    hada_plan_destroy(&plan);
    return status;
}

static hada_status evaluate(fault_job *job, const char *folder, hada_error *err)
{
    char truth[LONGEST];
    SCOPED(hada_evaluate_report) *report = NULL;
    snprintf(truth, sizeof truth, "%s/test/truth", job->set);
    DEFAULTS(hada_evaluate_task, task);
    task.match_gain = task.authors = 1;
    HADA_TRY(hada_evaluate_run(&report, folder, truth, &task, err));
    for (int i = 0; i < hada_evaluate_report_count(report); i++)
        fault_add(job, &hada_evaluate_report_get(report, i)->psnr, sizeof(double));
    return HADA_OK;
}

hada_status fault_stage_tasks(fault_job *job, hada_error *err)
{
    char folder[LONGEST], results[LONGEST];
    hada_dataset *data = NULL;
    hada_model *model = NULL;
    hada_status status = HADA_OK;
    snprintf(folder, sizeof folder, "%s/set", job->folder);
    snprintf(results, sizeof results, "%s/results", job->folder);
    HADA_TRY_OR_DONE(write_set(job, folder, err));
    HADA_TRY_OR_DONE(open_set(job, &data, err));
    HADA_TRY_OR_DONE(learn(job, data, &model, err));
    HADA_TRY_OR_DONE(reconstruct(job, model, results, err));
    HADA_TRY_OR_DONE(evaluate(job, results, err));
done:
    hada_model_destroy(&model);
    hada_dataset_destroy(&data);
    hada_folder_remove(folder);
    return status;
}

/* Twice: begun, and gone on with from its checkpoint. What it learned is compared by the files of its log that hold no
 * times. */
hada_status fault_stage_training(fault_job *job, hada_error *err)
{
    char output[LONGEST], log[LONGEST];
    hada_dataset *data = NULL;
    hada_model *model = NULL;
    hada_train_options options;
    hada_status status = HADA_OK;
    snprintf(output, sizeof output, "%s/trained.model", job->folder);
    snprintf(log, sizeof log, "%s/log", job->folder);
    hada_folder_remove(log);
    HADA_TRY_OR_DONE(open_set(job, &data, err));
    hada_train_options_init(&options, HADA_STAGE_FILTERS);
    options.batch = 2;
    DEFAULTS(hada_train_task, task);
    task.options = &options;
    task.model = job->model;
    task.hold_out = 1;
    task.output = output;
    task.log = log;
    task.show_every = 1;
    task.validate_every = task.save_every = 1;
    for (options.steps = 1; options.steps <= 2; options.steps++, task.resume = 1)
        HADA_TRY_OR_DONE(hada_train_run(&job->context, 1, data, &task, err));
    HADA_TRY_OR_DONE(hada_model_load(&model, output, err));
    const hada_model_info *info = hada_model_get_info(model);
    fault_add(job, model->filter, (size_t)info->grid_cols * sizeof(float));
done:
    hada_model_destroy(&model);
    hada_dataset_destroy(&data);
    hada_folder_remove(log);
    return status;
}
