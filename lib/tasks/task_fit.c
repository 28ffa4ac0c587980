/* A camera from a data set, or from saved sums. */
#include <hadalens/camera.h>
#include <hadalens/task_fit.h>
#include <stdlib.h>
#include <unistd.h>

#include "core/alloc.h"
#include "core/callers.h"
#include "fit/sums_file.h"
#include "io/folder.h"
#include "tasks/fit_passes.h"

struct hada_fit_report {
    hada_fit_scores *scores;
    int64_t *pairs; /* of each depth */
    hada_survey *survey;
};

/* A fit on its way. */
typedef struct learning {
    hada_fit_task task;
    const hada_dataset *data;
    hada_fit_options fit;
    hada_fitter *fitter;
    hada_fit_report *report;
    hada_fit_source from;
    hada_fit_store store;
    hada_communicator ranks;
    char *part; /* file of this rank's sums on the way */
} learning;

const hada_fit_scores *hada_fit_report_scores(const hada_fit_report *report)
{
    if (!report)
        return NULL;
    return report->scores;
}

int64_t hada_fit_report_pairs(const hada_fit_report *report, int depth)
{
    if (!report)
        return 0;
    return report->pairs[depth];
}

const hada_survey *hada_fit_report_survey(const hada_fit_report *report)
{
    if (!report)
        return NULL;
    return report->survey;
}

void hada_fit_report_destroy(hada_fit_report **report)
{
    if (!report)
        return;
    if (*report) {
        hada_fit_scores_destroy(&(*report)->scores);
        free((*report)->pairs);
        hada_survey_destroy(&(*report)->survey);
    }
    free(*report);
    *report = NULL;
}

static hada_boundary choose_boundary(int given, const hada_dataset *data, const hada_monitor *monitor)
{
    const char *path = hada_dataset_get_info(data)->camera;
    hada_camera camera = {.size = sizeof camera};
    hada_error err = {0};
    if (given)
        return (hada_boundary)given;
    if (!path)
        return HADA_BOUNDARY_PADDED;
    hada_camera_init(&camera);
    if (!hada_camera_load(&camera, path, &err))
        return camera.boundary;
    hada_monitor_tell(monitor, HADA_MESSAGE_NOTE, "%s is not used: %s", path, err.message);
    return HADA_BOUNDARY_PADDED;
}

hada_status hada_fit_options_from_dataset(hada_fit_options *fit, const hada_dataset *data, int boundary,
                                          const hada_monitor *monitor, hada_error *err)
{
    HADA_NEED(fit && data, err);
    const hada_dataset_info *info = hada_dataset_get_info(data);
    hada_image raw = {0}, scene = {0};
    hada_status status = HADA_OK;
    fit->boundary = choose_boundary(boundary, data, monitor);
    HADA_TRY_OR_DONE(hada_dataset_read(data, 0, 0, &raw, &scene, err));
    fit->depths = info->depths;
    fit->distances_mm = info->distances_mm;
    fit->channels = raw.channels;
    fit->raw_rows = raw.rows;
    fit->raw_cols = raw.cols;
    if (!fit->window_rows) {
        fit->window_rows = scene.rows;
        fit->window_cols = scene.cols;
    }
    if ((fit->window_rows != scene.rows || fit->window_cols != scene.cols) &&
        (scene.rows != raw.rows || scene.cols != raw.cols))
        HADA_TRY_OR_DONE(
            hada_fail(err, HADA_ERROR_ARGUMENT,
                      "options.window %dx%d: the scenes have %dx%d pixels, which is the window then; a smaller "
                      "one can be cut only from scenes as large as the frame (%dx%d)",
                      fit->window_rows, fit->window_cols, scene.rows, scene.cols, raw.rows, raw.cols));
done:
    hada_image_destroy(&raw);
    hada_image_destroy(&scene);
    return status;
}

/* Filters can be judged where every pair can be shown again, which merged sums do not bring. */
static hada_status solve(learning *of, hada_model **out, hada_error *err)
{
    hada_fit_report *report = of->report;
    const int can_judge = of->data && !of->task.merge_count && (of->task.leave_one_out || of->fit.outside >= 0.0);
    if (!can_judge)
        return hada_fitter_finish(of->fitter, out, &report->scores, err);
    if (!of->store.pairs) /* judging looks at pairs several times, if it has to */
        HADA_TRY(hada_fit_store_create(&of->store, of->data, err));
    return hada_fit_pass_learn_and_finish(of->fitter, &of->from, out, &report->scores, err);
}

static hada_status merge(learning *of, int first, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int i = first; i < of->task.merge_count; i++) {
        status = hada_fitter_load_sums(of->fitter, of->task.merge[i], err);
        if (status)
            hada_error_prefix_path(err, of->task.merge[i]);
        HADA_TRY(status);
    }
    return status;
}

/* By the first rank; what each had saved on the way is not needed once they are whole. */
static hada_status save_sums(const learning *of, hada_error *err)
{
    int saved = 1;
    if (!of->task.save_sums)
        return HADA_OK;
    if (!of->ranks.rank)
        HADA_TRY(hada_fitter_save_sums(of->fitter, of->task.save_sums, err));
    HADA_TRY(hada_broadcast(&of->ranks, 0, &saved, sizeof saved, err));
    if (of->part)
        unlink(of->part);
    return HADA_OK;
}

/* Whether the sums of an earlier run are whole: then they are loaded, by the first rank. Its word counts, for files may
 * be seen later elsewhere. */
static hada_status find_sums(learning *of, int *whole, hada_error *err)
{
    const hada_fit_task *task = &of->task;
    const hada_dataset_info *info = hada_dataset_get_info(of->data);
    *whole = of->part && task->resume && hada_path_is_file(task->save_sums);
    HADA_TRY(hada_broadcast(&of->ranks, 0, whole, sizeof *whole, err));
    if (!*whole || of->ranks.rank)
        return HADA_OK;
    HADA_TRY(hada_fitter_load_sums(of->fitter, task->save_sums, err));
    for (int z = 0; z < info->depths; z++)
        if (hada_fitter_pairs(of->fitter, z) != info->counts[z])
            HADA_TRY(hada_fail(err, HADA_ERROR_STATE,
                               "%s holds other pairs than the data set: remove it, or leave out options.resume",
                               task->save_sums));
    return HADA_OK;
}

static hada_status add_pairs(learning *of, hada_error *err)
{
    const hada_fit_task *task = &of->task;
    int whole = 0;
    if (task->save_sums && !task->merge_count)
        HADA_TRY(hada_path_format(&of->part, err, "%s.%d-of-%d", task->save_sums, of->ranks.rank + 1, of->ranks.count));
    of->from.communicator = &of->ranks;
    of->from.part = of->part;
    of->from.part_seconds = task->save_seconds;
    of->from.resume = task->resume;
    HADA_TRY(find_sums(of, &whole, err));
    if (whole)
        return hada_fitter_reduce(of->fitter, err);
    if (!of->ranks.rank) /* which the others get with the sums of all */
        HADA_TRY(merge(of, 0, err));
    HADA_TRY(hada_fit_pass_add(of->fitter, &of->from, err));
    return save_sums(of, err);
}

/* Sums say nothing of the light that left the sensor; without the pairs, transfer functions stay those of one pass. */
static hada_status learn_cropped(const learning *of, hada_error *err)
{
    if (!of->task.merge_count)
        return hada_fit_pass_learn_cropped(of->fitter, &of->from, err);
    if (of->fit.boundary == HADA_BOUNDARY_PADDED && of->fit.nonnegative && of->fit.crop_passes)
        hada_monitor_tell(of->task.monitor, HADA_MESSAGE_NOTE,
                          "transfer functions are those of one pass, without what left the sensor, since merged sums "
                          "do not hold the pairs; give all pairs in one data set to have it learned");
    return HADA_OK;
}

static void tell_data(const learning *of)
{
    const hada_dataset_info *info = hada_dataset_get_info(of->data);
    const hada_monitor *monitor = of->task.monitor;
    if (info->incomplete)
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE, "left out: %s", info->incomplete_text);
    if (info->least_pairs == 1)
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE,
                          "a depth has a single pair: nothing can be held out there, so the model is a guess; show the "
                          "camera about eight scenes per depth");
}

/* Whether the response of the scenes or exposures are to be found. */
static int response_is_open(const learning *of)
{
    const hada_fit_task *task = &of->task;
    const int open = of->fit.scene_response == HADA_AUTO || task->exposure == HADA_EXPOSURE_AUTO;
    return task->exposure == HADA_EXPOSURE_EACH || (task->leave_one_out && open);
}

/* Pairs that several passes look at stay in memory. Where they are added up and no more, the few that are scored are
 * sooner read again than all are kept; without leave-one-out most fits look at each pair once. */
static hada_status keep_pairs(learning *of, hada_error *err)
{
    const int again = response_is_open(of) || of->fit.boundary == HADA_BOUNDARY_PADDED || of->fit.outside >= 0.0;
    return of->task.leave_one_out && again ? hada_fit_store_create(&of->store, of->data, err) : HADA_OK;
}

/* The response of the scenes, where it is open, and exposures, before any pair is added up. */
static hada_status survey(learning *of, hada_error *err)
{
    const hada_fit_task *task = &of->task;
    hada_fit_options *fit = &of->fit;
    of->from = (hada_fit_source){.data = of->data, .store = &of->store, .monitor = task->monitor};
    if (fit->scene_response == HADA_AUTO && task->merge_count)
        HADA_TRY(hada_fit_sums_response(task->merge[0], &fit->scene_response, err));
    if (!response_is_open(of))
        return HADA_OK;
    HADA_TRY(hada_fit_pass_survey(&of->report->survey, &of->from, fit, task->exposure, err));
    of->from.survey = of->report->survey;
    fit->scene_response = hada_survey_response(of->report->survey);
    return HADA_OK;
}

/* The boundary where neither the caller nor the camera says that it is circular; sums to be added say theirs. */
static hada_status find_boundary(learning *of, hada_context *context, hada_error *err)
{
    if (of->task.boundary || of->fit.boundary == HADA_BOUNDARY_CIRCULAR)
        return HADA_OK;
    if (of->task.merge_count)
        return hada_fit_sums_grid(of->task.merge[0], &of->fit, err);
    return hada_fit_pass_boundary(&of->fit, context, &of->from, err);
}

static hada_status learn_pairs(learning *of, hada_context *context, hada_model **out, hada_error *err)
{
    const hada_fit_task *task = &of->task;
    const hada_monitor *monitor = task->monitor;
    tell_data(of);
    HADA_TRY(hada_fit_options_from_dataset(&of->fit, of->data, task->boundary, monitor, err));
    HADA_TRY(keep_pairs(of, err));
    HADA_TRY(survey(of, err));
    HADA_TRY(find_boundary(of, context, err));
    HADA_TRY(hada_fit_pass_agree(&of->fit, &of->ranks, err));
    HADA_TRY(hada_fitter_create(&of->fitter, context, &of->fit, err));
    hada_monitor_tell(monitor, HADA_MESSAGE_DETAIL, "the sums take %.1f MiB on the device",
                      (double)hada_fitter_bytes(of->fitter) / (1024.0 * 1024.0));
    HADA_TRY(add_pairs(of, err));
    /* one pair alone cannot be left out */
    if (task->leave_one_out && (hada_dataset_get_info(of->data)->least_pairs > 1 || task->merge_count))
        HADA_TRY(hada_fit_pass_score(of->fitter, &of->from, err));
    HADA_TRY(learn_cropped(of, err));
    return solve(of, out, err);
}

/* Nothing can be left out here, so what is not given takes its stated default. */
static hada_status learn_sums(learning *of, hada_context *context, hada_model **out, hada_error *err)
{
    HADA_TRY(hada_fitter_create_from_sums(&of->fitter, context, of->task.merge[0], &of->fit, err));
    HADA_TRY(merge(of, 1, err));
    HADA_TRY(save_sums(of, err));
    return solve(of, out, err);
}

static hada_status count_pairs(learning *of, int depths, hada_error *err)
{
    HADA_TRY(
        hada_allocated(of->report->pairs = hada_alloc((size_t)depths, sizeof *of->report->pairs, "a report", err)));
    for (int z = 0; z < depths; z++)
        of->report->pairs[z] = hada_fitter_pairs(of->fitter, z);
    return HADA_OK;
}

static hada_status take_task(learning *of, const hada_fit_task *task, hada_error *err)
{
    HADA_TRY(HADA_OPTIONS_TAKE(&of->task, task, hada_fit_task, err));
    HADA_TRY(HADA_OPTIONS_TAKE(&of->fit, of->task.fit, hada_fit_options, err));
    if (!of->fit.monitor)
        of->fit.monitor = of->task.monitor;
    hada_communicator_init(&of->ranks);
    HADA_TRY(hada_communicator_check(of->fit.communicator, err));
    HADA_TRY(HADA_OPTIONS_TAKE(&of->ranks, of->fit.communicator, hada_communicator, err));
    if (of->task.resume && !of->task.save_sums)
        HADA_TRY(
            hada_fail(err, HADA_ERROR_ARGUMENT,
                      "options.resume goes on from sums that were saved on the way: say where (options.save_sums)"));
    if (!of->data && !of->task.merge_count)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "hada_fit_run: a data set or saved sums are needed"));
    if (of->fit.outside >= 0.0 && of->fit.outside < 1.0 && of->task.merge_count)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "options.outside below 1 looks at every pair several times, and sums (options.merge) have "
                           "none; give all pairs in one data set"));
    return HADA_OK;
}

hada_status hada_fit_run(hada_model **out, hada_fit_report **report, hada_context *context, const hada_dataset *data,
                         const hada_fit_task *task, hada_error *err)
{
    HADA_NEED(out && context, err);
    hada_status status = HADA_OK;
    learning of = {.data = data};
    *out = NULL;
    if (report)
        *report = NULL;
    HADA_TRY_OR_DONE(take_task(&of, task, err));
    HADA_TRY_OR_DONE(hada_allocated(of.report = hada_alloc(1, sizeof *of.report, "a report", err)));
    HADA_TRY_OR_DONE(data ? learn_pairs(&of, context, out, err) : learn_sums(&of, context, out, err));
    HADA_TRY_OR_DONE(count_pairs(&of, hada_model_get_info(*out)->depths, err));
    if (of.task.half)
        HADA_TRY_OR_DONE(hada_model_make_half(out, err));
    if (report) {
        *report = of.report;
        of.report = NULL;
    }
done:
    if (status)
        hada_model_destroy(out);
    hada_fit_report_destroy(&of.report);
    hada_fitter_destroy(&of.fitter);
    hada_fit_store_free(&of.store);
    free(of.part);
    return status;
}
