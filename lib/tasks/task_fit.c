/* A camera from a data set, or from saved sums. */
#include <hadalens/camera.h>
#include <hadalens/reconstruct.h>
#include <hadalens/scene.h>
#include <hadalens/task_fit.h>
#include <math.h>
#include <unistd.h>

#include "core/callers.h"
#include "core/numbers.h"
#include "dataset/dataset.h"
#include "fit/fit_sums.h"
#include "fit/look.h"
#include "image/pixels.h"
#include "io/folder.h"
#include "model/model.h"
#include "tasks/fit_steps.h"
#include "tasks/frames.h"

/* Scenes that were cut off at white: light beyond it is in their frames all the same. A camera that the other pairs
 * give reconstructs them, and what was cut off is taken from there. */

/* The exposure of the frame beside those that gave the camera, by the light that is known. */
static double exposure_of(const hada_image *light, const hada_image *seen, float white)
{
    double both = 0.0, square = 0.0;
    for (size_t i = 0; i < hada_image_count(seen); i++)
        if (light->data[i] < white) {
            both += (double)light->data[i] * seen->data[i];
            square += (double)seen->data[i] * seen->data[i];
        }
    return square > 0.0 && both > 0.0 ? both / square : 0.0;
}

/* What is seen where a scene is at white must be so much brighter, in the mean: else it was no brighter. */
#define BRIGHTER 1.1

/* Light becomes what was seen, where that is brighter. Whether it is where the light is at white. */
static int brighten(hada_image *light, const hada_image *seen, float white)
{
    const double exposure = exposure_of(light, seen, white);
    double there = 0.0, values = 0.0;
    for (size_t i = 0; i < hada_image_count(seen); i++) {
        there += light->data[i] >= white ? exposure * seen->data[i] : 0.0;
        values += light->data[i] >= white;
        light->data[i] = fmaxf(light->data[i], (float)exposure * seen->data[i]);
    }
    return there >= BRIGHTER * values * white;
}

/* Values of the scene from `cut` on become those of its window, if these are larger. */
static void put_brighter(hada_image *scene, const hada_image *window, float cut)
{
    const int top = hada_window_origin(scene->rows, window->rows), left = hada_window_origin(scene->cols, window->cols);
    const float *from = window->data;
    for (int c = 0; c < window->channels; c++)
        for (int r = 0; r < window->rows; r++) {
            const size_t row = (size_t)c * (size_t)scene->rows + (size_t)(top + r);
            float *to = scene->data + row * (size_t)scene->cols + left;
            for (int k = 0; k < window->cols; k++, from++)
                to[k] = to[k] >= cut ? fmaxf(to[k], *from) : to[k];
        }
}

/* Fills a scene with what was seen in its window. *filled: whether the scene was cut off at all. */
static hada_status fill(hada_image *scene, const hada_image *seen, double response, int *filled, hada_error *err)
{
    const size_t count = hada_image_count(seen);
    const float cut = hada_fit_white(scene);
    float white = cut;
    hada_image window;
    HADA_TRY(hada_image_crop(&window, scene, hada_window_origin(scene->rows, seen->rows),
                             hada_window_origin(scene->cols, seen->cols), seen->rows, seen->cols, err));
    hada_response_convert(&white, 1, response, HADA_RESPONSE_LINEAR);
    hada_response_convert(window.data, count, response, HADA_RESPONSE_LINEAR);
    *filled = brighten(&window, seen, white);
    if (*filled) {
        hada_response_convert(window.data, count, HADA_RESPONSE_LINEAR, response);
        put_brighter(scene, &window, cut);
    }
    hada_image_destroy(&window);
    return HADA_OK;
}

static hada_status fill_pair(hada_filled_scene *out, int *filled, hada_plan *plan, double response,
                             const hada_dataset *data, int depth, int number, hada_error *err)
{
    hada_pair pair = {0};
    hada_image frame = {0};
    hada_result result = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_pair_load_raw(data, depth, number, &frame, err));
    HADA_TRY_OR_DONE(hada_plan_run(plan, &frame, &result, err));
    HADA_TRY_OR_DONE(hada_pair_take(&pair, data, depth, number, err));
    HADA_TRY_OR_DONE(hada_image_copy(&out->scene, pair.scene, err));
    HADA_TRY_OR_DONE(fill(&out->scene, &result.planes[0], response, filled, err));
    out->number = hada_pair_number(data, depth, number);
done:
    if (status)
        hada_image_destroy(&out->scene);
    hada_image_destroy(&frame);
    hada_result_destroy(&result);
    hada_pair_return(&pair);
    return status;
}

static hada_status fill_depth(hada_filled_scenes *out, hada_context *context, const hada_model *model,
                              const hada_dataset *data, int depth, unsigned char *leave, hada_error *err)
{
    const hada_dataset_info *pairs = hada_dataset_get_info(data);
    hada_plan_options options;
    hada_plan *plan = NULL;
    hada_status status = HADA_OK;
    hada_plan_options_init(&options);
    options.depths = options.occupied_list = &depth;
    options.depth_count = options.occupied_count = 1;
    options.occupied = HADA_OCCUPIED_LIST;
    options.scene = HADA_SCENE_PLANES;
    for (int i = 0; i < pairs->counts[depth]; i++) {
        int filled = 0;
        if (leave[i] != HADA_CUT_OFF)
            continue;
        if (!plan)
            HADA_TRY_OR_DONE(hada_plan_create(&plan, context, model, &options, err));
        HADA_TRY_OR_DONE(hada_named(fill_pair(&out->list[out->count], &filled, plan,
                                              hada_model_get_info(model)->scene_response, data, depth, i, err),
                                    pairs->files[depth][i].raw, err));
        leave[i] = filled ? HADA_FILLED : HADA_STAYS;
        if (filled)
            out->count++;
        else
            hada_image_destroy(&out->list[out->count].scene);
    }
done:
    hada_plan_destroy(&plan);
    return status;
}

/* Fills scenes that were cut off at white with what a model of the other pairs reconstructs there. leave[depth][pair]
 * is HADA_CUT_OFF for these, and afterwards HADA_FILLED, or HADA_STAYS where a scene was no brighter. *out, empty
 * before, is freed by the caller, also where this failed. */
static hada_status fit_fill_white(hada_filled_scenes *out, hada_context *context, const hada_model *model,
                                  const hada_dataset *data, unsigned char *const *leave, hada_error *err)
{
    const hada_dataset_info *info = hada_dataset_get_info(data);
    HADA_TRY(HADA_NEW(out->list, (size_t)info->pairs, "scenes", err));
    for (int z = 0; z < info->depths; z++)
        HADA_TRY(fill_depth(out, context, model, data, z, leave[z], err));
    return HADA_OK;
}

static void filled_scenes_free(hada_filled_scenes *filled)
{
    for (int i = 0; i < filled->count; i++)
        hada_image_destroy(&filled->list[i].scene);
    free(filled->list);
    *filled = (hada_filled_scenes){0};
}

/* A report and what it points to. */
typedef struct owned_report {
    hada_fit_report report;
    hada_fit_rows rows;
    hada_fit_scores scores;
    int64_t *pairs;
    hada_survey *survey;
    unsigned char **left_out;
    int depths;
} owned_report;

/* A fit that runs. */
typedef struct learning {
    hada_fit_task task;
    const hada_dataset *data;
    hada_mended mended;
    hada_dataset *sound; /* without pairs that spoil the others; NULL: there are none */
    hada_dataset *whole; /* with scenes that are filled in */
    hada_filled_scenes filled;
    hada_dataset *even; /* the same pairs, of one exposure */
    hada_fit_options fit;
    hada_fitter *fitter;
    owned_report *report;
    hada_communicator ranks;
    char *part; /* file of this rank's sums while pairs are added */
} learning;

void hada_fit_report_destroy(hada_fit_report **report)
{
    owned_report *own = hada_taken(report); /* its first member */
    if (!own)
        return;
    free(own->pairs);
    hada_survey_destroy(&own->survey);
    hada_fit_left_out_free(&own->left_out, own->depths);
    free(own);
}

static hada_status merge(learning *of, int first, hada_error *err)
{
    hada_status status = HADA_OK;
    for (int i = first; i < of->task.merge_count; i++)
        HADA_TRY(hada_named(hada_fitter_load_sums(of->fitter, of->task.merge[i], err), of->task.merge[i], err));
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
    const int64_t *pairs = hada_fitter_get_info(of->fitter)->pairs;
    for (int z = 0; z < info->depths; z++)
        if (pairs[z] != info->counts[z])
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
    HADA_TRY(find_sums(of, &whole, err));
    if (whole) {
        unlink(of->part); /* of a job that was killed once the sums were whole */
        return hada_fitter_reduce(of->fitter, err);
    }
    if (!of->ranks.rank) /* which the others get with the sums of all */
        HADA_TRY(merge(of, 0, err));
    const hada_fit_part part = {of->part, task->save_seconds, task->resume};
    HADA_TRY(hada_fitter_add_part(of->fitter, of->data, &part, err));
    return save_sums(of, err);
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

/* How many pairs are so, or (HADA_STAYS) are left out for whatever reason. */
static int count_left_out(const owned_report *own, const hada_dataset *data, hada_left_out why)
{
    const hada_dataset_info *info = hada_dataset_get_info(data);
    int count = 0;
    for (int z = 0; own->left_out && z < info->depths; z++)
        for (int i = 0; i < info->counts[z]; i++)
            count += why ? own->left_out[z][i] == why : own->left_out[z][i] != HADA_STAYS;
    return count;
}

/* Scenes that were cut off become whole by a camera that the others give. */
static hada_status fill_white(learning *of, hada_context *context, hada_error *err)
{
    owned_report *own = of->report;
    hada_fit_task task = of->task;
    hada_model *model = NULL;
    hada_status status = HADA_OK;
    const int cut = count_left_out(own, of->data, HADA_CUT_OFF);
    if (!cut)
        return HADA_OK;
    task.all_pairs = 1;
    task.resume = task.half = 0;
    task.save_sums = NULL;
    hada_monitor_tell(task.monitor, HADA_MESSAGE_DETAIL,
                      "%d scenes are cut off at white: the others are learned from first", cut);
    HADA_TRY_OR_DONE(hada_fit_run(&model, NULL, context, of->sound, &task, err));
    HADA_TRY_OR_DONE(fit_fill_white(&of->filled, context, model, of->data, own->left_out, err));
    HADA_TRY_OR_DONE(hada_dataset_fill(&of->whole, of->data, &of->filled, err));
    HADA_TRY_OR_DONE(
        hada_fit_judge_filled(of->whole, own->left_out, &of->fit, hada_model_get_info(model)->scene_response, err));
    of->data = of->whole;
    hada_dataset_destroy(&of->sound);
    if (count_left_out(own, of->data, HADA_STAYS))
        HADA_TRY_OR_DONE(hada_dataset_select(&of->sound, of->whole, (const unsigned char *const *)own->left_out, err));
    else
        hada_fit_left_out_free(&own->left_out, own->depths);
done:
    hada_model_destroy(&model);
    return status;
}

/* Pairs that spoil what the others say. */
static hada_status leave_out(learning *of, hada_context *context, hada_error *err)
{
    owned_report *own = of->report;
    if (!of->fit.leave_one_out || of->task.all_pairs)
        return HADA_OK;
    own->depths = hada_dataset_get_info(of->data)->depths;
    HADA_TRY(hada_fit_screen(&of->sound, &own->left_out, of->data, &of->fit, err));
    HADA_TRY(fill_white(of, context, err));
    own->report.left_out = (const unsigned char *const *)own->left_out;
    of->data = of->sound ? of->sound : of->data;
    return HADA_OK;
}

/* What is open is as in the sums to be added. */
static hada_status look_at_sums(learning *of, hada_error *err)
{
    hada_fit_options *fit = &of->fit, sums;
    if (!of->task.merge_count)
        return HADA_OK;
    hada_fit_options_init(&sums);
    HADA_TRY(hada_fit_sums_options(of->task.merge[0], &sums, err));
    if (fit->scene_response == HADA_AUTO)
        fit->scene_response = sums.scene_response;
    if (fit->find_dark && fit->dark == 0.0)
        fit->dark = sums.dark;
    if (fit->frame_encoding == HADA_AUTO)
        fit->frame_encoding = sums.frame_encoding;
    if (!hada_colours_known(fit->colour_matrix))
        memcpy(fit->colour_matrix, sums.colour_matrix, sizeof sums.colour_matrix);
    fit->find_dark = fit->find_colours = 0;
    if (of->task.boundary || fit->boundary == HADA_BOUNDARY_CIRCULAR)
        return HADA_OK;
    fit->boundary = sums.boundary;
    fit->grid_rows = sums.grid_rows;
    fit->grid_cols = sums.grid_cols;
    return HADA_OK;
}

/* The response of the scenes and exposures, where they are to be found, before any pair is added. */
static hada_status survey(learning *of, hada_context *context, hada_error *err)
{
    const hada_fit_task *task = &of->task;
    hada_fit_options *fit = &of->fit;
    const int open = fit->scene_response == HADA_AUTO || task->exposure == HADA_EXPOSURE_AUTO ||
                     (fit->find_colours && !hada_colours_known(fit->colour_matrix)) || hada_look_is_lit(fit, of->data);
    if (task->exposure != HADA_EXPOSURE_EACH && !(fit->leave_one_out && open))
        return HADA_OK;
    HADA_TRY(hada_fit_survey(&of->report->survey, &of->even, &of->mended, context, of->data, fit, task->exposure,
                             &of->ranks, task->monitor, err));
    of->report->report.survey = of->report->survey;
    of->data = of->even;
    return HADA_OK;
}

/* Held-out scenes of a usable model are better than constant images by this many decibels: the poorest real camera
 * (six pairs) has 4, pairs that do not belong together have less than 0. */
#define LEAST_GAIN 0.5

static void tell_gain(const learning *of)
{
    const double gain = hada_leave_one_out_gain(&of->fitter->scores);
    if (gain < LEAST_GAIN)
        hada_monitor_tell(
            of->task.monitor, HADA_MESSAGE_NOTE,
            "the model is of no use: held-out scenes come out %.1f dB %s than images of one brightness; "
            "check that each frame is of the scene with its name, that scenes are not turned or mirrored "
            "(hadalens/register.h finds it), "
            "that frames are linear in light (options.frame_encoding), and that they show more than noise",
            fabs(gain), gain < 0.0 ? "worse" : "better");
    else if (isfinite(gain))
        hada_monitor_tell(of->task.monitor, HADA_MESSAGE_DETAIL,
                          "held-out scenes come out %.1f dB better than images of one brightness", gain);
}

static hada_status learn_pairs(learning *of, hada_context *context, hada_model **out, hada_error *err)
{
    const hada_fit_task *task = &of->task;
    const hada_monitor *monitor = task->monitor;
    tell_data(of);
    HADA_TRY(hada_fit_prepare(&of->fit, of->data, task->boundary, monitor, err));
    HADA_TRY(hada_fit_check_content(of->data, err));
    HADA_TRY(look_at_sums(of, err));
    HADA_TRY(hada_fit_mend(&of->mended, &of->data, context, &of->fit, &of->ranks, !task->save_sums, err));
    HADA_TRY(leave_out(of, context, err));
    HADA_TRY(survey(of, context, err));
    if (!task->merge_count)
        HADA_TRY(hada_fit_choose_boundary(&of->fit, context, of->data, task->boundary, err));
    HADA_TRY(hada_fit_agree(&of->fit, &of->ranks, err));
    HADA_TRY(hada_fitter_create(&of->fitter, context, &of->fit, err));
    hada_monitor_tell(monitor, HADA_MESSAGE_DETAIL, "the sums take %.1f MiB on the device",
                      (double)hada_fitter_get_info(of->fitter)->bytes / (1024.0 * 1024.0));
    HADA_TRY(add_pairs(of, err));
    if (task->merge_count && of->fit.boundary == HADA_BOUNDARY_PADDED && of->fit.nonnegative && of->fit.crop_passes)
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE,
                          "transfer functions are learned without the light that left the sensor, since merged sums do "
                          "not hold the pairs; give all pairs in one data set to have it learned");
    HADA_TRY(hada_fitter_finish(of->fitter, of->data, out, err));
    tell_gain(of);
    return HADA_OK;
}

/* Nothing can be left out here, so what is not given takes its stated default. */
static hada_status learn_sums(learning *of, hada_context *context, hada_model **out, hada_error *err)
{
    of->fit.sums = of->task.merge[0];
    HADA_TRY(hada_fitter_create(&of->fitter, context, &of->fit, err));
    HADA_TRY(merge(of, 1, err));
    HADA_TRY(save_sums(of, err));
    return hada_fitter_finish(of->fitter, NULL, out, err);
}

/* What the fitter found out. */
static hada_status fill_report(learning *of, hada_error *err)
{
    owned_report *own = of->report;
    const size_t depths = (size_t)of->fitter->grid.info.depths;
    HADA_TRY(HADA_NEW(own->pairs, depths, "a report", err));
    memcpy(own->pairs, hada_fitter_get_info(of->fitter)->pairs, depths * sizeof *own->pairs);
    own->rows = of->fitter->rows;
    own->scores = hada_fit_rows_list(&own->rows);
    own->report.scores = &own->scores;
    own->report.pairs = own->pairs;
    return HADA_OK;
}

static hada_status take_task(learning *of, const hada_fit_task *task, hada_error *err)
{
    hada_fit_task_init(&of->task);
    hada_fit_options_init(&of->fit);
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
    HADA_TRY_OR_DONE(HADA_NEW(of.report, 1, "a report", err));
    HADA_TRY_OR_DONE(data ? learn_pairs(&of, context, out, err) : learn_sums(&of, context, out, err));
    HADA_TRY_OR_DONE(fill_report(&of, err));
    hada_fitter_destroy(&of.fitter); /* whose memory the model's trial can use */
    HADA_TRY_OR_DONE(hada_model_complete(out, of.task.half, context, of.data, err));
    if (data) { /* whose frames are divided already */
        HADA_TRY_OR_DONE(hada_model_set_flat(*out, hada_dataset_get_info(of.data)->flat, err));
        HADA_TRY_OR_DONE(hada_model_set_dark(*out, hada_dataset_get_info(of.data)->dark_frame, err));
    }
    if (report) {
        *report = &of.report->report;
        of.report = NULL;
    }
done:
    if (status)
        hada_model_destroy(out);
    hada_fit_report *left = of.report ? &of.report->report : NULL;
    hada_fit_report_destroy(&left);
    hada_fitter_destroy(&of.fitter);
    hada_dataset_destroy(&of.even);
    hada_dataset_destroy(&of.sound);
    hada_dataset_destroy(&of.whole);
    hada_mended_free(&of.mended);
    filled_scenes_free(&of.filled);
    free(of.part);
    return status;
}
