
#include "core/callers.h"
#include "core/clock.h"
#include "io/folder.h"
#include "tasks/train_log.h"

/* After so many steps of a run, what is left is estimated; over so many the time of a step is averaged. */
enum { TIMED_STEP = 4, AVERAGED_STEPS = 50 };

typedef struct loop {
    hada_train_work *work;
    hada_train_state *state; /* of the work */
    hada_train_log log;
    uint64_t validate_every, show_every, save_every;
    double started;
    int without_better; /* validations since the best */
    int whole;          /* the output holds what this training, or the one it goes on from, has written */
    int writes;         /* this rank does */
    int stopped;        /* within a validation, which the next run makes */
    int due;            /* a validation that the run before was stopped in */
    hada_progress progress;
} loop;

static void tell(loop *own, hada_train_event event)
{
    const hada_train_task *task = own->work->task;
    own->state->event = event;
    own->state->rows = own->log.rows;
    own->state->row_count = own->log.row_count;
    own->state->seconds = hada_seconds() - own->started;
    if (task->tell && own->writes)
        task->tell(task->user, own->state);
}

static hada_status write_output(loop *own, hada_error *err)
{
    const hada_train_work *work = own->work;
    hada_model *model = NULL;
    hada_net *net = NULL;
    hada_status status = HADA_OK;
    if (!own->writes)
        return HADA_OK;
    if (work->stage == HADA_STAGE_CONVENTIONAL) {
        HADA_TRY_OR_DONE(hada_trainer_net(work->trainer, &net, err));
        HADA_TRY_OR_DONE(hada_net_save(net, work->task->output, err));
    } else {
        HADA_TRY_OR_DONE(hada_trainer_model(work->trainer, &model, err));
        HADA_TRY_OR_DONE(hada_model_save(model, work->task->output, err));
    }
    own->whole = 1;
done:
    hada_net_destroy(&net);
    hada_model_destroy(&model);
    return status;
}

/* Whether the output can be read: a training that goes on says that its best is there. */
static int output_is_whole(const hada_train_work *work)
{
    hada_model *model = NULL;
    hada_net *net = NULL;
    const hada_status status = work->stage == HADA_STAGE_CONVENTIONAL
                                   ? hada_net_load(&net, work->task->output, NULL)
                                   : hada_model_load(&model, work->task->output, NULL);
    hada_net_destroy(&net);
    hada_model_destroy(&model);
    return !status;
}

/* Whether a validation is the best so far. */
static int is_better(loop *own, uint64_t step, double psnr)
{
    hada_train_state *state = own->state;
    const int better = psnr > state->best_psnr;
    own->without_better = better ? 0 : own->without_better + 1;
    if (better) {
        state->best_psnr = psnr;
        state->best_step = step;
    }
    return better;
}

static hada_status validate(loop *own, hada_error *err)
{
    hada_train_state *state = own->state;
    hada_validation result = {.size = sizeof result};
    if (!state->held_out)
        return HADA_OK;
    const hada_status status = hada_trainer_validate(own->work->trainer, own->work->task->validate_pairs, &result, err);
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

static hada_status show(loop *own, hada_error *err)
{
    hada_path path;
    if (!own->state->held_out || !own->writes)
        return HADA_OK;
    HADA_TRY(hada_path_write(path, err, "%s/pictures/step%08llu.png", own->work->log_folder,
                             (unsigned long long)own->state->step));
    return hada_train_picture(own->work->trainer, own->state->held_out, path, err);
}

static hada_status save(loop *own, hada_error *err)
{
    if (!own->writes)
        return HADA_OK;
    HADA_TRY(hada_train_log_flush(&own->log, err));
    HADA_TRY(hada_train_figure(&own->log, err));
    HADA_TRY(hada_trainer_save(own->work->trainer, own->work->checkpoint, err));
    if (!own->state->keep_best)
        HADA_TRY(write_output(own, err));
    return HADA_OK;
}

/* Whether something that comes every `interval` steps (0: never) comes now, or at the end. */
static int is_due(const loop *own, uint64_t interval)
{
    const uint64_t step = own->state->step;
    return interval && (step % interval == 0 || step == own->state->steps);
}

static hada_status after_step(loop *own, hada_error *err)
{
    if (is_due(own, own->validate_every))
        HADA_TRY(validate(own, err));
    if (own->stopped)
        return HADA_OK;
    if (is_due(own, own->show_every))
        HADA_TRY(show(own, err));
    if (is_due(own, own->save_every) || own->state->step == own->state->steps)
        HADA_TRY(save(own, err));
    return HADA_OK;
}

static void take_time(loop *own, const hada_step_report *report)
{
    hada_train_state *state = own->state;
    const uint64_t done = report->step - state->first;
    /* the first step compiles kernels and fills memory */
    if (done > 1)
        state->seconds_per_step +=
            (report->seconds - state->seconds_per_step) / (double)(done < AVERAGED_STEPS ? done - 1 : AVERAGED_STEPS);
    if (done == TIMED_STEP)
        tell(own, HADA_TRAIN_TIMED);
}

static hada_status one_step(loop *own, hada_error *err)
{
    hada_train_state *state = own->state;
    hada_step_report report = {.size = sizeof report};
    char note[64];
    HADA_TRY(hada_trainer_step(own->work->trainer, &report, err));
    if (own->writes)
        HADA_TRY(hada_train_log_step(&own->log, &report, err));
    if (report.rolled_back) {
        state->rolled_back++;
        hada_monitor_tell(own->work->task->monitor, HADA_MESSAGE_NOTE,
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

static hada_status stop(loop *own, hada_error *err)
{
    const hada_train_state *state = own->state;
    double saved = 1.0;
    HADA_TRY(save(own, err));
    /* a rank that ends takes the others with it: it waits for the one that writes */
    HADA_TRY(hada_reduce(&own->work->ranks, &saved, 1, err));
    return hada_fail(err, HADA_ERROR_CANCELLED,
                     "stopped after step %llu of %llu, which is saved in %s; the same command with "
                     "options.resume goes on from there",
                     (unsigned long long)state->step, (unsigned long long)state->steps, own->work->checkpoint);
}

/* Whether any rank is asked to. */
static hada_status wish_to_stop(const loop *own, int *wish, hada_error *err)
{
    double wishes = own->stopped || hada_monitor_check(own->work->task->monitor, NULL) != HADA_OK;
    const hada_status status = hada_reduce(&own->work->ranks, &wishes, 1, err);
    *wish = wishes > 0.0;
    return status;
}

static hada_status steps(loop *own, hada_error *err)
{
    hada_train_state *state = own->state;
    const hada_train_task *task = own->work->task;
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
        state->step = hada_trainer_info_of(own->work->trainer).steps;
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
static hada_status recall(loop *own, hada_error *err)
{
    hada_train_state *state = own->state;
    for (size_t i = 0; i < own->log.row_count && (own->whole || !state->keep_best); i++)
        is_better(own, own->log.rows[i].step, own->log.rows[i].result->psnr);
    const uint64_t last = own->log.row_count ? own->log.rows[own->log.row_count - 1].step : 0;
    const int there = own->log.row_count && last == state->first;
    double best[] = {state->best_psnr, (double)state->best_step, own->without_better,
                     !there && is_due(own, own->validate_every)};
    const hada_status status = hada_broadcast(&own->work->ranks, 0, best, sizeof best, err);
    state->best_psnr = best[0];
    state->best_step = (uint64_t)best[1];
    own->without_better = (int)best[2];
    own->due = best[3] > 0.0;
    return status;
}

static void set_up(loop *own)
{
    hada_train_state *state = own->state;
    const hada_train_task *task = own->work->task;
    const int adversarial = hada_trainer_info_of(own->work->trainer).options->adversarial > 0;
    own->validate_every = every(task->validate_every, state->steps / 20);
    own->show_every = every(task->show_every, state->steps / 4);
    own->save_every = every(task->save_every, state->steps / 20);
    state->keep_best = state->held_out && own->validate_every &&
                       (task->keep == HADA_KEEP_BEST || (task->keep == HADA_KEEP_AUTO && !adversarial));
    state->best_psnr = -INFINITY;
    own->started = hada_seconds();
    own->whole = state->first > 0 && (!own->writes || output_is_whole(own->work));
    if (state->first > 0 && state->keep_best && !own->whole)
        hada_monitor_tell(
            task->monitor, HADA_MESSAGE_NOTE,
            "%s holds no whole model: the best of the steps before is lost, that of those to come is kept",
            task->output);
}

/* Where no validation has written the output. */
static hada_status write_last(loop *own, hada_error *err)
{
    if (own->whole)
        return HADA_OK;
    own->state->keep_best = 0;
    return write_output(own, err);
}

hada_status hada_train_loop(hada_train_work *work, hada_error *err)
{
    hada_train_state *state = &work->state;
    loop own = {.work = work, .state = state, .writes = !work->ranks.rank};
    hada_status status = HADA_OK;
    state->first = state->step = hada_trainer_info_of(work->trainer).steps;
    if (own.writes)
        HADA_TRY_OR_DONE(hada_train_log_open(&own.log, work->log_folder, state->first > 0, state->first, err));
    set_up(&own);
    HADA_TRY_OR_DONE(recall(&own, err));
    own.progress = hada_progress_begin(work->task->monitor, "steps",
                                       state->steps > state->first ? (long)(state->steps - state->first) : 0);
    status = steps(&own, err);
    status = status ? status : write_last(&own, err);
    hada_progress_end(&own.progress);
    state->step = hada_trainer_info_of(work->trainer).steps;
    state->status = status;
    tell(&own, HADA_TRAIN_ENDS);
done:
    hada_train_log_close(&own.log);
    return status;
}
