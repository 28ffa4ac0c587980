/* What a training begins with: pairs in two parts, a model, a trainer, the log's folder. */
#include <hadalens/task_fit.h>

#include "core/callers.h"
#include "io/folder.h"
#include "tasks/fit_steps.h"
#include "tasks/train_log.h"
#include "train/trainer.h"

/* Pairs of each depth that are held out where the caller does not say, and how many of them validate. */
#define HOLD_OUT       0.125
#define VALIDATE_PAIRS 24
/* Distances of a model and a data set are the same within this share. */
#define SAME_DISTANCE 1e-6

/* All that a run holds. */
typedef struct training {
    hada_train_task task;
    hada_train_options options;
    hada_train_work work;
    const hada_dataset *data;
    hada_dataset *even, *learn, *held_out; /* the pairs of one exposure, and their two parts */
    hada_survey *survey;
    const hada_model *model; /* the caller's, or `made` */
    hada_model *made;
} training;

static void training_free(training *own)
{
    hada_trainer_destroy(&own->work.trainer);
    hada_model_destroy(&own->made);
    hada_survey_destroy(&own->survey);
    hada_dataset_destroy(&own->even);
    hada_dataset_destroy(&own->learn);
    hada_dataset_destroy(&own->held_out);
    HADA_FREE(own->work.log_folder, own->work.checkpoint);
}

static hada_status take_task(training *own, const hada_train_task *task, hada_error *err)
{
    hada_train_options_init(&own->options, HADA_STAGE_ENHANCE);
    HADA_TRY(HADA_OPTIONS_TAKE(&own->task, task, hada_train_task, err));
    HADA_TRY(hada_sized_take(&own->options, sizeof own->options, own->task.options, "hada_train_options", err));
    if (!own->task.output)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "hada_train_run: say where the model shall be written"));
    hada_communicator_init(&own->work.ranks);
    HADA_TRY(hada_communicator_check(own->options.communicator, err));
    HADA_TRY(HADA_OPTIONS_TAKE(&own->work.ranks, own->options.communicator, hada_communicator, err));
    own->work.task = &own->task;
    own->work.stage = own->options.stage;
    return HADA_OK;
}

static void tell_pairs(const training *own)
{
    const hada_monitor *monitor = own->task.monitor;
    const hada_dataset_info *info = hada_dataset_get_info(own->data);
    if (info->incomplete)
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE, "left out: %s", info->incomplete_text);
    if (!own->work.state.held_out)
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE,
                          "no pair is held out: nothing tells how good training is, and the last parameters are kept");
}

static hada_status split(training *own, const hada_dataset *data, hada_error *err)
{
    hada_dataset_destroy(&own->learn);
    hada_dataset_destroy(&own->held_out);
    return hada_dataset_split(data, own->task.hold_out == HADA_AUTO ? HOLD_OUT : own->task.hold_out, &own->learn,
                              &own->held_out, err);
}

static hada_status divide(training *own, hada_error *err)
{
    hada_train_state *state = &own->work.state;
    HADA_TRY(split(own, own->data, err));
    state->depths = hada_dataset_get_info(own->data)->depths;
    state->learned = hada_dataset_get_info(own->learn)->pairs;
    state->held_out = hada_dataset_get_info(own->held_out)->pairs;
    if (own->task.epochs && own->options.batch > 0)
        own->options.steps = (own->task.epochs * (uint64_t)state->learned + (uint64_t)own->options.batch - 1) /
                             (uint64_t)own->options.batch;
    state->steps = own->options.steps;
    tell_pairs(own);
    return HADA_OK;
}

static hada_status make_folders(training *own, hada_error *err)
{
    hada_train_work *work = &own->work;
    const hada_train_task *task = &own->task;
    hada_path pictures;
    int there = 0;
    HADA_TRY(task->log ? hada_path_format(&work->log_folder, err, "%s", task->log)
                       : hada_path_format(&work->log_folder, err, "%s.log", task->output));
    HADA_TRY(hada_path_format(&work->checkpoint, err, "%s/checkpoint.safetensors", work->log_folder));
    HADA_TRY(hada_path_write(pictures, err, "%s/pictures", work->log_folder));
    work->state.log = work->log_folder;
    work->state.output = task->output;
    if (work->ranks.rank)
        return HADA_OK;
    HADA_TRY(hada_path_finds_file(work->checkpoint, &there, err));
    if (there && !task->resume && !task->restart)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "%s holds the checkpoint of an earlier training: go on with it (options.resume), begin anew "
                         "(options.restart), or choose another folder (options.log)",
                         work->log_folder);
    return hada_folder_ensure(pictures, err);
}

/* Distances must be those of the model: a depth's number means the same in both. Raw frames are divided by the model's
 * flat frame. */
static hada_status check_data(const hada_model *model, const hada_dataset_info *data, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    if (info->flat && !data->flat)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "%s divides frames by a flat frame: open the data set with that (flat_frame of "
                         "hada_dataset_options)",
                         *info->name ? info->name : "the model");
    if (info->downsample != data->downsample || info->sensor_mosaic != data->sensor_mosaic)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "%s bins frames by %d: open the data set with the same downsample and mosaic "
                         "(hada_dataset_options)",
                         *info->name ? info->name : "the model", info->downsample);
    int same = info->depths == data->depths;
    for (int z = 0; same && z < info->depths; z++)
        same = fabs(info->distances_mm[z] - data->distances_mm[z]) <= SAME_DISTANCE * info->distances_mm[z];
    return same ? HADA_OK
                : hada_fail(err, HADA_ERROR_MODEL,
                            "%s knows %d depths from %g to %g mm, the data set holds %d from %g to %g mm; they must be "
                            "the same",
                            *info->name ? info->name : "the model", info->depths, info->distances_mm[0],
                            info->distances_mm[info->depths - 1], data->depths, data->distances_mm[0],
                            data->distances_mm[data->depths - 1]);
}

/* The response of the scenes, where no model says it, and exposures: as in a fit. */
static hada_status survey(training *own, hada_fit_options *fit, hada_error *err)
{
    const hada_train_task *task = &own->task;
    HADA_TRY(HADA_OPTIONS_TAKE(fit, task->fit, hada_fit_options, err));
    HADA_TRY(hada_fit_prepare(fit, own->data, task->boundary, task->monitor, err));
    if (own->model) {
        const hada_model_info *info = hada_model_get_info(own->model);
        fit->scene_response = info->scene_response;
        fit->dark = info->dark;
    }
    HADA_TRY(hada_fit_survey(&own->survey, &own->even, own->data, fit, HADA_EXPOSURE_AUTO, task->monitor, err));
    return split(own, own->even, err);
}

/* The exact fit of the pairs to learn from. Training goes on from its filters, so they are not judged in the window. */
static hada_status fit_exactly(training *own, hada_context *context, hada_fit_options *fit, hada_error *err)
{
    hada_fitter *fitter = NULL;
    hada_status status = HADA_OK;
    fit->outside = 1.0;
    hada_monitor_tell(own->task.monitor, HADA_MESSAGE_INFO,
                      "No model is given (options.model): the exact fit of the %d pairs to learn from comes first.",
                      own->work.state.learned);
    HADA_TRY_OR_DONE(hada_fitter_create(&fitter, context, fit, err));
    HADA_TRY_OR_DONE(hada_fitter_add(fitter, own->learn, err));
    HADA_TRY_OR_DONE(hada_fitter_finish(fitter, own->learn, &own->made, err));
done:
    hada_fitter_destroy(&fitter);
    return status;
}

static hada_status find_model(training *own, hada_context *context, hada_error *err)
{
    const hada_train_task *task = &own->task;
    const int blank = own->work.stage == HADA_STAGE_FILTERS || own->work.stage == HADA_STAGE_CONVENTIONAL;
    hada_fit_options fit;
    own->model = task->model;
    if (own->model)
        HADA_TRY(check_data(own->model, hada_dataset_get_info(own->data), err));
    HADA_TRY(survey(own, &fit, err));
    if (own->model)
        return HADA_OK;
    fit.communicator = &own->work.ranks;
    if (!task->boundary && fit.boundary == HADA_BOUNDARY_PADDED)
        HADA_TRY(hada_fit_choose_boundary(&fit, context, own->learn, task->monitor, err));
    HADA_TRY(hada_fit_agree(&fit, &own->work.ranks, err));
    HADA_TRY(blank ? hada_model_from_filters(&own->made, &fit, NULL, NULL, err) : fit_exactly(own, context, &fit, err));
    own->model = own->made;
    return HADA_OK;
}

/* The planes of trained filters are linear, in training and afterwards. */
static void note_linear(const training *own)
{
    const int steps = hada_model_get_info(own->model)->refine_steps;
    if (steps > 0 && own->work.stage == HADA_STAGE_FILTERS && !own->options.random_start)
        hada_monitor_tell(own->task.monitor, HADA_MESSAGE_NOTE,
                          "the model refines its planes (%d steps); this stage trains linear filters and leaves that "
                          "out, so its pictures may be worse than the model's own",
                          steps);
}

static hada_status make_trainer(training *own, hada_context *const *contexts, int count, hada_error *err)
{
    const hada_dataset *held_out = own->work.state.held_out ? own->held_out : NULL;
    const hada_status status =
        hada_trainer_create(&own->work.trainer, contexts, count, own->model, own->learn, held_out, &own->options, err);
    if (status == HADA_ERROR_DEVICE_MEMORY)
        hada_error_prefix(err, "training needs more memory than the device has; try options.at_once 1, "
                               "options.recompute or a smaller options.net_size: ");
    if (own->work.trainer)
        own->work.trainer->monitor = own->task.monitor;
    own->work.state.options = hada_trainer_info_of(own->work.trainer).options;
    own->work.state.net = hada_trainer_info_of(own->work.trainer).net;
    return status;
}

static hada_status resume(training *own, hada_error *err)
{
    const hada_train_work *work = &own->work;
    const hada_monitor *monitor = own->task.monitor;
    if (!own->task.resume)
        return HADA_OK;
    int there = 0;
    HADA_TRY(hada_path_finds_file(work->checkpoint, &there, err));
    HADA_TRY(hada_broadcast(&work->ranks, 0, &there, sizeof there, err));
    if (!there) {
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE, "there is no checkpoint in %s yet: training begins at step 0",
                          work->log_folder);
        return HADA_OK;
    }
    HADA_TRY(hada_trainer_load(work->trainer, work->checkpoint, err));
    hada_monitor_tell(monitor, HADA_MESSAGE_INFO, "Going on from step %llu.",
                      (unsigned long long)hada_trainer_info_of(work->trainer).steps);
    return HADA_OK;
}

static void tell_begin(training *own)
{
    own->work.state.event = HADA_TRAIN_BEGINS;
    if (own->task.tell && !own->work.ranks.rank)
        own->task.tell(own->task.user, &own->work.state);
}

hada_status hada_train_run(hada_context *const *contexts, int count, const hada_dataset *data,
                           const hada_train_task *task, hada_error *err)
{
    training own = {.data = data};
    hada_status status = HADA_OK;
    if (!contexts || count < 1 || !data)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_train_run: a context and a data set are needed");
    HADA_TRY_OR_DONE(take_task(&own, task, err));
    HADA_TRY_OR_DONE(hada_file_check_target(own.task.output, err));
    HADA_TRY_OR_DONE(divide(&own, err));
    HADA_TRY_OR_DONE(make_folders(&own, err));
    if (!own.options.vgg && own.work.stage != HADA_STAGE_FILTERS && own.options.perceptual > 0.0)
        hada_monitor_tell(own.task.monitor, HADA_MESSAGE_INFO,
                          "The perceptual loss is off: it needs the weights of VGG-16 (options.vgg FILE).");
    HADA_TRY_OR_DONE(find_model(&own, contexts[0], err));
    HADA_TRY_OR_DONE(make_trainer(&own, contexts, count, err));
    note_linear(&own);
    tell_begin(&own);
    HADA_TRY_OR_DONE(resume(&own, err));
    HADA_TRY_OR_DONE(hada_train_loop(&own.work, err));
done:
    training_free(&own);
    return status;
}
