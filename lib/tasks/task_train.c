/* A training: pairs in two parts, a model, a trainer, the log's folder; its steps, and what is due after them. */

#include "core/callers.h"
#include "core/clock.h"
#include "fit/fitter.h"
#include "io/folder.h"
#include "tasks/fit_steps.h"
#include "tasks/train_log.h"
#include "train/trainer.h"

/* After so many steps of a run, what is left is estimated; over so many the time of a step is averaged. */
enum { TIMED_STEP = 4, AVERAGED_STEPS = 50 };

/* A training. */
typedef struct training {
    hada_train_task task;
    hada_train_options options;
    const hada_dataset *data;
    hada_mended mended;                    /* where no model is given */
    hada_dataset *even, *learn, *held_out; /* the pairs of one exposure, and their two parts */
    hada_survey *survey;
    const hada_model *model; /* the caller's, or `made` */
    hada_model *made;
    hada_trainer *trainer;
    char *log_folder, *checkpoint;
    hada_communicator ranks;
    hada_train_state state; /* what is told */
    hada_train_log log;
    uint64_t validate_every, show_every, save_every;
    double started;
    int without_better; /* validations since the best */
    int whole;          /* the output holds what this training, or the one it goes on from, has written */
    int writes;         /* this rank, the first one, does */
    int stopped;        /* within a validation, which the next run makes */
    int due;            /* a validation that the run before was stopped in */
    hada_progress progress;
} training;

static hada_trainer_info info_of(const hada_trainer *trainer)
{
    hada_trainer_info info = {.size = sizeof info};
    (void)hada_trainer_get_info(trainer, &info, NULL);
    return info;
}

static void tell(training *own, hada_train_event event)
{
    const hada_train_task *task = &own->task;
    own->state.event = event;
    own->state.rows = own->log.rows;
    own->state.row_count = own->log.row_count;
    own->state.seconds = hada_seconds() - own->started;
    if (task->tell && own->writes)
        task->tell(task->user, &own->state);
}

static hada_status write_output(training *own, hada_error *err)
{
    hada_model *model = NULL;
    hada_net *net = NULL;
    hada_status status = HADA_OK;
    if (!own->writes)
        return HADA_OK;
    if (own->options.stage == HADA_STAGE_CONVENTIONAL) {
        HADA_TRY_OR_DONE(hada_trainer_net(own->trainer, &net, err));
        HADA_TRY_OR_DONE(hada_net_save(net, own->task.output, err));
    } else {
        HADA_TRY_OR_DONE(hada_trainer_model(own->trainer, &model, err));
        HADA_TRY_OR_DONE(hada_model_save(model, own->task.output, err));
    }
    own->whole = 1;
done:
    hada_net_destroy(&net);
    hada_model_destroy(&model);
    return status;
}

/* Whether the output can be read: a training that goes on says that its best is there. */
static int output_is_whole(const training *own)
{
    hada_model *model = NULL;
    hada_net *net = NULL;
    const hada_status status = own->options.stage == HADA_STAGE_CONVENTIONAL
                                   ? hada_net_load(&net, own->task.output, NULL)
                                   : hada_model_load(&model, own->task.output, NULL);
    hada_net_destroy(&net);
    hada_model_destroy(&model);
    return !status;
}

/* Whether a validation is the best so far. */
static int is_better(training *own, uint64_t step, double psnr)
{
    hada_train_state *state = &own->state;
    const int better = psnr > state->best_psnr;
    own->without_better = better ? 0 : own->without_better + 1;
    if (better) {
        state->best_psnr = psnr;
        state->best_step = step;
    }
    return better;
}

static hada_status validate(training *own, hada_error *err)
{
    hada_train_state *state = &own->state;
    hada_validation result = {.size = sizeof result};
    if (!state->held_out)
        return HADA_OK;
    const hada_status status = hada_trainer_validate(own->trainer, own->task.validate_pairs, &result, err);
    own->stopped = status == HADA_ERROR_CANCELLED;
    if (status)
        return own->stopped ? HADA_OK : status;
    if (own->writes)
        HADA_TRY(hada_train_log_validation(&own->log, state->step, &result, err));
    state->better = is_better(own, state->step, result.psnr);
    tell(own, HADA_TRAIN_VALIDATED);
    if (state->better && state->keep_best)
        HADA_TRY(write_output(own, err));
    return HADA_OK;
}

static hada_status show(training *own, hada_error *err)
{
    hada_path path;
    if (!own->state.held_out || !own->writes)
        return HADA_OK;
    HADA_TRY(
        hada_path_write(path, err, "%s/pictures/step%08llu.png", own->log_folder, (unsigned long long)own->state.step));
    return hada_train_picture(own->trainer, own->state.held_out, path, err);
}

static hada_status save(training *own, hada_error *err)
{
    if (!own->writes)
        return HADA_OK;
    HADA_TRY(hada_train_log_flush(&own->log, err));
    HADA_TRY(hada_train_figure(&own->log, err));
    HADA_TRY(hada_trainer_save(own->trainer, own->checkpoint, err));
    if (!own->state.keep_best)
        HADA_TRY(write_output(own, err));
    return HADA_OK;
}

/* Whether something that comes every `interval` steps (0: never) comes now, or at the end. */
static int is_due(const training *own, uint64_t interval)
{
    const uint64_t step = own->state.step;
    return interval && (step % interval == 0 || step == own->state.steps);
}

static hada_status after_step(training *own, hada_error *err)
{
    if (is_due(own, own->validate_every))
        HADA_TRY(validate(own, err));
    if (own->stopped)
        return HADA_OK;
    if (is_due(own, own->show_every))
        HADA_TRY(show(own, err));
    if (is_due(own, own->save_every) || own->state.step == own->state.steps)
        HADA_TRY(save(own, err));
    return HADA_OK;
}

static void take_time(training *own, const hada_step_report *report)
{
    hada_train_state *state = &own->state;
    const uint64_t done = report->step - state->first;
    /* the first step compiles kernels and fills memory */
    if (done > 1)
        state->seconds_per_step +=
            (report->seconds - state->seconds_per_step) / (double)(done < AVERAGED_STEPS ? done - 1 : AVERAGED_STEPS);
    if (done == TIMED_STEP)
        tell(own, HADA_TRAIN_TIMED);
}

static hada_status one_step(training *own, hada_error *err)
{
    hada_train_state *state = &own->state;
    hada_step_report report = {.size = sizeof report};
    char note[64];
    HADA_TRY(hada_trainer_step(own->trainer, &report, err));
    if (own->writes)
        HADA_TRY(hada_train_log_step(&own->log, &report, err));
    if (report.rolled_back) {
        state->rolled_back++;
        hada_monitor_tell(own->task.monitor, HADA_MESSAGE_NOTE,
                          "loss or gradient were not finite; back to step %llu with half the rate (%.3g before)",
                          (unsigned long long)report.step, report.rate);
        return HADA_OK;
    }
    state->step = report.step;
    state->loss = report.loss;
    take_time(own, &report);
    snprintf(note, sizeof note, "step %llu, loss %.3e", (unsigned long long)report.step, report.loss);
    (void)hada_progress_step(&own->progress, note, NULL); /* the wish to stop is met between steps */
    return after_step(own, err);
}

static hada_status stop(training *own, hada_error *err)
{
    const hada_train_state *state = &own->state;
    double saved = 1.0;
    HADA_TRY(save(own, err));
    /* a rank that ends takes the others with it: it waits for the one that writes */
    HADA_TRY(hada_reduce(&own->ranks, &saved, 1, err));
    return hada_fail(err, HADA_ERROR_CANCELLED,
                     "stopped after step %llu of %llu, which is saved in %s; the same command with "
                     "options.resume goes on from there",
                     (unsigned long long)state->step, (unsigned long long)state->steps, own->checkpoint);
}

/* Whether any rank is asked to. */
static hada_status wish_to_stop(const training *own, int *wish, hada_error *err)
{
    double wishes = own->stopped || hada_monitor_check(own->task.monitor, NULL) != HADA_OK;
    const hada_status status = hada_reduce(&own->ranks, &wishes, 1, err);
    *wish = wishes > 0.0;
    return status;
}

static hada_status steps(training *own, hada_error *err)
{
    hada_train_state *state = &own->state;
    const hada_train_task *task = &own->task;
    int wish = 0;
    if (own->due)
        HADA_TRY(validate(own, err));
    if (own->due && is_due(own, own->show_every) && !own->stopped)
        HADA_TRY(show(own, err));
    while (state->step < state->steps || own->stopped) {
        HADA_TRY(wish_to_stop(own, &wish, err));
        if (wish)
            return stop(own, err);
        HADA_TRY(one_step(own, err));
        state->step = info_of(own->trainer).steps;
        if (task->patience > 0 && own->without_better >= task->patience) {
            hada_monitor_tell(task->monitor, HADA_MESSAGE_INFO, "Stopped early: %d validations without a better one.",
                              own->without_better);
            return save(own, err);
        }
    }
    return HADA_OK;
}

/* Steps between two of a kind; 0: none. */
static uint64_t every(int given, uint64_t share)
{
    return given >= 0 ? (uint64_t)given : share ? share : 1;
}

/* What the log of the first rank says of the steps before, for all. */
static hada_status recall(training *own, hada_error *err)
{
    hada_train_state *state = &own->state;
    for (size_t i = 0; i < own->log.row_count && (own->whole || !state->keep_best); i++)
        is_better(own, own->log.rows[i].step, own->log.rows[i].result->psnr);
    const uint64_t last = own->log.row_count ? own->log.rows[own->log.row_count - 1].step : 0;
    const int there = own->log.row_count && last == state->first;
    double best[] = {state->best_psnr, (double)state->best_step, own->without_better,
                     !there && is_due(own, own->validate_every)};
    const hada_status status = hada_broadcast(&own->ranks, 0, best, sizeof best, err);
    state->best_psnr = best[0];
    state->best_step = (uint64_t)best[1];
    own->without_better = (int)best[2];
    own->due = best[3] > 0.0;
    return status;
}

static void set_up(training *own)
{
    hada_train_state *state = &own->state;
    const hada_train_task *task = &own->task;
    const int adversarial = info_of(own->trainer).options->adversarial > 0;
    own->validate_every = every(task->validate_every, state->steps / 20);
    own->show_every = every(task->show_every, state->steps / 4);
    own->save_every = every(task->save_every, state->steps / 20);
    state->keep_best = state->held_out && own->validate_every &&
                       (task->keep == HADA_KEEP_BEST || (task->keep == HADA_KEEP_AUTO && !adversarial));
    state->best_psnr = -INFINITY;
    own->started = hada_seconds();
    own->whole = state->first > 0 && (!own->writes || output_is_whole(own));
    if (state->first > 0 && state->keep_best && !own->whole)
        hada_monitor_tell(
            task->monitor, HADA_MESSAGE_NOTE,
            "%s holds no whole model: the best of the steps before is lost, that of those to come is kept",
            task->output);
}

/* Where no validation has written the output. */
static hada_status write_last(training *own, hada_error *err)
{
    if (own->whole)
        return HADA_OK;
    own->state.keep_best = 0;
    return write_output(own, err);
}

/* Steps until the end, with validations, pictures, checkpoints and the best parameters on the way. */
static hada_status train_loop(training *own, hada_error *err)
{
    hada_train_state *state = &own->state;
    state->first = state->step = info_of(own->trainer).steps;
    if (own->writes)
        HADA_TRY(hada_train_log_open(&own->log, own->log_folder, state->first > 0, state->first, err));
    set_up(own);
    HADA_TRY(recall(own, err));
    own->progress = hada_progress_begin(own->task.monitor, "steps",
                                        state->steps > state->first ? (long)(state->steps - state->first) : 0);
    hada_status status = steps(own, err);
    status = status ? status : write_last(own, err);
    hada_progress_end(&own->progress);
    state->step = info_of(own->trainer).steps;
    state->status = status;
    tell(own, HADA_TRAIN_ENDS);
    return status;
}

/* Pairs of each depth that are held out where the caller does not say, and how many of them validate. */
#define HOLD_OUT       0.125
#define VALIDATE_PAIRS 24
/* Distances of a model and a data set are the same within this share. */
#define SAME_DISTANCE 1e-6

static void training_free(training *own)
{
    hada_train_log_close(&own->log);
    hada_trainer_destroy(&own->trainer);
    hada_model_destroy(&own->made);
    hada_mended_free(&own->mended);
    hada_survey_destroy(&own->survey);
    hada_dataset_destroy(&own->even);
    hada_dataset_destroy(&own->learn);
    hada_dataset_destroy(&own->held_out);
    HADA_FREE(own->log_folder, own->checkpoint);
}

static hada_status take_task(training *own, const hada_train_task *task, hada_error *err)
{
    hada_train_options_init(&own->options, HADA_STAGE_ENHANCE);
    HADA_TRY(HADA_OPTIONS_TAKE(&own->task, task, hada_train_task, err));
    HADA_TRY(hada_sized_take(&own->options, sizeof own->options, own->task.options, "hada_train_options", err));
    if (!own->task.output)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "hada_train_run: say where the model shall be written"));
    hada_communicator_init(&own->ranks);
    HADA_TRY(hada_communicator_check(own->options.communicator, err));
    HADA_TRY(HADA_OPTIONS_TAKE(&own->ranks, own->options.communicator, hada_communicator, err));
    own->writes = !own->ranks.rank;
    return HADA_OK;
}

static void tell_pairs(const training *own)
{
    const hada_monitor *monitor = own->task.monitor;
    const hada_dataset_info *info = hada_dataset_get_info(own->data);
    if (info->incomplete)
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE, "left out: %s", info->incomplete_text);
    if (!own->state.held_out)
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
    hada_train_state *state = &own->state;
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
    const hada_train_task *task = &own->task;
    hada_path pictures;
    int there = 0;
    HADA_TRY(task->log ? hada_path_format(&own->log_folder, err, "%s", task->log)
                       : hada_path_format(&own->log_folder, err, "%s.log", task->output));
    HADA_TRY(hada_path_format(&own->checkpoint, err, "%s/checkpoint.safetensors", own->log_folder));
    HADA_TRY(hada_path_write(pictures, err, "%s/pictures", own->log_folder));
    own->state.log = own->log_folder;
    own->state.output = task->output;
    if (!own->writes)
        return HADA_OK;
    HADA_TRY(hada_path_finds_file(own->checkpoint, &there, err));
    if (there && !task->resume && !task->restart)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "%s holds the checkpoint of an earlier training: go on with it (options.resume), begin anew "
                         "(options.restart), or choose another folder (options.log)",
                         own->log_folder);
    return hada_folder_ensure(pictures, err);
}

/* Distances must be those of the model: a depth's number means the same in both. Raw frames are divided by the model's
 * flat frame. */
static hada_status check_data(const hada_model *model, const hada_dataset_info *data, hada_error *err)
{
    const hada_model_info *info = hada_model_get_info(model);
    const int dark = info->dark_frame && !data->dark_frame;
    if (dark || (info->flat && !data->flat))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "%s %s frame: open the data set with that (%s_frame of hada_dataset_options)",
                         *info->name ? info->name : "the model", dark ? "subtracts a dark" : "divides frames by a flat",
                         dark ? "dark" : "flat");
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
static hada_status survey(training *own, hada_context *context, hada_fit_options *fit, hada_error *err)
{
    const hada_train_task *task = &own->task;
    HADA_TRY(HADA_OPTIONS_TAKE(fit, task->fit, hada_fit_options, err));
    HADA_TRY(hada_fit_prepare(fit, own->data, task->boundary, task->monitor, err));
    if (own->model) {
        const hada_model_info *info = hada_model_get_info(own->model);
        int encoded;
        fit->scene_response = info->scene_response;
        fit->frame_encoding = info->frame_encoding == 0.0 ? HADA_RESPONSE_LINEAR : info->frame_encoding;
        HADA_TRY(hada_fit_decode(&own->mended, &own->data, context, fit, &own->ranks, &encoded, err));
        memcpy(fit->colour_matrix, info->colour_matrix, sizeof fit->colour_matrix);
        fit->find_colours = 0;
        fit->dark = info->dark;
        fit->find_dark = 0;
    }
    if (!own->model)
        HADA_TRY(hada_fit_mend(&own->mended, &own->data, context, fit, &own->ranks, 1, err));
    HADA_TRY(hada_fit_survey(&own->survey, &own->even, &own->mended, context, own->data, fit, HADA_EXPOSURE_AUTO,
                             &own->ranks, task->monitor, err));
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
                      own->state.learned);
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
    const int blank = own->options.stage == HADA_STAGE_FILTERS || own->options.stage == HADA_STAGE_CONVENTIONAL;
    hada_fit_options fit;
    own->model = task->model;
    if (own->model)
        HADA_TRY(check_data(own->model, hada_dataset_get_info(own->data), err));
    HADA_TRY(survey(own, context, &fit, err));
    if (own->model)
        return HADA_OK;
    fit.communicator = &own->ranks;
    HADA_TRY(hada_fit_choose_boundary(&fit, context, own->learn, task->boundary, err));
    HADA_TRY(hada_fit_agree(&fit, &own->ranks, err));
    HADA_TRY(blank ? hada_model_from_filters(&own->made, &fit, NULL, NULL, err) : fit_exactly(own, context, &fit, err));
    own->model = own->made;
    HADA_TRY(hada_model_set_flat(own->made, hada_dataset_get_info(own->data)->flat, err));
    return hada_model_set_dark(own->made, hada_dataset_get_info(own->data)->dark_frame, err);
}

/* The planes of trained filters are linear, in training and afterwards. */
static void note_linear(const training *own)
{
    const int steps = hada_model_get_info(own->model)->refine_steps;
    if (steps > 0 && own->options.stage == HADA_STAGE_FILTERS && !own->options.random_start)
        hada_monitor_tell(own->task.monitor, HADA_MESSAGE_NOTE,
                          "the model refines its planes (%d steps); this stage trains linear filters and leaves that "
                          "out, so its pictures may be worse than the model's own",
                          steps);
}

static hada_status make_trainer(training *own, hada_context *const *contexts, int count, hada_error *err)
{
    const hada_dataset *held_out = own->state.held_out ? own->held_out : NULL;
    const hada_status status =
        hada_trainer_create(&own->trainer, contexts, count, own->model, own->learn, held_out, &own->options, err);
    if (status == HADA_ERROR_DEVICE_MEMORY)
        hada_error_prefix(err, "training needs more memory than the device has; try options.at_once 1, "
                               "options.recompute or a smaller options.net_size: ");
    if (own->trainer)
        own->trainer->monitor = own->task.monitor;
    own->state.options = info_of(own->trainer).options;
    own->state.net = info_of(own->trainer).net;
    return status;
}

static hada_status resume(training *own, hada_error *err)
{
    const hada_monitor *monitor = own->task.monitor;
    if (!own->task.resume)
        return HADA_OK;
    int there = 0;
    HADA_TRY(hada_path_finds_file(own->checkpoint, &there, err));
    HADA_TRY(hada_broadcast(&own->ranks, 0, &there, sizeof there, err));
    if (!there) {
        hada_monitor_tell(monitor, HADA_MESSAGE_NOTE, "there is no checkpoint in %s yet: training begins at step 0",
                          own->log_folder);
        return HADA_OK;
    }
    HADA_TRY(hada_trainer_load(own->trainer, own->checkpoint, err));
    hada_monitor_tell(monitor, HADA_MESSAGE_INFO, "Going on from step %llu.",
                      (unsigned long long)info_of(own->trainer).steps);
    return HADA_OK;
}

static void tell_begin(training *own)
{
    own->state.event = HADA_TRAIN_BEGINS;
    if (own->task.tell && own->writes)
        own->task.tell(own->task.user, &own->state);
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
    if (!own.options.vgg && own.options.stage != HADA_STAGE_FILTERS && own.options.perceptual > 0.0)
        hada_monitor_tell(own.task.monitor, HADA_MESSAGE_INFO,
                          "The perceptual loss is off: it needs the weights of VGG-16 (options.vgg FILE).");
    HADA_TRY_OR_DONE(find_model(&own, contexts[0], err));
    HADA_TRY_OR_DONE(make_trainer(&own, contexts, count, err));
    note_linear(&own);
    tell_begin(&own);
    HADA_TRY_OR_DONE(resume(&own, err));
    HADA_TRY_OR_DONE(train_loop(&own, err));
done:
    training_free(&own);
    return status;
}
